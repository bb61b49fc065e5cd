# SPDX-License-Identifier: GPL-3.0-or-later
"""Sine, square and noise: spectra, limits, and equality of blocks and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.tones import Tones
from hfx_blender.devices.transports.sound_card import Oscillators, SumOfTones
from hfx_blender.engine.rendering.conditioning import waveform
from hfx_blender.engine.rendering.conditioning.frequency import Partial
from hfx_blender.engine.rendering.conditioning.waveform import WAVEFORMS, Waveform, kinds_of, waves
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.formats.sound import wav

RATE = 48_000
CARD = load_device("sound_card_8")
KIND = CARD.actuators[0].type
MOST = KIND.strength.highest
TWO_HZ = 80.0, 250.0


def steady(shape: Waveform, hz: float, seconds: float = 1.0) -> np.ndarray:
    """Return a steady wave: one channel of amplitude 1, from phase 0."""
    time = np.arange(round(seconds * RATE))[:, None] / RATE
    one, same = np.ones(1), np.full(1, hz)
    return waves(kinds_of([shape]), (one, one), (same, same), 0.0 * time, hz * time, RATE)[:, 0]


def spectrum(samples: np.ndarray) -> np.ndarray:
    """Return amplitudes of sines at whole hertz, from one second."""
    return np.abs(np.fft.rfft(samples)) / (RATE / 2)


def test_a_square_has_the_odd_harmonics_of_fouriers_series():
    actual = spectrum(steady("square", 80.0))
    for harmonic in (1, 3, 5, 7):
        expected = 4.0 / np.pi / harmonic
        assert actual[80 * harmonic] == pytest.approx(expected, rel=1e-3)
        assert actual[80 * (harmonic + 1)] < 1e-6
    phase = np.angle(np.fft.rfft(steady("square", 80.0))[80])
    assert phase == pytest.approx(-np.pi / 2, abs=1e-6), "in phase with a sine"


def test_a_square_is_band_limited():
    """At 997 Hz, aliases are imperceptible; plain steps leave a hundredth below 1000 Hz."""
    actual = spectrum(steady("square", 997.0))
    alias = np.delete(actual[:1001], 997).max() / actual[997]
    assert alias < 1e-4
    time = np.arange(RATE) / RATE
    plain = spectrum(np.where(997.0 * time % 1.0 < 0.5, 1.0, -1.0))
    assert np.delete(plain[:1001], 997).max() / plain[997] > 30 * alias


def test_noise_is_a_band_about_its_frequency():
    samples = steady("noise", 100.0, 60.0)
    power = np.abs(np.fft.rfft(samples)) ** 2
    hz = np.fft.rfftfreq(len(samples), 1.0 / RATE)

    def share(low: float, high: float) -> float:
        return float(power[(hz >= low) & (hz < high)].sum() / power.sum())

    assert share(50, 150) > 0.9 and share(80, 120) == pytest.approx(0.5, abs=0.05)
    assert share(99.9, 100.1) < 0.05 and share(0, 10) < 1e-3
    # For independent sines fading by w = 3 s^2 - 2 s^3, the mean of (1 - w)^2 + w^2 is 26/35.
    assert (samples**2).mean() == pytest.approx(13 / 35, rel=0.02)


def test_noise_is_drawn_by_splitmix64():
    """First outputs for seed 0, as published for other implementations."""
    actual = [hex(int(component)) for component in waveform.split_mix(3)]
    assert actual == ["0xe220a8397b1dcdaf", "0x6e789e6aa1b965f4", "0x6c45d188009454f"]


def test_noise_continues_after_silence():
    cycles = waveform.NOISE_REPEATS + np.linspace(-0.01, 0.01, 2001)
    again = cycles % waveform.NOISE_REPEATS
    before, after = (waveform.noises(item, item) for item in (cycles, again))
    np.testing.assert_allclose(before, after, atol=1e-9)
    assert np.abs(np.diff(before)).max() < 2 * np.pi * 1e-5 * 2


hertz = st.floats(0.0, RATE / 2)


@given(
    st.sampled_from(WAVEFORMS),
    st.lists(st.tuples(st.floats(0.0, 1.0), hertz, st.integers(0, 400)), min_size=1, max_size=6),
)
@settings(deadline=None, max_examples=60)
def test_no_wave_exceeds_its_amplitude(shape, changes):
    oscillators = Oscillators([shape], RATE)
    before = 0.0
    for amplitude, hz, count in changes:
        oscillators.aim(np.array([amplitude]), np.array([hz]))
        actual = np.abs(oscillators.block(count))
        assert (actual <= max(before, amplitude) * (1.0 + 1e-12)).all()
        before = max(before, amplitude)


blocks = st.lists(st.integers(0, 700), min_size=1, max_size=8)


@given(st.sampled_from([["sine"], ["square"], ["noise"], ["noise", "sine", "square"]]), blocks)
@settings(deadline=None, max_examples=60)
def test_waves_are_equal_for_any_block_size(shapes, sizes):
    count, total = len(shapes), sum(sizes)

    def sound(parts: Sequence[int]) -> np.ndarray:
        tones, actual = SumOfTones(shapes, RATE), []
        for hz in (TWO_HZ, (90.0, 400.0)):
            pairs = np.array([0.4, 0.3]), np.array(hz)
            amplitudes, frequencies = (np.repeat(pair[:, None], count, axis=1) for pair in pairs)
            tones.aim(Tones(np.arange(2), amplitudes, frequencies))
            actual += [tones.block(part) for part in parts]
        return np.concatenate(actual)

    np.testing.assert_allclose(sound(sizes), sound([total]), atol=1e-8)


@pytest.mark.parametrize("shape", ["sine", "noise"])
def test_phase_goes_on_through_changes_of_frequency(shape):
    oscillators, parts = Oscillators([shape], RATE), []
    for hz in (80.0, 250.0, 31.0, 400.0):
        oscillators.aim(np.ones(1), np.array([hz]))
        parts.append(oscillators.block(1000))
    wave = np.concatenate(parts)[240:, 0]
    # A fade between two sines adds at most the fade's slope, 3/2 a cycle, times the difference.
    steepest = (2.0 * np.pi + (3.0 if shape == "noise" else 0.0)) * 400.0 / RATE
    assert np.abs(np.diff(wave)).max() <= 1.01 * steepest


def test_a_squares_edges_stay_half_a_cycle_apart_through_changes_of_frequency():
    oscillators, parts = Oscillators(["square"], RATE), []
    for hz in (100.0, 200.0, 100.0):
        oscillators.aim(np.ones(1), np.array([hz]))
        parts.append(oscillators.block(4800))
    wave = np.concatenate(parts)[240:, 0]
    apart = np.diff(np.flatnonzero(np.diff(np.signbit(wave))))
    assert apart.min() >= 119 and apart.max() <= 241


def with_waveforms(*shapes: Waveform) -> DeviceConfig:
    actuators = tuple(
        replace(item, type=replace(KIND, waveform=shape))
        for item, shape in zip(CARD.actuators, shapes, strict=False)
    )
    return replace(CARD, actuators=actuators)


def raster_of(device: DeviceConfig, partials: Sequence[Partial], rows: int, **other: Any) -> Raster:
    width = len(device.actuators)
    return Raster(
        device_id=device.id,
        body_id="body",
        actuators=tuple(a.id for a in device.actuators),
        columns=tuple(
            Column(a.id, c.name, a.type.unit(c)) for a in device.actuators for c in a.type.controls
        ),
        times_s=np.arange(rows) / 100.0,
        rate_hz=other.get("rate_hz", Fraction(100)),
        values=np.tile([0.0, 100.0], (rows, width)),
        neutral=np.tile([0.0, 100.0], width),
        shortfalls=(),
        felt=(),
        waveform_actuators=tuple(a.id for a in device.actuators),
        partials=tuple(partials),
    )


def constant(name: str, amplitude: float, hz: float, rows: int, width: int = 3) -> Partial:
    return Partial(name, 0, np.full((rows, width), amplitude), np.full((rows, width), hz))


def exported(device: DeviceConfig, raster: Raster) -> np.ndarray:
    return np.concatenate([*wav.waveforms(raster, wav.drives_of(raster, device), RATE)])


def test_a_wav_holds_the_wave_that_a_card_plays() -> None:
    """A steady tone is equal in both, sample for sample."""
    device = with_waveforms("square", "noise", "sine")
    tones = SumOfTones([a.type.waveform for a in device.actuators], RATE)
    pairs = ((0.5, 80.0), (0.3, 250.0))
    tones.aim(
        Tones(
            np.arange(2),
            np.array([[a] * 3 for a, _ in pairs]),
            np.array([[hz] * 3 for _, hz in pairs]),
        )
    )
    live = tones.block(RATE // 2)[479:]
    raster = raster_of(device, [constant(str(hz), a * MOST, hz, 60) for a, hz in pairs], 60)
    actual = exported(device, raster)[480 : RATE // 2 + 1]
    # The card fades in from silence before the first sample; the file starts with phase 0.
    np.testing.assert_allclose(live, actual, atol=1e-6)


def test_a_wav_of_any_waveform_keeps_the_limit_for_any_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = with_waveforms("square", "noise", "sine")
    random = np.random.default_rng(4)
    shares = random.dirichlet([1.0, 1.0], (12, 3)) * MOST  # together the limit, always
    partials = [
        Partial(str(k), 0, shares[..., k], random.uniform(20.0, 500.0, (12, 3))) for k in range(2)
    ]
    for rate_hz in (Fraction(100), Fraction(30000, 1001)):
        raster = raster_of(device, partials, 12, rate_hz=rate_hz)
        whole = exported(device, raster)
        assert np.abs(whole).max() <= 1.0 + 1e-6
        assert np.abs(whole[:, 0]).max() > 0.99
        for block in (1, 2500):
            monkeypatch.setattr(wav, "BLOCK_SAMPLES", block)
            again = exported(device, raster)
            monkeypatch.undo()
            assert (again == whole).all()


def test_a_squares_fundamental_in_a_wav_is_four_over_pi_of_its_amplitude() -> None:
    device = with_waveforms("square", "noise", "sine")
    raster = raster_of(device, [constant("hum", 0.6 * MOST, 80.0, 110)], 110)
    actual = exported(device, raster)[:RATE]
    assert spectrum(actual[:, 0])[80] == pytest.approx(0.6 * 4.0 / np.pi, rel=1e-3)
    assert spectrum(actual[:, 2])[80] == pytest.approx(0.6, rel=1e-3)
    assert np.abs(actual[:, 0]).max() == pytest.approx(0.6)
