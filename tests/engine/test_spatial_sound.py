# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound, by arithmetic: distance, power, silence, independent reverberators, step."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from hfx_blender.errors import UsageError
from hfx_blender.formats.sound import wav
from hfx_tools.spatial_sound import sound_file
from hfx_tools.spatial_sound.hearing import (
    Hearing,
    absorption_db_m,
    doppler_hz,
)
from hfx_tools.spatial_sound.loudspeakers import (
    LAYOUTS,
    SCHEMES,
    LoudspeakerLayout,
    Panner,
    Scheme,
    parse,
)
from hfx_tools.spatial_sound.spatial_mix import Reverberators, SoundSource, SpatialMix

RASTER_HZ = Fraction(100)
RATE_HZ = 8000
HEARING = Hearing(reference_m=2.0, audible_m=8.0)
CASES = [
    (name, scheme)
    for name, layout in LAYOUTS.items()
    for scheme in SCHEMES
    if layout.is_flat or scheme == "vbap"
]


def _circle(radius_m: float, count: int = 721, height_m: float = 0.0) -> np.ndarray:
    turn = np.linspace(-np.pi, np.pi, count)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1) * radius_m
    ring[:, 2] = height_m
    return ring


def _source(places: np.ndarray, amplitude: float = 0.5, hz: float = 440.0) -> SoundSource:
    count = len(places)
    return SoundSource("it", places, np.full(count, amplitude), np.full(count, hz))


def _sound(
    sources: list[SoundSource], layout: LoudspeakerLayout, count: int, block: int = 4096
) -> np.ndarray:
    panner = Panner(layout, HEARING)
    wet = Reverberators(len(layout), RATE_HZ, 0.3, block)
    mix = SpatialMix(sources, panner, wet, RASTER_HZ, RATE_HZ)
    return np.concatenate(list(mix.blocks(count)))


