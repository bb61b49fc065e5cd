# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured actuators: drive for an amplitude, and imperceptible amplitudes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_synthetic import MODELS, at, make_device, make_header, make_run

from hfx_blender.devices.host.encoders import Channels
from hfx_blender.engine.rendering.conditioning.waveform import DriveCurve, drive_of, driven
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.formats.sound import wav

# Half drive yields a third of the output at 80 Hz, and two fifths of a larger output at 160 Hz.
CURVES = (
    DriveCurve(80.0, ((0.0, 0.0), (0.5, 2.0), (1.0, 6.0))),
    DriveCurve(160.0, ((0.0, 0.0), (0.5, 8.0), (1.0, 20.0))),
)


@pytest.mark.parametrize(
    ("amplitude", "hz", "drive"),
    [
        (0.0, 80.0, 0.0),
        (1.0, 80.0, 0.25),
        (2.0, 80.0, 0.5),
        (4.0, 80.0, 0.75),
        (9.0, 80.0, 1.0),  # beyond the maximum
        (4.0, 160.0, 0.25),
        (4.0, 120.0, 0.5),  # half way between 0.75 and 0.25
        (4.0, 20.0, 0.75),  # beyond: the nearest
        (4.0, 900.0, 0.25),
        (-1.0, 80.0, 0.0),
        (np.nan, 80.0, 0.0),
        (np.inf, 80.0, 0.0),
        (4.0, np.nan, 0.0),
    ],
)
def test_the_curve_is_inverted_by_hand(amplitude: float, hz: float, drive: float) -> None:
    assert drive_of(CURVES, np.array([amplitude]), np.array([hz]))[0] == pytest.approx(drive)


@given(st.floats(0.0, 6.0), st.sampled_from([80.0, 160.0]))
def test_the_drive_yields_the_requested_amplitude(amplitude: float, hz: float) -> None:
    (curve,) = (item for item in CURVES if item.frequency_hz == hz)
    drive = drive_of(CURVES, np.array(amplitude), np.array(hz))
    output = np.interp(drive, [x for x, _ in curve.points], [y for _, y in curve.points])
    assert output == pytest.approx(amplitude, abs=1e-9)


def test_sines_together_never_need_more_than_full_drive():
    amplitudes = np.array(
        [[3.0, 3.0], [3.0, 3.0]]
    )  # two sines at two channels, the first is measured
    total = np.broadcast_to(amplitudes.sum(axis=0), amplitudes.shape)
    actual = driven([CURVES, ()], amplitudes, np.full((2, 2), 80.0), 10.0, total)
    assert actual[:, 0].tolist() == [0.5, 0.5]  # 6 m/s^2 together are full drive
    assert actual[:, 1].tolist() == [0.3, 0.3]


def device(**kind: object) -> DeviceConfig:
    actual = make_device({"m": ("vibration", at(3))})
    changed = replace(actual.actuators[0].type, **kind)  # type: ignore[arg-type]
    return replace(
        actual,
        actuator_types={"vibration": changed},
        actuators=(replace(actual.actuators[0], type=changed),),
    )


def rendered(on: DeviceConfig, *effects: tuple[float, float]) -> Raster:
    """Render one second of effects with an amplitude and a frequency."""
    names = [f"e{k}" for k in range(len(effects))]
    header = make_header(dict.fromkeys(names, "vibration"), 100, rate_hz=Fraction(100))
    renderer = Renderer(header, on, lambda name: MODELS[name])
    samples = {i: {3: 1.0} for i in range(100)}
    renderer.add(
        [make_run(header, n, samples, item) for n, item in zip(names, effects, strict=True)]
    )
    return renderer.raster()


@pytest.mark.parametrize("wave", [False, True])
def test_a_wav_holds_the_drive_and_the_raster_the_output(wave: bool) -> None:
    on = device(drive=CURVES, takes_waveform=wave)
    raster = rendered(on, (4.0, 80.0))
    assert set(raster.values[:, 0]) == {4.0}
    assert _peak(on, raster) == pytest.approx(0.75, abs=1e-3)
    plain = device(takes_waveform=wave)
    assert _peak(plain, rendered(plain, (4.0, 80.0))) == pytest.approx(0.2, abs=1e-3)


def _peak(of: DeviceConfig, raster: Raster) -> float:
    return max(
        float(np.abs(block).max())
        for block in wav.waveforms(raster, wav.drives_of(raster, of), wav.RATE_HZ)
    )


def test_channels_of_a_port_hold_the_drive():
    channels = Channels(device(drive=CURVES))  # amplitude 0..20, frequency 50..250
    assert channels.fractions(channels.values(np.array([4.0, 80.0]))).tolist() == [0.75, 0.15]
    assert channels.fractions(channels.values(np.array([4.0, 160.0])))[0] == 0.25
    # A board without frequencies plays at the neutral 100 Hz, a quarter of the way to 160 Hz.
    strength_channels = Channels(device(drive=CURVES), strengths_only=True)
    assert strength_channels.fractions(
        strength_channels.values(np.array([4.0, 160.0]))
    ).tolist() == [0.625]
    plain = Channels(device())
    assert plain.fractions(plain.values(np.array([4.0, 80.0]))).tolist() == [0.2, 0.15]


def test_imperceptible_amplitudes_are_reported():
    on = device(thresholds=((100.0, 0.4), (200.0, 0.1)))
    raster = rendered(on, (0.24, 150.0), (0.26, 150.0))  # felt from 0.25 on
    assert [(s.effect_id, s.reason, s.samples) for s in raster.shortfalls] == [
        ("e0", "threshold", 100)
    ]
    assert raster.shortfalls[0].seconds == pytest.approx(1.0)
    assert not rendered(device(), (0.01, 150.0)).shortfalls
