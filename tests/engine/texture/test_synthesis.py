# SPDX-License-Identifier: GPL-3.0-or-later
"""Best sine for a window of a waveform, for any number of periods in the window."""

from __future__ import annotations

import numpy as np
import pytest
from gratings import grating
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture import stroke as strokes
from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.stroke_rendering import amplitude_and_frequency, render_stroke


@settings(max_examples=100, deadline=None)
@given(
    st.floats(10.0, 900.0),
    st.floats(0.0, 2.0 * np.pi),
    st.floats(1e-9, 10.0),
    st.sampled_from([(2000.0, 100), (2040.0, 102), (8000.0, 400)]),
)
def test_a_sine_has_its_own_amplitude_and_frequency_in_any_window_of_50_ms(
    frequency: float, phase: float, amplitude: float, window: tuple[float, int]
) -> None:
    rate, count = window
    wave = amplitude * np.sin(2.0 * np.pi * frequency * np.arange(count) / rate + phase)
    actual, hertz = amplitude_and_frequency(wave, rate)
    assert actual == pytest.approx(amplitude, rel=1e-6)
    assert hertz == pytest.approx(frequency, rel=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 1_000_000), st.integers(3, 40))
def test_any_window_gives_a_finite_sine(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    waves = np.concatenate(
        [
            rng.normal(size=(3, count)) * 10.0 ** rng.integers(-12, 3, (3, 1)),
            np.linspace(-1.0, 1.0, count)[None],  # a ramp
            np.full((1, count), 0.3),
            np.eye(1, count, int(rng.integers(count))),
            np.zeros((1, count)),
        ]
    )
    amplitude, frequency = amplitude_and_frequency(waves, 2000.0)
    assert np.isfinite(amplitude).all() and np.isfinite(frequency).all()
    assert (amplitude >= 0.0).all() and (frequency >= 0.0).all() and (frequency <= 1000.0).all()
    assert (amplitude <= 2.0 * np.abs(waves).max(axis=1) * np.sqrt(count)).all()
    assert amplitude[-1] == 0.0 and frequency[-1] == 0.0


def test_of_noise_the_amplitude_is_root_2_times_the_rms() -> None:
    rng = np.random.default_rng(0)
    noise = np.convolve(rng.normal(size=20_000), np.hanning(9), "valid")
    amplitude, frequency = amplitude_and_frequency(noise, 2000.0)
    assert amplitude == pytest.approx(np.sqrt(2.0) * noise.std(), rel=0.01)
    crossings = np.count_nonzero(np.diff(np.signbit(noise)))
    assert frequency == pytest.approx(crossings / (2.0 * len(noise) / 2000.0), rel=0.03)


@pytest.mark.parametrize("speed", [0.02, 0.1])
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 4.0])
@pytest.mark.parametrize("wavelength", [0.37e-3, 0.731e-3, 1.3e-3])
def test_each_step_of_a_stroke_over_a_grating_has_its_amplitude_and_frequency(
    speed: float, angle: float, wavelength: float
) -> None:
    field = grating(wavelength)
    texture = SurfaceTexture(field, None, SurfaceRenderer.DIRECT)
    way = strokes.line((0.0, 0.0), angle, 12.0 * wavelength / np.cos(angle) + speed * 0.1, speed)
    signal = render_stroke(texture, way)
    expected = speed * np.cos(angle) / wavelength
    steps = slice(1, -1)  # all but the ends, where the finger starts and stops
    np.testing.assert_allclose(signal.frequency_hz[steps], expected, rtol=0.01)
    full = texture.device.amplitude_m_s2(1.0)
    np.testing.assert_allclose(
        signal.amplitude_m_s2[steps], texture.drive_per_m * 20e-6 * full, rtol=0.02
    )
