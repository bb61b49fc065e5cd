# SPDX-License-Identifier: GPL-3.0-or-later
"""WAV rasters, read back with scipy: frequency, amplitude, continuity, headers."""

import json
import struct
import wave
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.io import wavfile

from hfx_blender.engine.rendering.device_config import (
    Actuator,
    ActuatorControl,
    ActuatorType,
    DeviceConfig,
    RoomPlace,
    Scheme,
)
from hfx_blender.engine.rendering.raster import Column, Partial, Raster
from hfx_blender.errors import InputError, OutputError
from hfx_blender.formats.sound import wav
from hfx_tools.formats import wav_rules

RATE = 48_000
FULL_SCALE = 20.0


def make_device(channels, modality="vibration"):
    if modality == "vibration":
        controls = (
            ActuatorControl("amplitude_m_s2", 0, 30, 0, FULL_SCALE, 0),
            ActuatorControl("frequency_hz", 20, 500, 20, 500, 100),
        )
    else:
        controls = (ActuatorControl("pressure_kpa", 0, 10, 0, 10, 0),)
    kind = ActuatorType("motor", modality, controls, 0.0, 10.0)
    room_place = RoomPlace(("torso",))
    return DeviceConfig(
        id="device",
        name="Device",
        description="",
        actuator_types={"motor": kind},
        actuators=tuple(Actuator(f"m{i}", kind, room_place) for i in range(channels)),
        scheme=Scheme(),
        substitutions={},
        gain=1.0,
    )


def make_raster(amplitudes, frequencies, rate_hz=Fraction(100)):
    """Make a raster from (T, C) amplitudes and frequencies."""
    amplitudes = np.asarray(amplitudes, np.float64)
    amplitudes = amplitudes.reshape(len(amplitudes), -1)
    frequencies = np.broadcast_to(
        np.asarray(frequencies, np.float64).reshape(len(frequencies), -1), amplitudes.shape
    )
    count = amplitudes.shape[1]
    columns = []
    for i in range(count):
        columns += [
            Column(f"m{i}", "amplitude_m_s2", "m/s^2"),
            Column(f"m{i}", "frequency_hz", "Hz"),
        ]
    return Raster(
        device_id="device",
        body_id="body",
        actuators=tuple(f"m{i}" for i in range(count)),
        columns=tuple(columns),
        times_s=1.5 + np.arange(len(amplitudes)) / float(rate_hz),
        rate_hz=rate_hz,
        values=np.stack([amplitudes, frequencies], axis=2).reshape(len(amplitudes), -1),
        neutral=np.tile([0.0, 100.0], count),
        shortfalls=(),
        felt=(),
    )


def waveform(raster):
    """Return samples before rounding, (n, C)."""
    drives = wav.drives_of(raster, make_device(len(raster.actuators)))
    return np.concatenate([*wav.waveforms(raster, drives, RATE)])


def written(tmp_path, raster):
    wav.write(raster, make_device(len(raster.actuators)), tmp_path / "x.wav", rate_hz=RATE)
    rate, data = wavfile.read(tmp_path / "x.wav")
    assert rate == RATE
    return data.reshape(len(data), -1)


def test_frequency_and_amplitude_by_fft():
    tones = [(5.0, 80.0), (20.0, 250.0), (1.0, 431.0)]
    raster = make_raster([[a for a, _ in tones]] * 201, [[f for _, f in tones]] * 201)
    data = waveform(raster)[:RATE]  # one second: bins of 1 Hz
    spectrum = np.abs(np.fft.rfft(data, axis=0)) / (RATE / 2)
    for channel, (amplitude, frequency) in enumerate(tones):
        assert np.argmax(spectrum[:, channel]) == frequency
        assert spectrum[int(frequency), channel] == pytest.approx(amplitude / FULL_SCALE, abs=1e-6)
        rest = np.delete(spectrum[:, channel], int(frequency))
        assert rest.max() < 1e-6


