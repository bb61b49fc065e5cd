# SPDX-License-Identifier: GPL-3.0-or-later
"""Strokes over gratings: rendered values equal arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from gratings import grating, uneven
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture import stroke as strokes
from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import MapSettings, make_map
from hfx_blender.engine.texture.stroke import Stroke
from hfx_blender.engine.texture.stroke_rendering import profile, render_stroke
from hfx_blender.engine.texture.textile import (
    drive_levels,
    receptor_weights,
    weighted_rms,
)
from hfx_blender.errors import InputError
from hfx_tools.bench.surfaces.collisions import trace

AMPLITUDE = 20e-6


def _frequency_and_amplitude(wave: np.ndarray, rate: float, near: float) -> tuple[float, float]:
    """Return the best sine by least squares and a frequency search, an independent estimator."""
    times = np.arange(len(wave)) / rate
    best = (np.inf, 0.0, 0.0)
    for frequency in near * np.linspace(0.98, 1.02, 401):
        phase = 2.0 * np.pi * frequency * times
        basis = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        actual, *_ = np.linalg.lstsq(basis, wave, rcond=None)
        error = float(np.square(wave - basis @ actual).sum())
        if error < best[0]:
            best = (error, frequency, float(np.hypot(*actual)))
    return best[1], best[2]


@pytest.mark.parametrize("speed", [0.02, 0.1])
@pytest.mark.parametrize("wavelength", [0.2e-3, 0.7e-3, 2e-3])
@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 4, 2.5])
def test_direct_synthesis_of_a_grating_is_a_sine(
    speed: float, wavelength: float, angle: float
) -> None:
    true = speed / wavelength * abs(np.cos(angle))
    stroke = strokes.line((1e-3, 2e-3), angle, 12.0 * speed / true, speed, 83.0)
    wave = profile(grating(wavelength), stroke, 8000.0)
    edge = len(wave) // 20
    frequency, amplitude = _frequency_and_amplitude(wave[edge:-edge], 8000.0, true)
    assert frequency == pytest.approx(true, rel=0.01)
    assert amplitude == pytest.approx(AMPLITUDE, rel=0.02)


def _slow_level(field: HeightField, stroke: Stroke, begin: float, rate: float) -> float:
    """Equations 1 to 5 as written in the paper, frequency by frequency."""
    n = round(0.05 * rate)
    heights = []
    for k in range(n):
        t = begin + (k + 0.5) / rate
        i = max(j for j in range(len(stroke.times_s)) if stroke.times_s[j] <= t + 1e-12)
        i = min(i, len(stroke.times_s) - 2)
        (t0, t1), (p0, p1) = stroke.times_s[i : i + 2], stroke.points_m[i : i + 2]
        heights.append(float(field.sample((p1 - p0) / (t1 - t0) * (t - t0) + p0)))
    z = np.array(heights) - np.mean(heights)
    total = 0.0
    for k in range(n):
        frequency = min(k, n - k) * rate / n
        f = sum(z[m] * np.exp(-2j * np.pi * k * m / n) for m in range(n)) / np.sqrt(n)
        weight = 1 / 6 if frequency < 10 else 0.5 if frequency < 40 else 1.0
        weight = weight if frequency < 800 else 0.0
        total += abs(weight * f) ** 2
    return float(np.sqrt(total / n))


def test_the_textile_renderer_equals_an_independent_computation() -> None:
    rng = np.random.default_rng(3)
    field = HeightField(rng.normal(size=(32, 32)) * 1e-5, (1e-4, 1.3e-4))
    even = strokes.line((0.0, 0.0), 0.7, 0.03, 0.1, 240.0)
    stroke = uneven(even, rng, (0.015, 0.07))
    levels = drive_levels(field, stroke, 1e4)
    assert len(levels) == 6
    for k, level in enumerate(levels):
        assert level == pytest.approx(1e4 * _slow_level(field, stroke, 0.05 * k, 2000.0), rel=1e-9)


def test_a_device_of_short_updates_plays_windows_of_the_paper_as_an_export_does() -> None:
    """Every 10 ms covers the 50 ms before; an export keeps this span of each contact's heights."""
    field = HeightField(np.random.default_rng(4).normal(size=(32, 32)) * 1e-5, (1e-4, 1e-4))
    stroke = strokes.line((0.0, 0.0), 0.4, 0.01, 0.1, 240.0)
    texture = SurfaceTexture(field, None, SurfaceRenderer.TEXTILE, 1e4)
    signal = render_stroke(texture, stroke, step_s=0.01)
    assert len(signal.amplitude_m_s2) == 10
    level = 1e4 * _slow_level(field, stroke, 0.08 - 0.05, 2000.0)
    full = float(texture.device.amplitude_m_s2(1.0))
    assert signal.amplitude_m_s2[7] == pytest.approx(level * full, rel=1e-9) and level < 1.0


