# SPDX-License-Identifier: GPL-3.0-or-later
"""Sounds with known envelopes and onsets become vibration that follows them."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy import signal as filters
from scipy.io import wavfile

from hfx_blender.engine.arrays import F64
from hfx_blender.errors import InputError, UsageError
from hfx_blender.files.limits import TooLargeError
from hfx_blender.formats.files import read_signals
from hfx_blender.formats.signals.signals import FrequencyRange, Signal
from hfx_blender.formats.sound.sound_analysis import SoundSettings, followed
from hfx_tools.commands.conversion import convert

RATES = (8000, 44_100)
SECONDS = 3.0


def follow(sound: F64, rate: int, **settings: object) -> Signal:
    columns = sound.reshape(len(sound), -1).astype(np.float32)
    return followed([columns], rate, "sound", SoundSettings(**settings))  # type: ignore[arg-type]


@pytest.mark.parametrize("pitch", [60.0, 100.0, 150.0, 250.0])
def test_the_pitch_of_a_tone_is_mapped_to_the_device(pitch: float) -> None:
    tone = np.sin(2.0 * np.pi * pitch * times(44_100))
    # The logarithm of the sound's 20 to 8000 Hz, over the device's 65 to 300 Hz.
    expected = 65.0 + (300.0 - 65.0) * np.log(pitch / 20.0) / np.log(8000.0 / 20.0)
    assert follow(tone, 44_100).frequency_hz.at(1.5) == pytest.approx(expected, rel=0.01)
    assert SoundSettings().vibration_hz(pitch) == pytest.approx(expected)


def times(rate: int, seconds: float = SECONDS) -> F64:
    return np.arange(int(seconds * rate)) / rate


def with_envelopes(rate: int) -> dict[str, tuple[F64, F64]]:
    """Sounds and their envelopes: noise, tones, glides and voices, modulated."""
    t, random = times(rate), np.random.default_rng(46)
    sounds = {}
    for hertz in (1.0, 2.0, 3.0, 5.0, 7.0):
        swell = 0.5 - 0.5 * np.cos(2.0 * np.pi * hertz * t)
        sounds[f"noise {hertz}"] = random.standard_normal(len(t)) * 0.25, swell
    for hertz in (30.0, 60.0, 180.0, 900.0, 3000.0):
        steps = np.interp(t, [0.0, 0.5, 1.0, 2.0, 3.0], [0.1, 1.0, 0.3, 0.8, 0.0])
        sounds[f"tone {hertz}"] = np.sin(2.0 * np.pi * hertz * t), steps
    for low, high in ((40.0, 3000.0), (3000.0, 60.0), (80.0, 250.0), (250.0, 30.0)):
        swell = np.interp(t, [0.0, 1.0, 1.5, 3.0], [0.0, 1.0, 0.4, 0.9])
        sounds[f"glide {low}"] = filters.chirp(t, low, SECONDS, high, "logarithmic"), swell
    for pitch in (95.0, 140.0, 220.0):
        syllables = np.abs(np.sin(2.0 * np.pi * 2.0 * t)) * np.interp(t, [0.0, 3.0], [1.0, 0.3])
        phase = 2.0 * np.pi * np.cumsum(pitch * (1.0 + 0.04 * np.sin(9.0 * t))) / rate
        voice = sum(np.sin(k * phase) / k for k in range(1, int(3000.0 / pitch)))
        sounds[f"voice {pitch}"] = np.asarray(voice) * 0.4, syllables
    return {name: (sound * shape, shape) for name, (sound, shape) in sounds.items()}


def with_onsets(rate: int) -> dict[str, tuple[F64, F64]]:
    """Sounds and the times of their onsets: clicks in noise, decaying notes, bursts."""
    t, random = times(rate), np.random.default_rng(64)
    sounds = {}
    for level_db in (-12.0, -20.0, -30.0):
        starts = np.cumsum(random.uniform(0.2, 0.45, 6))
        sound = 10.0 ** (level_db / 20.0) * 0.3 * random.standard_normal(len(t))
        for start in starts:
            click = np.exp(-np.arange(int(0.012 * rate)) / rate / 0.003)
            first = int(start * rate)
            sound[first : first + len(click)] += click * random.standard_normal(len(click))
        sounds[f"clicks {level_db}"] = sound, starts
    for hertz, decay_s in ((60.0, 0.1), (160.0, 0.15), (440.0, 0.08), (2500.0, 0.06)):
        starts = np.arange(0.2, 2.8, 0.45)
        after = np.maximum(t[:, None] - starts, 0.0)
        notes = np.exp(-after / decay_s) * np.sin(2.0 * np.pi * hertz * after)
        sounds[f"notes {hertz}"] = notes.sum(1), starts
    for hertz in (80.0, 300.0, 1000.0):
        starts = np.array([0.4, 1.1, 2.0])
        is_on = ((t[:, None] >= starts) & (t[:, None] < starts + 0.3)).any(1)
        sounds[f"bursts {hertz}"] = is_on * np.sin(2.0 * np.pi * hertz * t), starts
    return sounds


def steady(rate: int) -> dict[str, F64]:
    """Forty sounds without onsets: tones, chords, and noise of three colours."""
    t, random = times(rate), np.random.default_rng(4)
    tones = (20, 25, 32, 40, 55, 80, 100, 144, 200, 250, 333, 440, 700, 1000, 1700, 2500, 3300)
    sounds = {f"sine {hertz}": np.sin(2.0 * np.pi * hertz * t) for hertz in tones}
    for hertz in (25, 40, 60, 110, 220, 440):
        sounds[f"saw {hertz}"] = 0.7 * filters.sawtooth(2.0 * np.pi * hertz * t)
        sounds[f"square {hertz}"] = 0.7 * filters.square(2.0 * np.pi * hertz * t)
    for hertz in (60, 200):
        beat = 0.5 * np.sin(2.0 * np.pi * hertz * t) + 0.4 * np.sin(2.0 * np.pi * (hertz + 3) * t)
        sounds[f"beat {hertz}"] = beat
    sounds["vibrato"] = np.sin(2.0 * np.pi * 440.0 * t + 1.3 * np.sin(2.0 * np.pi * 6.0 * t))
    sounds["clipped"] = np.clip(3.0 * np.sin(2.0 * np.pi * 150.0 * t), -1.0, 1.0)
    hertz = np.maximum(np.fft.rfftfreq(len(t), 1.0 / rate), 1.0)
    for slope in (0.0, 0.5, 1.0):
        for number in range(3):
            spectrum = np.fft.rfft(random.standard_normal(len(t))) / hertz**slope
            noise = np.fft.irfft(spectrum * (hertz > 15.0), len(t))
            sounds[f"noise {slope} {number}"] = noise / np.abs(noise).max()
    assert len(sounds) >= 40
    return sounds


@pytest.mark.parametrize("rate", RATES)
def test_envelopes_are_those_that_the_sounds_were_made_with(rate: int) -> None:
    at = np.arange(0.0, SECONDS, 0.004)
    for name, (sound, envelope) in with_envelopes(rate).items():
        followed_by = follow(sound, rate).amplitude.at(at)
        expected = np.interp(at, times(rate), envelope)
        assert np.corrcoef(followed_by, expected)[0, 1] >= 0.95, name


@pytest.mark.parametrize("rate", RATES)
def test_onsets_are_within_ten_milliseconds_and_no_others(rate: int) -> None:
    for name, (sound, starts) in with_onsets(rate).items():
        found = np.array([tick.time_s for tick in follow(sound, rate).transients])
        assert len(found) == len(starts), name
        assert np.abs(found - starts).max() <= 0.01, name


@pytest.mark.parametrize("rate", RATES)
def test_steady_sounds_have_no_transients(rate: int) -> None:
    false = [name for name, sound in steady(rate).items() if follow(sound, rate).transients]
    assert not false


@pytest.mark.parametrize("low", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("jump_s", [1.3, 2.0, 2.5])
@pytest.mark.parametrize("hertz", [100.0, 400.0, 1000.0])
def test_a_quiet_tone_has_no_onset_a_second_before_a_loud_one(
    hertz: float, jump_s: float, low: float
) -> None:
    t = times(8000, 4.0)
    sound = np.where(t < jump_s, low, 1.0) * np.sin(2.0 * np.pi * hertz * t)
    found = [transient.time_s for transient in follow(sound, 8000).transients]
    assert found == pytest.approx([jump_s], abs=0.01)


def hits(rate: int, starts: F64, hertz: float, decay_s: float) -> F64:
    """Decaying sines that begin at given times, 4 s."""
    after = times(rate, 4.0)[:, None] - starts
    waves = np.exp(-np.maximum(after, 0.0) / decay_s) * np.sin(2.0 * np.pi * hertz * after)
    return np.where(after >= 0.0, waves, 0.0).sum(1)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("hertz", "decay_s"), ((55.0, 0.07), (55.0, 0.1), (70.0, 0.1), (90.0, 0.15))
)
def test_kicks_that_ring_for_long_are_found(rate: int, hertz: float, decay_s: float) -> None:
    starts = np.array([0.4, 0.9, 1.35, 1.9, 2.2, 2.8, 3.3])
    found = np.array(
        [t.time_s for t in follow(hits(rate, starts, hertz, decay_s), rate).transients]
    )
    assert len(found) == len(starts) and np.abs(found - starts).max() <= 0.01


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("hertz", "decay_s", "gap_s"),
    (
        (180.0, 0.03, 0.125),
        (100.0, 0.03, 0.125),
        (180.0, 0.03, 0.11),
        (90.0, 0.03, 0.1),
        (140.0, 0.03, 0.08),
        (200.0, 0.03, 0.08),
        (500.0, 0.03, 0.08),
        (500.0, 0.015, 0.06),
        (200.0, 0.02, 0.06),
        (150.0, 0.03, 0.06),
        (1000.0, 0.03, 0.06),
        (40.0, 0.005, 0.12),
        (40.0, 0.06, 0.3),
    ),
)
def test_regular_fast_beats_are_found(
    rate: int, hertz: float, decay_s: float, gap_s: float
) -> None:
    starts = np.arange(0.5, 3.4, gap_s)
    found = np.array(
        [t.time_s for t in follow(hits(rate, starts, hertz, decay_s), rate).transients]
    )
    assert len(found) == len(starts) and np.abs(found - starts).max() <= 0.01


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("rise", ("exponential", "sine"))
@pytest.mark.parametrize("decay_s", (0.03, 0.05))
@pytest.mark.parametrize("hertz", (40.0, 45.0, 50.0, 55.0))
def test_low_kicks_that_begin_softly_are_found(
    rate: int, hertz: float, decay_s: float, rise: str
) -> None:
    """Attacks of 1 - exp(-t / 4 ms), and of sin² over 8 ms."""
    starts, t = 0.3 + 0.3 * np.arange(12), times(rate, 4.2)
    after = np.maximum(t[:, None] - starts, 0.0)
    soft = np.sin(np.pi / 2.0 * np.minimum(after / 0.008, 1.0)) ** 2
    attack = soft if rise == "sine" else 1.0 - np.exp(-after / 0.004)
    kicks = attack * np.exp(-after / decay_s) * np.sin(2.0 * np.pi * hertz * after)
    found = np.array([tick.time_s for tick in follow(kicks.sum(1), rate).transients])
    assert len(found) == len(starts) and np.abs(found - starts).max() <= 0.01


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(("hertz", "decay_s"), ((200.0, 0.03), (1000.0, 0.2)))
def test_pulses_begin_with_the_notes(rate: int, hertz: float, decay_s: float) -> None:
    starts = np.cumsum(np.random.default_rng(1).uniform(0.25, 0.5, 8))
    ticks = follow(hits(rate, starts, hertz, decay_s), rate).transients
    early = np.array([tick.time_s for tick in ticks]) - starts
    assert abs(np.median(early)) <= 0.0012 and np.abs(early).max() <= 0.0025


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("hertz", "gap_s"), ((90.0, 0.1), (140.0, 0.08), (200.0, 0.08), (1000.0, 0.08), (None, 0.08))
)
def test_the_envelope_follows_fast_beats(rate: int, hertz: float | None, gap_s: float) -> None:
    """Decays of 30 ms, of 20 ms for noise (None), that begin at once."""
    starts, t = np.arange(0.5, 3.4, gap_s), times(rate, 4.0)
    after = t - starts[np.searchsorted(starts, t, "right").clip(1) - 1]
    decay_s = 0.03 if hertz else 0.02
    envelope = np.where(after >= 0.0, np.exp(-after.clip(0.0) / decay_s), 0.0)
    noise = 0.2 * np.random.default_rng(8).standard_normal(len(t))
    sound = envelope * (noise if hertz is None else np.sin(2.0 * np.pi * hertz * after))
    at = np.arange(0.3, 3.6, 0.004)
    actual = follow(sound, rate).amplitude.at(at)
    assert np.corrcoef(actual, np.interp(at, t, envelope))[0, 1] >= 0.95


@pytest.mark.parametrize("hertz", (200.0, 440.0, 660.0, 1000.0, 2000.0, 3000.0))
@pytest.mark.parametrize("samples", (1, 5, 10, 20))
def test_a_gap_in_a_tone_is_no_onset(hertz: float, samples: int) -> None:
    tone = np.sin(2.0 * np.pi * hertz * times(8000, 2.0))
    tone[4007 : 4007 + samples] = np.nan
    assert not follow(tone, 8000).transients


def test_a_drifting_offset_is_silent() -> None:
    drift = np.linspace(0.0, 0.5, 16_000)
    signal = follow(drift, 8000)
    assert not signal.transients and not signal.amplitude.values.any()
    tone = 0.3 * np.sin(2.0 * np.pi * 100.0 * times(8000, 2.0))
    assert not follow(tone + drift, 8000).transients


def test_impulses_of_one_sample_in_noise() -> None:
    """An impulse is spread over all bands, so it rises by little in each of them."""
    t, random = times(44_100), np.random.default_rng(64)
    starts = np.cumsum(random.uniform(0.2, 0.45, 6))
    sound = 0.02 * random.standard_normal(len(t))
    sound[(starts * 44_100).astype(int)] += 1.0
    found = np.array([tick.time_s for tick in follow(sound, 44_100).transients])
    assert len(found) == 6 and np.abs(found - starts).max() <= 0.01


def test_a_file_that_begins_with_a_beat_begins_with_a_transient() -> None:
    t = times(44_100, 1.0)
    signal = follow(np.exp(-t / 0.05) * np.sin(2.0 * np.pi * 200.0 * t), 44_100)
    assert [tick.time_s < 0.01 for tick in signal.transients] == [True]


@pytest.mark.parametrize("decay_s", (0.05, 0.2, 0.5, 0.8, 1.2, 3.0))
@pytest.mark.parametrize("start_s", (0.0, 0.01, 0.03))
@pytest.mark.parametrize("harmonics", (1, 3))
def test_a_note_at_the_start_of_a_file_is_an_onset_however_long_it_rings(
    decay_s: float, start_s: float, harmonics: int
) -> None:
    after = times(44_100) - start_s
    waves = [np.sin(2.0 * np.pi * 330.0 * k * after) / k for k in range(1, harmonics + 1)]
    note = np.where(after >= 0.0, np.exp(-after.clip(0.0) / decay_s) * sum(waves), 0.0)
    (tick,) = follow(note, 44_100).transients
    assert tick.time_s == pytest.approx(start_s, abs=0.01)


@pytest.mark.parametrize("hertz", (0.2, 0.5, 2.0, 5.0))
def test_a_modulated_tone_that_is_cut_while_it_falls_has_no_onset(hertz: float) -> None:
    t = times(8000, 6.0)
    swell = 0.6 + 0.4 * np.cos(2.0 * np.pi * hertz * t)
    assert not follow(swell * np.sin(2.0 * np.pi * 300.0 * t), 8000).transients


@pytest.mark.parametrize("rate", RATES)
def test_a_constant_offset_is_silence(rate: int) -> None:
    signal = follow(np.full(2 * rate, 0.5), rate)
    assert not signal.transients and not signal.amplitude.values.any()
    assert not follow(0.5 + 0.4 * np.sin(2.0 * np.pi * 200.0 * times(rate)), rate).transients


@pytest.mark.parametrize(("swell", "hertz"), ((4.0, 60.0), (4.0, 250.0), (8.0, 2000.0)))
def test_the_cut_of_a_tone_is_no_onset(swell: float, hertz: float) -> None:
    t = times(8000, 4.0)
    sound = (0.5 + 0.45 * np.sin(2.0 * np.pi * swell * t)) * np.sin(2.0 * np.pi * hertz * t)
    assert not follow(sound, 8000).transients


def test_a_click_shortly_before_the_end_is_an_onset() -> None:
    sound = np.zeros(16_000)
    sound[15_840:] = np.exp(-np.arange(160) / 24.0) * np.cos(np.arange(160))
    (tick,) = follow(sound, 8000).transients
    assert tick.time_s == pytest.approx(1.98, abs=0.01)


def test_a_gap_of_samples_that_are_not_finite_is_bridged() -> None:
    """A gap of 1.25 ms in a note is no onset; one of 0.2 s is silent."""
    tone = np.sin(2.0 * np.pi * 200.0 * times(8000, 2.0))
    tone[4000:4010] = np.nan
    signal = follow(tone, 8000)
    assert not signal.transients and signal.amplitude.at(0.5) > 0.9
    tone[4000:5600] = np.nan
    assert follow(tone, 8000).amplitude.at(0.6) == 0.0


def test_the_frequency_is_the_centroid_on_the_range_of_the_device() -> None:
    """Two equal tones have their mean as centroid; its logarithm over the band is the share."""
    t = times(8000)
    sound = 0.4 * (np.sin(2.0 * np.pi * 200.0 * t) + np.sin(2.0 * np.pi * 600.0 * t))
    signal = follow(sound, 8000, band_hz=(20.0, 2000.0), frequencies=FrequencyRange(50.0, 250.0))
    share = np.log(400.0 / 20.0) / np.log(2000.0 / 20.0)
    assert signal.frequency_hz.at(1.5) == pytest.approx(50.0 + 200.0 * share, abs=1.0)


def test_opposite_channels_do_not_cancel_and_settings_apply() -> None:
    t = times(8000)
    tone = np.sin(2.0 * np.pi * 200.0 * t) * np.where(t < 1.5, 1.0, 0.05)
    signal = follow(np.stack([tone, -tone], 1), 8000, strength=0.5, threshold_db=-20.0)
    assert signal.amplitude.at(0.7) == pytest.approx(0.5, abs=0.01)
    assert signal.amplitude.at(2.2) == 0.0  # -26 dB
    low = follow(tone + np.sin(2.0 * np.pi * 2000.0 * t), 8000, band_hz=(100.0, 400.0))
    assert low.amplitude.at(2.2) == pytest.approx(0.05, abs=0.01)  # 2 kHz is outside of the band


@pytest.mark.parametrize("seconds", (3.0, 61.7))
def test_blocks_of_any_size_give_the_same_signal(seconds: float) -> None:
    t = times(2000, seconds)
    sound = (np.exp(-(t % 0.6) / 0.1) * np.sin(2.0 * np.pi * 150.0 * t)).astype(np.float32)[:, None]
    whole = followed([sound], 2000, "", SoundSettings())
    parts = np.split(sound, np.arange(777, len(sound), 777))
    pieces = followed(parts, 2000, "", SoundSettings())
    assert np.array_equal(whole.amplitude.values, pieces.amplitude.values)
    assert whole.transients == pieces.transients
    assert whole.duration_s == pytest.approx(seconds, abs=0.001)
    onsets = np.array([tick.time_s for tick in whole.transients])
    assert np.abs(onsets % 0.6 - 0.6 * (onsets % 0.6 > 0.3)).max() < 0.01
    assert len(onsets) == len(np.arange(0.0, seconds, 0.6))


@pytest.mark.parametrize("kind", ("u1", "<i2", "<i4", "<f4", "<f8", "24"))
@pytest.mark.parametrize("channels", (1, 2))
def test_wav_files_of_every_kind(tmp_path: Path, kind: str, channels: int) -> None:
    t = times(11_025, 1.0)
    tone = 0.8 * np.sin(2.0 * np.pi * 200.0 * t) * np.minimum(t, 1.0 - t)
    columns = np.stack([tone] * channels, 1)
    path = tmp_path / "tone.wav"
    if kind == "24":
        raw = np.round(columns * 2**23).astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3]
        head = struct.pack("<HHIIHH", 1, channels, 11_025, 33_075 * channels, 3 * channels, 24)
        data = raw.tobytes()
        body = b"WAVEfmt " + struct.pack("<I", 16) + head + b"data" + struct.pack("<I", len(data))
        path.write_bytes(b"RIFF" + struct.pack("<I", len(body) + len(data)) + body + data)
    elif kind == "u1":
        wavfile.write(path, 11_025, np.round(128.0 + 127.0 * columns).astype(kind))
    else:
        scale = 1.0 if "f" in kind else 2.0 ** (8 * int(kind[-1]) - 1) - 1.0
        wavfile.write(path, 11_025, (columns * scale).astype(kind))
    written = convert(path, tmp_path / "tone.haptic")
    ((signal,), _) = read_signals(written.files[0])
    assert signal.amplitude.at(0.5) == pytest.approx(1.0, abs=0.03)
    assert signal.amplitude.at(0.25) == pytest.approx(0.5, abs=0.03)


def wav(path: Path, samples: F64, rate: int = 8000) -> Path:
    wavfile.write(path, rate, samples.astype(np.float32))
    return path


@pytest.mark.parametrize("suffix", (".ahap", ".haptic", ".hjif", ".he", ".openxr.json"))
def test_a_sound_becomes_a_file_with_its_transients(tmp_path: Path, suffix: str) -> None:
    t = times(8000)
    beats = np.exp(-(t % 0.5) / 0.08) * np.sin(2.0 * np.pi * 200.0 * t)
    convert(wav(tmp_path / "beat.wav", beats), tmp_path / f"y{suffix}")
    (signal,), _ = read_signals(tmp_path / f"y{suffix}")
    found = sorted(tick.time_s for tick in signal.transients)
    assert np.allclose(found, np.arange(6) / 2, atol=0.01)


@pytest.mark.parametrize(
    ("suffix", "low", "high"), ((".haptic", 50, 200), (".ahap", 80, 230), (".he", 50, 250))
)
def test_frequencies_are_those_that_the_format_holds(
    tmp_path: Path, suffix: str, low: int, high: int
) -> None:
    """The range of each format is that of its own documents; sweeps reach both of its ends."""
    t = times(8000)
    sweep = wav(tmp_path / "x.wav", filters.chirp(t, 20.0, SECONDS, 3900.0, "logarithmic"))
    written = convert(sweep, tmp_path / f"y{suffix}")
    assert any(f"frequencies from {low} to {high} Hz" in note for note in written.notes)
    assert not written.left_out
    (signal,), _ = read_signals(tmp_path / f"y{suffix}")
    hertz = signal.frequency_hz.at(np.linspace(0.2, 2.8, 20))
    assert low <= hertz.min() and hertz.max() <= high
    # 20 to 3900 Hz of the band from 20 to 8000 Hz: 88 % of its octaves.
    assert hertz.max() - hertz.min() > 0.7 * (high - low)


def test_a_device_plays_a_sound_within_its_own_frequencies(tmp_path: Path) -> None:
    sound = wav(tmp_path / "x.wav", np.sin(2.0 * np.pi * 3000.0 * times(8000)))
    convert(sound, tmp_path / "x.csv", device="waist_belt")
    with pytest.raises(UsageError, match="--device"):
        convert(sound, tmp_path / "y.csv")
    lines = (tmp_path / "x.csv").read_text().splitlines()
    assert len(lines) > 1400


def test_damaged_sounds(tmp_path: Path) -> None:
    """Samples without a number, files that are cut short, silent or empty, and other content."""
    tone = np.sin(2.0 * np.pi * 200.0 * times(8000))
    tone[100:110] = np.nan, np.inf, *([np.nan] * 8)
    written = convert(wav(tmp_path / "nan.wav", tone), tmp_path / "nan.haptic")
    assert any("10 samples" in note for note in written.notes)
    cut = tmp_path / "cut.wav"
    cut.write_bytes(wav(tmp_path / "whole.wav", tone[200:]).read_bytes()[:20_001])
    written = convert(cut, tmp_path / "cut.haptic")
    assert any("to its end" in note for note in written.notes)
    document = json.loads((tmp_path / "cut.haptic").read_text())
    last = document["signals"]["continuous"]["envelopes"]["amplitude"][-1]["time"]
    assert last == pytest.approx(20_000 / 4 / 8000, abs=0.01)
    written = convert(wav(tmp_path / "zero.wav", 0.0 * tone[200:]), tmp_path / "zero.haptic")
    assert "all of it is silent" in written.notes
    for name, content, message in (
        ("none.wav", b"", "cannot be read as a sound"),
        ("text.wav", b"RIFF, not a sound", "cannot be read as a sound"),
        ("text.flac", b"fLaC, not a sound", "cannot be read as a sound"),
        ("empty.wav", (tmp_path / "whole.wav").read_bytes()[:58], "holds no sound"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=message):
            convert(tmp_path / name, tmp_path / "y.ahap")
    with pytest.raises(InputError, match="samples a second"):
        convert(wav(tmp_path / "slow.wav", tone[200:], 20), tmp_path / "y.ahap")
    with pytest.raises(TooLargeError):
        convert(wav(tmp_path / "long.wav", np.zeros(9_000_000), 100), tmp_path / "y.ahap")


@pytest.mark.parametrize(
    "settings",
    ({"strength": 0.0}, {"smoothing_s": 2.0}, {"band_hz": (500.0, 400.0)}, {"threshold_db": 3.0}),
)
def test_settings_out_of_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="--"):
        SoundSettings(**settings)  # type: ignore[arg-type]


def test_options_of_sounds_are_refused_for_other_files(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is no sound"):
        convert(tmp_path / "x.ahap", tmp_path / "y.haptic", sound=SoundSettings())