@pytest.mark.parametrize("channels", [1, 2, 3, 8])
def test_form_and_full_scale(tmp_path, channels):
    # 120 Hz: a quarter period is exactly 100 samples.
    raster = make_raster([[FULL_SCALE] * channels] * 20, [[120.0] * channels] * 20)
    data = written(tmp_path, raster)
    assert data.dtype == np.int16 and data.shape == (20 * 480, channels)
    assert (data[0] == 0).all() and (data[100] == 32767).all() and (data[300] == -32767).all()
    header = (tmp_path / "x.wav").read_bytes()[:64]
    tag = struct.unpack_from("<H", header, 20)[0]
    if channels > 2:
        size, valid_bits, mask, subtype = struct.unpack_from("<HHIH", header, 36)
        assert (tag, size, mask, subtype, valid_bits) == (0xFFFE, 22, 0, 1, 16)
        assert header[46:60] == bytes.fromhex("000000001000800000aa00389b71")
    else:
        assert tag == 1
    riff = struct.unpack_from("<I", header, 4)[0]
    assert riff + 8 == (tmp_path / "x.wav").stat().st_size


def test_the_waveform_is_the_integral_of_its_frequency():
    """Slow twin: phase summed in steps far finer than a sample."""
    amplitudes = [4.0, 10.0, 2.0, 0.0, 0.0, 6.0, 20.0, 20.0]
    frequencies = [80.0, 200.0, 60.0, 100.0, 100.0, 300.0, 90.0, 95.0]
    data = waveform(make_raster(amplitudes, frequencies))[:, 0]
    fine = 16
    t = (np.arange(len(data) * fine) + 0.5) / (RATE * fine)
    row = (t * 100).astype(int)
    x = t * 100 - row
    hz = np.array([*frequencies, 95.0])
    begin, end = hz[row], hz[row + 1]
    begin = np.where((row == 4) | (row == 3), end, begin)  # silent rows do not chirp
    end = np.where((row == 2) | (row == 3), hz[row], end)
    phase = np.concatenate([[0.0], np.cumsum(begin + (end - begin) * x) / (RATE * fine)])[::fine]
    n = np.arange(len(data))
    level = np.interp(n / 480, np.arange(9), [*amplitudes, 0.0])
    expected = level / FULL_SCALE * np.sin(2 * np.pi * phase[:-1])
    assert np.abs(data - expected).max() < 2e-5


def test_no_clicks():
    """No step is larger than possible for the loudest, highest tone, up to the end."""
    random = np.random.default_rng(5)
    amplitudes = random.uniform(0, FULL_SCALE, (200, 4)) * random.integers(0, 2, (200, 4))
    frequencies = random.uniform(20, 500, (200, 4))
    data = waveform(make_raster(amplitudes, frequencies))
    steps = np.abs(np.diff(data, axis=0, prepend=0.0, append=0.0))
    assert steps.max() <= 2 * np.pi * 500 / RATE + 1 / 480 + 1e-6


@pytest.mark.parametrize("block", [1, 7, 1000, 1 << 18])
@pytest.mark.parametrize("rate_hz", [Fraction(100), Fraction(30000, 1001), Fraction(60)])
def test_any_block_size_gives_the_same_bytes(tmp_path, monkeypatch, block, rate_hz):
    random = np.random.default_rng(6)
    raster = make_raster(random.uniform(0, 20, (6, 3)), random.uniform(20, 500, (6, 3)), rate_hz)
    device = make_device(3)
    wav.write(raster, device, tmp_path / "whole.wav")
    monkeypatch.setattr(wav, "BLOCK_SAMPLES", block)
    wav.write(raster, device, tmp_path / "parts.wav")
    assert (tmp_path / "whole.wav").read_bytes() == (tmp_path / "parts.wav").read_bytes()