def test_weights_are_those_of_equation_4() -> None:
    np.testing.assert_array_equal(
        receptor_weights([0.0, 9.9, 10.0, 39.9, 40.0, 799.9, 800.0]),
        [1 / 6, 1 / 6, 0.5, 0.5, 1.0, 1.0, 0.0],
    )


@pytest.mark.parametrize("frequency", [40.0, 47.0, 60.0, 110.0, 333.0, 555.0, 770.0, 780.0])
def test_the_level_of_a_sine_hardly_depends_on_its_phase(frequency: float) -> None:
    levels = []
    for phase in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        wave = np.sin(2.0 * np.pi * frequency * np.arange(100) / 2000.0 + phase)
        levels.append(float(weighted_rms(wave, 2000.0)))
    assert (max(levels) - min(levels)) / (max(levels) + min(levels)) <= 0.05


def test_with_all_weights_one_the_level_is_the_rms() -> None:
    wave = np.sin(2.0 * np.pi * 200.0 * np.arange(100) / 2000.0)  # ten whole periods
    assert weighted_rms(3.0 * wave, 2000.0) == pytest.approx(3.0 / np.sqrt(2.0))


@pytest.mark.parametrize("speed", [0.02, 0.1])
@pytest.mark.parametrize("angle", [0.0, np.pi / 4])
def test_micro_collisions_peak_twice_a_period(speed: float, angle: float) -> None:
    wavelength = 1e-3
    map_ = make_map(grating(wavelength, texels=128), settings=MapSettings(blur_m=1e-5))
    way = 10.0 * wavelength / np.cos(angle)
    actual = trace(map_, strokes.line((1.7e-5, 0.0), angle, way, speed))
    middle = 0.5 * actual.intensity.max()
    ups = np.count_nonzero((actual.intensity[1:] > middle) & (actual.intensity[:-1] <= middle))
    assert ups == pytest.approx(20, abs=1)


def _textures(seed: int = 0) -> list[SurfaceTexture]:
    rng = np.random.default_rng(seed)
    field = HeightField(rng.normal(size=(32, 32)) * 2e-5, (1e-4, 1e-4))
    map_ = make_map(field, rng.uniform(size=(8, 8)))
    return [SurfaceTexture(field, map_, renderer) for renderer in SurfaceRenderer]


@pytest.mark.parametrize("texture", _textures(), ids=lambda t: t.renderer.value)
def test_a_resting_finger_is_silent(texture: SurfaceTexture) -> None:
    rest = Stroke(np.linspace(0.0, 1.0, 30), np.tile([1.3e-3, 2.2e-3], (30, 1)))
    signal = render_stroke(texture, rest)
    assert not signal.amplitude_m_s2.any()
    assert not signal.waveform_m_s2.any()


@pytest.mark.parametrize("texture", _textures(), ids=lambda t: t.renderer.value)
def test_a_stroke_backwards_gives_the_mirrored_signal(texture: SurfaceTexture) -> None:
    stroke = uneven(
        strokes.line((1e-4, 3e-4), 0.4, 0.05, 0.05), np.random.default_rng(1), (0.01, 0.03)
    )
    assert stroke.duration_s == pytest.approx(1.0)
    start_s, end_s = stroke.times_s[[0, -1]]
    backwards = Stroke(start_s + (end_s - stroke.times_s[::-1]), stroke.points_m[::-1])
    if texture.renderer is SurfaceRenderer.DIRECT:
        assert texture.height is not None
        there = profile(texture.height, stroke, 8000.0)
        back = profile(texture.height, backwards, 8000.0)
        np.testing.assert_allclose(back[::-1], there, atol=1e-3 * np.abs(there).max())
        return
    there, back = (render_stroke(texture, s) for s in (stroke, backwards))
    np.testing.assert_allclose(back.amplitude_m_s2[::-1], there.amplitude_m_s2, rtol=1e-6)
    np.testing.assert_allclose(back.frequency_hz[::-1], there.frequency_hz, rtol=1e-6)