def test_dry_and_wet_are_equal_at_the_reference_distance_and_go_over_without_a_step() -> None:
    dry, wet = HEARING.gains(np.array([0.0, 2.0, 4.0, 6.0]))
    np.testing.assert_allclose(dry, [1.0, np.sqrt(0.5), 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(wet, [0.0, np.sqrt(0.5), 1.0, 1.0], atol=1e-12)
    distances = np.linspace(0.0, 9.0, 9001)
    dry, wet = HEARING.gains(distances)
    # The steepest is the fade at the radius of silence: 1 over 0.8 m.
    assert np.abs(np.diff([dry, wet])).max() <= 1.01 * 0.001 / 0.8
    near = distances <= 7.2
    np.testing.assert_allclose(dry[near] ** 2 + wet[near] ** 2, 1.0, atol=1e-12)


@pytest.mark.parametrize("name, scheme", CASES)
@pytest.mark.parametrize("radius_m", [0.2, 1.0, 2.0, 5.0])
def test_power_is_constant_along_a_circle(name: str, scheme: Scheme, radius_m: float) -> None:
    layout = LAYOUTS[name]
    panner = Panner(layout, HEARING, scheme)
    dry, wet = panner.gains(_circle(radius_m))
    passed = np.square(Reverberators(len(layout), RATE_HZ, 0.3).impulses).sum()
    power = np.square(dry).sum(axis=1) + np.square(wet) * passed
    assert np.ptp(10.0 * np.log10(power)) <= 0.1
    assert power[0] == pytest.approx(1.0, abs=1e-9)


def _powers_db(name: str, places: np.ndarray) -> np.ndarray:
    """Power of still tones from 60 to 500 Hz, one per position, in each loudspeaker, (n, C).

    In dB of full scale, after the onset of the reverberation.
    """
    hz = np.linspace(60, 500, len(places)).round()
    sources = [_source(np.tile(p, (160, 1)), 1.0, f) for p, f in zip(places, hz, strict=True)]
    sound = _sound(sources, LAYOUTS[name], 160 * 80)[-8000:]
    tones = np.abs(np.fft.rfft(sound, axis=0)[hz.astype(int)]) / 4000.0
    return 20.0 * np.log10(tones + 1e-9)


@pytest.mark.parametrize("name", ["stereo", "5.0", "ring8", "cube8"])
def test_a_tone_has_the_same_power_at_every_distance_within_the_crossfade(name: str) -> None:
    rng = np.random.default_rng(4)
    ways = rng.normal(size=(45, 3)) * (1.0, 1.0, 0.0 if LAYOUTS[name].is_flat else 1.0)
    distances = np.linspace(0.1, 6.0, 45)[rng.permutation(45), None]
    powers_db = _powers_db(name, ways / np.linalg.norm(ways, axis=1, keepdims=True) * distances)
    assert np.abs(10.0 * np.log10((10.0 ** (powers_db / 10.0)).sum(axis=1))).max() < 0.5
    far = distances[:, 0] >= 4.0
    assert np.ptp(powers_db[far], axis=1).max() < 0.5, "diffuse sound comes from all alike"


def test_air_swallows_high_frequencies_as_the_standard_says() -> None:
    """Table of ISO 9613-1 for 20 degC and 50 %, dB per kilometre."""
    actual = 1000.0 * absorption_db_m(np.array([250.0, 1000.0, 4000.0, 8000.0]))
    np.testing.assert_allclose(actual, [1.31, 4.66, 29.4, 104.0], rtol=0.02)
    wet = Reverberators(2, RATE_HZ, 0.3)
    loud = []
    for air in (0.0, 100.0):
        panner = Panner(LAYOUTS["stereo"], Hearing(air=air))
        source = _source(np.tile([6.0, 0.0, 0.0], (100, 1)), 1.0, 1000.0)
        mix = SpatialMix([source], panner, wet, RASTER_HZ, RATE_HZ)
        loud.append(np.square(np.concatenate(list(mix.blocks(8000)))[-2000:]).sum())
    assert 10.0 * np.log10(loud[0] / loud[1]) == pytest.approx(100.0 * 6.0 * 4.66e-3, abs=0.1)


def test_pitch_rises_as_a_source_comes_nearer() -> None:
    hz, nearer = np.full(50, 440.0), 10.0 - 0.1 * np.arange(50)  # 10 m/s at 100 Hz
    np.testing.assert_allclose(doppler_hz(hz, nearer, 100.0), 440.0 * 343.2 / 333.2, rtol=1e-9)
    np.testing.assert_allclose(doppler_hz(hz, nearer[::-1], 100.0), 440.0 * 343.2 / 353.2)
    jump = np.where(np.arange(50) < 25, 1.0, 7.0)
    np.testing.assert_allclose(doppler_hz(hz, jump, 100.0), 440.0)
    panner = Panner(LAYOUTS["stereo"], Hearing(with_doppler=True))
    places = np.stack([7.0 - 0.1 * np.arange(60), np.zeros(60), np.zeros(60)], axis=1)
    mix = SpatialMix([_source(places)], panner, Reverberators(2, RATE_HZ, 0.3), RASTER_HZ, RATE_HZ)
    sound = np.concatenate(list(mix.blocks(60 * 80)))[-2400:, 0]
    rises = np.flatnonzero((sound[:-1] < 0) & (sound[1:] >= 0))
    heard = RATE_HZ * (len(rises) - 1) / (rises[-1] - rises[0])
    assert heard == pytest.approx(440.0 * 343.2 / 333.2, rel=3e-3)


@pytest.mark.parametrize("name, scheme", CASES)
def test_a_source_that_flies_through_the_listener_never_jumps(name: str, scheme: Scheme) -> None:
    line = np.linspace([-1.5, 0.01, 0.0], [1.5, -0.01, 0.0], 3001)
    dry, _ = Panner(LAYOUTS[name], HEARING, scheme).gains(line)
    assert np.abs(np.diff(dry, axis=0)).max() < 0.04


def test_a_source_at_a_loudspeaker_plays_there_only() -> None:
    for layout in LAYOUTS.values():
        places = np.zeros((len(layout), 3))
        places[:, : layout.directions.shape[1]] = layout.directions
        dry, _ = Panner(layout, HEARING).gains(places)
        np.testing.assert_allclose(dry, np.eye(len(layout)) * np.cos(np.pi / 8), atol=1e-6)


def test_a_distant_or_missing_source_is_silent() -> None:
    places = np.array([[8.0, 0.0, 0.0], [0.0, -50.0, 3.0], [np.nan, 0.0, 0.0]])
    dry, wet = Panner(LAYOUTS["quad"], HEARING).gains(places)
    assert not dry.any() and not wet.any()
    far = _sound([_source(_circle(8.5, 100))], LAYOUTS["quad"], 100 * 80)
    assert not far.any()
    assert _sound([_source(_circle(7.0, 100))], LAYOUTS["quad"], 100 * 80).any()


def test_reverberators_of_different_channels_are_independent() -> None:
    impulses = Reverberators(8, 48_000).impulses
    unit = impulses / np.linalg.norm(impulses, axis=1, keepdims=True)
    alike = np.abs(unit @ unit.T - np.eye(8))
    assert alike.max() < 0.05
    # Uncorrelated at any delay: white noise of n samples gives about 1 / sqrt(n).
    both = np.fft.irfft(np.fft.rfft(unit[0], 1 << 18) * np.conj(np.fft.rfft(unit[1], 1 << 18)))
    assert np.abs(both).max() < 0.05


def test_blocks_do_not_change_the_reverberation() -> None:
    rng = np.random.default_rng(3)
    signal = rng.normal(size=4096)
    impulses = Reverberators(2, RATE_HZ, 0.2).impulses
    whole = np.stack([np.convolve(signal, impulse)[:4096] for impulse in impulses], axis=1)
    for block in (256, 1024, 4096):
        wet = Reverberators(2, RATE_HZ, 0.2, block)
        parts = [wet.process(signal[k : k + block]) for k in range(0, 4096, block)]
        np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-9)


def test_blocks_do_not_change_the_sound_and_never_click() -> None:
    sources = [_source(_circle(1.0, 60)), _source(_circle(3.0, 60), hz=660.0)]
    first = _sound(sources, LAYOUTS["5.0"], 60 * 80, 4096)
    second = _sound(sources, LAYOUTS["5.0"], 60 * 80, 512)
    np.testing.assert_allclose(first, second, atol=1e-9)
    near = _sound([_source(np.tile([0.0, 0.0, 0.0], (60, 1)), 1.0)], LAYOUTS["stereo"], 60 * 80)
    # All dry, from both: a sine of 1 / sqrt(2), with the sine's slope as the steepest step.
    steepest = 2.0 * np.pi * 440.0 / RATE_HZ / np.sqrt(2.0)
    assert np.abs(np.diff(near[:-80], axis=0)).max() <= steepest
    assert np.abs(near).max() == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_the_file_is_read_by_others_and_is_as_long_as_the_raster(tmp_path: Path) -> None:
    layout, rows = LAYOUTS["ring8"], 37
    count = wav.sample_count(rows, RASTER_HZ)
    assert count == rows * 480
    panner = Panner(layout, HEARING)

    def blocks():  # type: ignore[no-untyped-def]
        wet = Reverberators(len(layout), 48_000)
        sources = [_source(_circle(0.6, rows), 2.0), _source(_circle(0.5, rows), 2.0)]
        return SpatialMix(sources, panner, wet, RASTER_HZ, 48_000).blocks(count)

    path = tmp_path / "belt.sound.wav"
    gain = sound_file.write_sound(blocks, layout, path, count=count, start_s=1.5)
    assert gain < 1.0
    rate, read = wavfile.read(path)
    assert rate == 48_000 and read.shape == (count, 8)
    expected = np.concatenate(list(blocks())) * gain
    np.testing.assert_allclose(read / 2**31, expected, atol=2.0**-21)
    assert np.abs(expected).max() == pytest.approx(0.98)
    sidecar = json.loads((tmp_path / "belt.sound.wav.channels.json").read_text())
    assert [channel["azimuth_deg"] for channel in sidecar["channels"]] == [
        45.0 * k for k in range(8)
    ]
    assert sidecar["start_s"] == 1.5


def test_odd_sizes_are_padded(tmp_path: Path) -> None:
    """3 channels of 5 samples of 24 bits are 45 bytes; RIFF chunks have even sizes."""
    path, silence = tmp_path / "x.sound.wav", np.zeros((5, 3))
    sound_file.write_sound(lambda: iter([silence]), parse("30,-30,110"), path, count=5, start_s=0.0)
    content = path.read_bytes()
    assert len(content) % 2 == 0 and int.from_bytes(content[4:8], "little") == len(content) - 8
    assert wavfile.read(path)[1].shape == (5, 3)


def test_layouts_are_named_or_given_as_angles() -> None:
    assert parse("quad") is LAYOUTS["quad"]
    actual = parse("30,-30,110:20,-110:20")
    assert actual.azimuths_deg == (30.0, -30.0, 110.0, -110.0)
    assert actual.elevations_deg == (0.0, 0.0, 20.0, 20.0)
    for text in ("", "sixty", "30", "400,0", "0:99,30", "nan,0", "20,20"):
        with pytest.raises(UsageError, match="loudspeakers"):
            parse(text)
    with pytest.raises(UsageError, match="flat"):
        Panner(LAYOUTS["cube8"], HEARING, "ring")