@pytest.mark.parametrize("block", [1, 2500, 1 << 18])
@pytest.mark.parametrize("rate_hz", [Fraction(100), Fraction(30000, 1001)])
def test_an_effect_that_sounds_for_a_while_is_heard_there_only(monkeypatch, block, rate_hz):
    """m1 has a waveform: 8 rows of 12 m/s^2 at 150 Hz from row 10 on; m0 is silent."""
    hum = Partial("hum", 10, np.full((8, 1), 12.0), np.full((8, 1), 150.0))
    silent = make_raster(np.zeros((40, 2)), np.full((40, 2), 100.0), rate_hz)
    monkeypatch.setattr(wav, "BLOCK_SAMPLES", block)
    data = waveform(replace(silent, waveform_actuators=("m1",), partials=(hum,)))
    assert not data[:, 0].any()
    row = np.arange(len(data)) * float(rate_hz) / RATE
    level = np.interp(row, [9, 10, 17, 18], [0.0, 12.0, 12.0, 0.0]) / FULL_SCALE
    expected = level * np.sin(2 * np.pi * 150.0 * np.arange(len(data)) / RATE)
    np.testing.assert_allclose(data[:, 1], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("rate_hz", "rows", "samples"),
    [(Fraction(100), 3, 1440), (Fraction(30000, 1001), 3, 4805), (Fraction(7), 1, 6858)],
)
def test_length_covers_every_row(tmp_path, rate_hz, rows, samples):
    raster = make_raster([[1.0]] * rows, [[100.0]] * rows, rate_hz)
    assert len(written(tmp_path, raster)) == samples  # rows / rate * 48000, rounded up


def test_sidecar_lists_the_channels(tmp_path):
    device = make_device(3)
    wav.write(make_raster([[1.0] * 3], [[100.0] * 3]), device, tmp_path / "x.wav")
    assert json.loads((tmp_path / "x.wav.channels.json").read_text()) == {
        "format": "hfx-wav-channels",
        "version": 1,
        "device": "device",
        "body": "body",
        "rate_hz": RATE,
        "start_s": 1.5,
        "full_scale_m_s2": FULL_SCALE,
        "channels": [{"channel": i, "actuator": f"m{i}"} for i in range(3)],
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.wav", "x.wav.channels.json"]


def test_a_value_that_is_no_number_is_silence_not_full_power(tmp_path):
    data = written(tmp_path, make_raster([1.0, np.nan, np.inf, 1.0], [100.0] * 4))
    assert np.abs(data).max() <= 32767 * 1.0 / FULL_SCALE + 1


def test_devices_without_vibration_are_reported(tmp_path):
    raster = make_raster([[1.0]], [[100.0]])
    with pytest.raises(InputError, match="'device' has no vibration actuators"):
        wav.write(raster, make_device(1, "pressure"), tmp_path / "x.wav")
    assert list(tmp_path.iterdir()) == []


def test_other_depths_than_the_one_that_is_written_are_read(tmp_path):
    wavfile.write(tmp_path / "float.wav", RATE, np.zeros((7, 3), np.float32))
    with wave.open(str(tmp_path / "24.wav"), "wb") as file:
        file.setparams((2, 3, RATE, 7, "NONE", ""))
        file.writeframes(bytes(2 * 3 * 7))
    for name, form in (("float", (3, 32, True)), ("24", (2, 24, False))):
        actual, findings = wav_rules.inspect((tmp_path / f"{name}.wav").read_bytes())
        assert [finding.severity for finding in findings] in ([], ["warning"])
        assert (actual.channels, actual.bits, actual.is_float) == form and actual.frames == 7


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_sample_that_is_no_number_is_found(tmp_path, value):
    path = tmp_path / "x.wav"
    samples = np.zeros(100, np.float64)
    wavfile.write(path, RATE, samples)
    assert wav_rules.validate(path.read_bytes(), "x") == []
    samples[99] = value
    wavfile.write(path, RATE, samples)
    assert [finding.code for finding in wav_rules.validate(path.read_bytes(), "x")] == ["WAV-DATA"]


def test_files_that_would_be_too_long_are_refused(tmp_path):
    raster = make_raster([[1.0]], [[100.0]])
    raster = replace(raster, rate_hz=Fraction(1, 100_000))
    with pytest.raises(InputError, match="4 GiB at most"):
        wav.write(raster, make_device(1), tmp_path / "x.wav")
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_place(tmp_path):
    with pytest.raises(OutputError):
        wav.write(make_raster([[1.0]], [[100.0]]), make_device(1), tmp_path / "no" / "x.wav")


@pytest.mark.parametrize("name", [b"data", b"LIST", b"\xb5\x01ab"])
def test_a_chunk_beyond_the_end_is_named(name):
    content = b"RIFF" + struct.pack("<I", 12) + b"WAVE" + name + struct.pack("<I", 99)
    message = wav_rules.inspect(content)[1][0].message
    assert message == f"the chunk '{name.decode('latin-1')}' is longer than the file"