@pytest.mark.parametrize("renderer", list(SurfaceRenderer))
def test_turning_texture_and_way_together_changes_nothing(renderer: SurfaceRenderer) -> None:
    rng = np.random.default_rng(2)
    heights = rng.normal(size=(32, 32)) * 2e-5
    size = 32 * 1e-4
    signals = []
    for turned in (False, True):
        grid = np.rot90(heights) if turned else heights  # row 0 is below: clockwise there
        field = HeightField(grid, (1e-4, 1e-4))
        stroke = strokes.line((0.5 * size, 0.5 * size), 0.4, 0.02, 0.04)
        if turned:
            x, y = (stroke.points_m - 0.5 * size).T
            stroke = Stroke(stroke.times_s, np.column_stack((y, -x)) + 0.5 * size)
        texture = SurfaceTexture(field, make_map(field), renderer)
        signals.append(render_stroke(texture, stroke))
    np.testing.assert_allclose(
        signals[1].amplitude_m_s2, signals[0].amplitude_m_s2, rtol=1e-3, atol=1e-6
    )


@settings(max_examples=20, deadline=None)
@given(st.floats(0.005, 0.5), st.floats(0.0, 6.2))
def test_signals_are_finite_and_within_the_device(speed: float, angle: float) -> None:
    for texture in _textures(1):
        stroke = strokes.line((0.0, 0.0), angle, 0.2 * speed, speed, 60.0)
        signal = render_stroke(texture, stroke, waveform_rate_hz=2000.0)
        top = texture.device.amplitude_m_s2(1.0) * (1.0 + 1e-9)
        assert np.isfinite(signal.waveform_m_s2).all()
        assert np.abs(signal.waveform_m_s2).max() <= top
        assert ((signal.amplitude_m_s2 >= 0.0) & (signal.amplitude_m_s2 <= top)).all()
        assert len(signal.times_s) == len(signal.amplitude_m_s2) == len(signal.frequency_hz)


def test_the_carriers_phase_never_jumps() -> None:
    texture = _textures()[0]
    signal = render_stroke(texture, strokes.line((0.0, 0.0), 0.3, 0.05, 0.05))
    change = np.abs(np.diff(signal.waveform_m_s2, 1))
    steepest = 2.0 * np.pi * 260.0 / 8000.0 * signal.amplitude_m_s2.max()
    steps = np.abs(np.diff(signal.amplitude_m_s2)).max()
    assert change.max() <= steepest + steps


@pytest.mark.parametrize(
    "make",
    [
        lambda: Stroke(np.array([0.0]), np.zeros((1, 2))),
        lambda: Stroke(np.array([0.0, 0.0]), np.zeros((2, 2))),
        lambda: Stroke(np.array([0.0, 1.0]), np.array([[0.0, np.nan], [0.0, 0.0]])),
        lambda: Stroke(np.array([0.0, 1.0]), np.zeros((3, 2))),
        lambda: strokes.along(np.zeros((3, 2)), 0.1),
        lambda: strokes.along(np.eye(2), 0.0),
        lambda: strokes.along(np.eye(2), 0.1, float("nan")),
        lambda: render_stroke(_textures()[0], strokes.line((0, 0), 0, 1e-3, 0.1)),
        lambda: SurfaceTexture(renderer=SurfaceRenderer.TEXTILE),
        lambda: SurfaceTexture(renderer=SurfaceRenderer.MCHA),
    ],
)
def test_an_invalid_stroke_is_refused(make: object) -> None:
    with pytest.raises(InputError):
        make()  # type: ignore[operator]
