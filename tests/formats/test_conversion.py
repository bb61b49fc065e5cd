# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats by name, conversion, and ``hfx validate`` and ``hfx convert``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from format_cases import RANGE, raster_for, signal
from test_hjif import BEAT, track_of

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError, UsageError
from hfx_blender.formats import files, writing
from hfx_blender.formats.device_files import ahap, haptic
from hfx_blender.formats.hjif import hjif_reader, to_signals
from hfx_blender.formats.rasters import npz_raster
from hfx_blender.formats.registry import FORMATS
from hfx_blender.formats.signals import losses
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.signals.signals import (
    FrequencyRange,
    Signal,
    Transient,
    signals_of,
    simplified_signals,
)
from hfx_blender.formats.sound import wav
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import hjif_from_actuators, npz_reader
from hfx_tools.formats.validation import validate

ENVELOPES = ["ahap", "haptic", "he", "he1", "openharmony", "openxr"]


@pytest.mark.parametrize("name", [id for id, info in FORMATS.items() if info.is_of_device])
def test_every_device_format_writes_valid_files(tmp_path, name):
    device = load_device("back_pad")
    raster = raster_for(device)
    written = writing.write(name, raster, device, tmp_path / "scene.back_pad")
    assert written.files and not written.left_out
    for path in written.files:
        assert path.name.startswith("scene.back_pad")
        if not path.name.endswith(wav.SIDECAR_SUFFIX):
            actual, findings = validate(path)
            assert findings == [], path
            assert actual.id == {"he1": "he"}.get(name, name)
    again = writing.write(name, raster, device, tmp_path / "other.back_pad")
    for first, second in zip(written.files, again.files, strict=True):
        same = second.read_bytes().replace(b"other.back_pad", b"scene.back_pad")
        assert first.read_bytes() == same


@pytest.mark.parametrize("name", ["ahap", "haptic", "he", "openxr"])
def test_the_file_holds_the_device_output(tmp_path, name):
    device = load_device("back_pad")
    raster = raster_for(device)
    dense, _ = signals_of(raster, device)
    written = writing.write(name, raster, device, tmp_path / "x")
    actual = [item for path in written.files for item in files.read_signals(path)[0]]
    assert [entry.name for entry in actual] == [item.name for item in dense]
    times = np.linspace(0.0, 1.99, 400)
    for first, second in zip(actual, dense, strict=True):
        slack = 0.021 if name == "he" else 0.0101  # half a millisecond of 21 a second
        assert np.abs(first.amplitude.at(times) - second.amplitude.at(times)).max() <= slack


@pytest.mark.parametrize("name", [*ENVELOPES, "wav", "tact"])
def test_temperature_in_a_vibration_format_is_refused(tmp_path, name):
    device = load_device("fan_heater")
    with pytest.raises(InputError, match="plays wind and temperature"):
        writing.write(name, raster_for(device), device, tmp_path / "x")
    assert not list(tmp_path.iterdir())
    with pytest.raises(UsageError, match="none of the devices has vibration"):
        writing.check([name], [device])


def test_two_devices_of_one_id_are_refused_and_one_that_is_named_twice_is_not():
    """Files are named by the id, so the second would replace the first."""
    one, again = load_device("back_pad"), load_device("back_pad")
    writing.check(["csv"], [one, again])
    with pytest.raises(UsageError, match="two different devices have the id 'back_pad'"):
        writing.check(["csv"], [one, replace(again, gain=0.5)])
    with pytest.raises(UsageError, match="the id 'back_pad' or 'Back_Pad'"):  # equal on Windows
        writing.check(["csv"], [one, replace(again, id="Back_Pad")])
    belt = load_device("waist_belt")
    several = [one, replace(one, gain=0.5), belt, replace(one, gain=0.25), replace(belt, gain=0.5)]
    message = "3 different devices have the id 'back_pad', two .* have the id 'waist_belt',"
    with pytest.raises(UsageError, match=rf"{message}"):
        writing.check(["csv"], [*several, one])


def test_unplayable_modalities_are_reported(tmp_path):
    pad, heater = load_device("back_pad"), load_device("fan_heater")
    played = [
        (tmp_path / "x.a", pad, raster_for(pad)),
        (tmp_path / "x.b", heater, raster_for(heater)),
    ]
    with track_of(tmp_path, "pressure", "painted", BEAT) as track:
        written = writing.write_all(["ahap", "csv"], played, track, [pad, heater], tmp_path / "x")
    assert "'fan_heater' has no vibration actuators" in written.left_out[0]
    assert {path.name for path in written.files} >= {"x.a.csv", "x.b.csv", "x.a.r1c1.ahap"}


def test_a_format_needs_a_known_name_and_a_device():
    with pytest.raises(UsageError, match="format mp3: expected one of track, "):
        writing.check(["mp3"], [])
    with pytest.raises(UsageError, match="choose one with --device"):
        writing.check(["ahap"], [])
    writing.check(["track", "hjif", "jsonl"], [])


@pytest.mark.parametrize("target", ["haptic", "he", "he1", "openharmony", "openxr", "ahap", "hjif"])
@pytest.mark.parametrize("source", ["haptic", "ahap", "he", "openxr", "tact"])
def test_vibration_goes_from_format_to_format(tmp_path, source, target):
    device = load_device("forearm_band_left")
    raster = raster_for(device, rows=60)
    first = writing.write(source, raster, device, tmp_path / "first").files[0]
    suffix = FORMATS[target].suffix
    written = convert(first, tmp_path / f"second{suffix}", to=target)
    (before, *_), _ = files.read_signals(first)
    (after, *_), _ = files.read_signals(written.files[0])
    assert validate(written.files[0])[1] == []
    times = np.linspace(0.02, 0.55, 100)
    off = np.abs(before.amplitude.at(times) - after.amplitude.at(times))
    if target != "he1" and source != "tact":  # steps, or silence between events
        assert off.max() <= 0.03


def test_a_track_goes_to_everything(tmp_path):
    with track_of(tmp_path, "vibration", "painted", BEAT * 5):
        pass
    track = tmp_path / "x.hfxtrack"
    for name in ("hjif", "samples.jsonl", "raster.npz", "csv"):
        device = None if name in ("hjif", "samples.jsonl") else "back_pad"
        written = convert(track, tmp_path / f"y.{name}", device=device)
        assert written.files[0].name == f"y.{name}"
        assert validate(written.files[0])[1] == []
    convert(tmp_path / "y.raster.npz", tmp_path / "z.csv", device="back_pad")
    assert (tmp_path / "z.csv").read_bytes() == (tmp_path / "y.csv").read_bytes()
    with pytest.raises(InputError, match="not those of the device"):
        convert(tmp_path / "y.csv", tmp_path / "w.npz", to="npz", device="insoles")
    table = (tmp_path / "y.csv").read_bytes()
    (tmp_path / "y.csv").write_bytes(table.replace(b"amplitude_m_s2 [m/s^2]", b"own [g]", 1))
    with pytest.raises(InputError, match=r"column 1 is '\S+ \[g\]', expected is '\S+ \[m/s\^2\]'"):
        convert(tmp_path / "y.csv", tmp_path / "w.npz", to="npz", device="back_pad")
    with pytest.raises(UsageError, match="choose one with --device"):
        convert(track, tmp_path / "w.ahap")
    hjif = convert(tmp_path / "y.hjif", tmp_path / "v.haptic").files
    assert [path.name for path in hjif] == ["v.haptic"]
    assert not list(tmp_path.glob(".hfx.*")) and not list(tmp_path.glob("w*"))


def test_a_single_signal_gets_exactly_the_name_that_was_asked_for(tmp_path):
    ticking = signal([0, 1, 0.5, 0], transients=[Transient(0.01, 0.9, 100.0)])
    haptic.write([ticking], RANGE, tmp_path / "x")
    written = convert(tmp_path / "x.r1c1.haptic", tmp_path / "y.ahap")
    assert {path.name for path in written.files} == {"y.ahap", "y.transients.ahap"}
    assert all(path.is_file() for path in written.files)


@pytest.mark.parametrize("target", [id for id in ENVELOPES if id != "tact"])
def test_a_device_of_one_actuator_gets_exactly_the_name_that_was_asked_for(tmp_path, target):
    for source in ("csv", "openxr"):
        for device, expected in (("phone_lra", 1), ("oculus_touch", 2)):
            config = load_device(device)
            made = writing.write(
                source, raster_for(config), config, tmp_path / f"{source}-{device}"
            )
            name = f"y{FORMATS[target].suffix}"
            written = convert(made.files[0], tmp_path / name, device=device)
            names = [path.name for path in written.files]
            assert all(path.is_file() for path in written.files)
            if expected == 1 or target in ("hjif", "openxr"):
                assert names == [name]
            else:
                suffix = FORMATS[target].suffix
                assert names == [f"y.left{suffix}", f"y.right{suffix}"]


def test_a_suffix_of_a_target_keeps_its_case(tmp_path):
    device = load_device("phone_lra")
    (source,) = writing.write("csv", raster_for(device), device, tmp_path / "x").files
    for name, others in (
        ("Y.HE", []),
        ("Y.V1.He", []),
        ("Y.WAV", ["Y.WAV.channels.json"]),
        ("Y.CSV", []),
        ("Y.OpenXR.json", []),
    ):
        written = convert(source, tmp_path / name, device="phone_lra")
        assert [path.name for path in written.files] == [name, *others]
        assert convert(source, tmp_path / name, device="phone_lra").files == written.files
    # The model names the file that it belongs to.
    with track_of(tmp_path, "vibration", "painted", BEAT) as track:
        upper = track.path.rename(tmp_path / "T.HFXTRACK")
    names = [path.name for path in convert(upper, tmp_path / "Z.HJIF").files]
    assert names == ["Z.hjif", "Z.hfx-vibration-1.glb"]
    assert convert(tmp_path / "Y.HE", tmp_path / "a.ahap").files == (tmp_path / "a.ahap",)


def test_ticks_are_found_beside_a_pattern_in_upper_case(tmp_path):
    ticking = signal([0, 1, 0.5, 0], transients=[Transient(0.01, 0.9, 100.0)])
    haptic.write([ticking], RANGE, tmp_path / "x")
    convert(tmp_path / "x.r1c1.haptic", tmp_path / "Y.AHAP")
    (actual,), _ = files.read_signals(tmp_path / "Y.AHAP")
    assert [tick.time_s for tick in actual.transients] == [0.01]


@pytest.mark.parametrize("target", ["csv", "raster.npz", "wav", "tact", "ahap"])
def test_one_signal_is_played_by_all_vibration_actuators_of_a_device(tmp_path, target):
    """A ramp of 1 s at 120 Hz reaches half of each actuator's maximum in the middle."""
    haptic.write([signal([0, 1], rate_hz=1.0, name="buzz")], RANGE, tmp_path / "x")
    written = convert(tmp_path / "x.buzz.haptic", tmp_path / f"y.{target}", device="back_pad")
    assert validate(written.files[0])[1] == []
    assert ("500 times a second" in " ".join(written.notes)) and not written.left_out
    if target != "raster.npz":
        return
    raster = npz_reader.read(written.files[0])
    device = load_device("back_pad")
    assert len(raster.values) == 500 and len(raster.actuators) == 20
    for k, column in enumerate(raster.columns):
        control = device.actuators[0].type.controls[k % 2]
        assert column.parameter == control.name
        expected = control.highest / 2.0 if k % 2 == 0 else 120.0
        assert raster.values[250, k] == pytest.approx(expected, rel=0.01)


def test_signals_go_to_the_actuators_of_their_names(tmp_path):
    device = load_device("back_pad")
    first = writing.write("openxr", raster_for(device, rows=60), device, tmp_path / "x").files[0]
    back = convert(first, tmp_path / "y.raster.npz", device="back_pad")
    raster = npz_reader.read(back.files[0])
    dense, _ = signals_of(raster_for(device, rows=60), device)
    scale = device.actuators[0].type.strength.highest
    for index, signal_before in enumerate(dense):
        expected = signal_before.amplitude.at(raster.times_s) * scale
        assert np.abs(raster.values[:, 2 * index] - expected).max() <= 0.011 * scale
    with pytest.raises(InputError, match="the vibration actuators of 'insoles' are"):
        convert(first, tmp_path / "z.csv", device="insoles")
    with pytest.raises(InputError, match="no vibration actuators"):
        convert(first, tmp_path / "z.csv", device="fan_heater")


def test_a_tick_is_a_burst_that_fades(tmp_path):
    ticking = signal([0, 0, 0], rate_hz=2.0, transients=[Transient(0.1011, 0.8, 100.0)])
    haptic.write([ticking], RANGE, tmp_path / "x")
    written = convert(tmp_path / "x.r1c1.haptic", tmp_path / "y.raster.npz", device="back_pad")
    raster = npz_reader.read(written.files[0])
    scale = load_device("back_pad").actuators[0].type.strength.highest
    shares = raster.values[:, 0] / scale
    assert shares[51] == pytest.approx(0.8, abs=0.01)  # the first row after 0.1011 s
    assert shares[:51].max() == 0.0 and shares[62:].max() == 0.0 and shares[51:62].min() > 0.0
    assert raster.values[51, 1] == pytest.approx(100.0, abs=1.0)


def test_inconsistent_requests_are_refused(tmp_path):
    haptic.write([signal([0, 1])], RANGE, tmp_path / "x")
    source = tmp_path / "x.r1c1.haptic"
    with pytest.raises(UsageError, match="only a track"):
        convert(source, tmp_path / "y.samples.jsonl")
    with pytest.raises(UsageError, match="wav holds what a device plays: choose one"):
        convert(source, tmp_path / "y.wav")
    with pytest.raises(UsageError, match="names no format"):
        convert(source, tmp_path / "y.mp3")
    with pytest.raises(InputError, match="no such file"):
        convert(tmp_path / "none.haptic", tmp_path / "y.ahap")
    with pytest.raises(InputError, match="no known format"):
        convert(tmp_path / "none.mpx", tmp_path / "y.ahap")


# --- the commands --------------------------------------------------------------------------


def run(capsys, *arguments):
    code = cli.run([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_validate_lists_findings_with_codes(tmp_path, capsys):
    good, bad = tmp_path / "good.haptic", tmp_path / "bad.haptic"
    haptic.write([signal([0, 1], name="")], RANGE, tmp_path / "x")
    good.write_bytes((tmp_path / "x._.haptic").read_bytes())
    bad.write_bytes(good.read_bytes().replace(b'"frequency"', b'"frequncy"', 1))
    assert run(capsys, "validate", good)[0] == 0
    code, out, _ = run(capsys, "validate", bad)
    assert code == 0 and "warning HAPTIC-UNKNOWN" in out and "valid" in out
    assert run(capsys, "validate", "--strict", bad)[0] == 3
    bad.write_bytes(good.read_bytes().replace(b'"major":1', b'"major":9'))
    code, out, _ = run(capsys, "validate", bad)
    assert code == 3 and "error HAPTIC-RANGE version.major: is 9, allowed is 1" in out
    assert run(capsys, "validate", good, bad)[0] == 5
    code, out, _ = run(capsys, "validate", "--json", bad)
    assert json.loads(out)["findings"][0]["code"] == "HAPTIC-RANGE"
    bad.write_bytes(b"{")
    assert "HAPTIC-UNREADABLE" in run(capsys, "validate", bad)[1]
    code, _, err = run(capsys, "validate", tmp_path / "none.hjif")
    assert code == 3 and "no such file" in err


def test_convert_reports_written_and_omitted_files(tmp_path, capsys):
    device = load_device("pressure_vest")
    npz_raster.write(raster_for(device), tmp_path / "x.raster.npz")
    source = tmp_path / "x.raster.npz"
    code, _, err = run(capsys, "convert", source, tmp_path / "y.ahap", "--device", "pressure_vest")
    assert code == 3 and "the format ahap holds vibration only" in err
    code, out, _ = run(capsys, "convert", source, tmp_path / "y.csv", "--device", "pressure_vest")
    assert code == 0 and "y.csv" in out
    code, _, err = run(
        capsys, "convert", source, tmp_path / "none" / "y.csv", "--device", "pressure_vest"
    )
    assert code == 3 and "cannot be written to" in err
    code, _, _ = run(capsys, "convert", source, tmp_path / "y.csv", "--tolerance", "0")
    assert code == 2


def read_hjif(path):
    return hjif_reader.decode(path.read_bytes(), path.name)[0]


def test_a_raster_goes_to_hjif_a_channel_an_actuator(tmp_path):
    device = load_device("fan_heater")
    raster = raster_for(device, rows=50)
    raster.values[10:20] += 1.0
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    path = convert(tmp_path / "x.raster.npz", tmp_path / "y.hjif", device="fan_heater").files[0]
    assert validate(path)[1] == []
    envelopes = list(to_signals.envelopes(read_hjif(path)))
    assert [envelope.modality for envelope in envelopes] == ["Wind", "Temperature"]
    for curve in envelopes:
        strength = curve.strength.at(np.arange(50) / 100.0) * curve.full_scale
        assert strength == pytest.approx((raster.values - raster.neutral)[:, 0], abs=0.06)


def test_envelopes_become_hjif_of_a_device(tmp_path):
    """A ramp of 1 s to full scale; a device adds 20 actuators, positions and m/s^2."""
    haptic.write([signal([0, 1], rate_hz=1.0, name="buzz")], RANGE, tmp_path / "x")
    source = tmp_path / "x.buzz.haptic"
    device = load_device("back_pad")
    without = read_hjif(convert(source, tmp_path / "a.hjif").files[0])
    assert [len(channel["channels"]) for channel in without["perceptions"]] == [1]
    written = convert(source, tmp_path / "b.hjif", device="back_pad")
    assert validate(written.files[0])[1] == []
    document = read_hjif(written.files[0])
    (perception,) = document["perceptions"]
    assert [channel["description"] for channel in perception["channels"]] == [
        a.id for a in device.actuators
    ]
    assert all(channel["body_part_mask"] for channel in perception["channels"])
    for envelope in to_signals.envelopes(document):
        half = float(envelope.strength.at(np.array([0.5]))[0] * envelope.full_scale)
        assert half == pytest.approx(device.actuators[0].type.strength.highest / 2.0, rel=0.02)
    with pytest.raises(InputError, match="has no vibration actuators"):
        convert(source, tmp_path / "c.hjif", device="fan_heater")


def test_ticks_go_to_hjif_and_back(tmp_path):
    tick = Transient(0.01, 0.8, 150.0)
    haptic.write([signal([0, 0.5, 0], transients=[tick])], RANGE, tmp_path / "x")
    path = convert(tmp_path / "x.r1c1.haptic", tmp_path / "y.hjif").files[0]
    assert validate(path)[1] == []
    ((actual,), _) = files.read_signals(path)
    assert [(t.time_s, t.amplitude, t.frequency_hz) for t in actual.transients] == [
        (pytest.approx(0.01), pytest.approx(0.8), pytest.approx(150.0, abs=0.51))
    ]
    assert actual.amplitude.at(0.01) == pytest.approx(
        0.5, abs=0.014
    )  # and half a tick of 50 a second


def test_signals_of_the_same_name_do_not_overwrite_each_other(tmp_path):
    device = load_device("forearm_band_left")
    raster = raster_for(device, rows=20)
    path = writing.write("openxr", raster, device, tmp_path / "x").files[0]
    names = [channel["actuator"] for channel in json.loads(path.read_text())["channels"]]
    text = path.read_text()
    for name, new in zip(names, ["tap", "TAP", "tap", "t" * 300, "t" * 299 + "u"], strict=False):
        text = text.replace(json.dumps(name), json.dumps(new))
    path.write_text(text)
    written = convert(path, tmp_path / "y.haptic")
    assert len({file.name.casefold() for file in written.files}) == len(names)
    assert all(file.is_file() and len(file.name) < 130 for file in written.files)


def test_a_track_is_validated_as_a_whole(tmp_path, capsys):
    with track_of(tmp_path, "pressure", "painted", BEAT):
        pass
    path = tmp_path / "x.hfxtrack"
    assert run(capsys, "validate", path)[0] == 0
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    code, out, _ = run(capsys, "validate", path)
    assert code == 3 and "TRACK-CONTENT" in out


def _tones(folder, hertz):
    """Write an HJIF file with one tone per channel and, as in MPEG's files, no frequency range."""
    signals = [
        signal([1.0] * 10, [frequency_hz] * 10, name=f"{frequency_hz:g}") for frequency_hz in hertz
    ]
    (path,) = hjif_from_actuators.write_signals(
        signals, FrequencyRange(0, 1000), folder / "tones"
    ).files
    return path


def _sharpness(document):
    return document["Pattern"][0]["Event"]["EventParameters"][1]["ParameterValue"]


def _frequency(document):
    return document["signals"]["continuous"]["envelopes"]["frequency"][0]["frequency"]


def _hundredths(document):
    event = document["PatternList"][0]["Pattern"][0]["Event"]
    return event["Parameters"]["Curve"][0]["Frequency"] / 100


@pytest.mark.parametrize(
    ("suffix", "read", "lowest", "highest"),
    [
        (".ahap", _sharpness, 80, 230),
        (".haptic", _frequency, 50, 200),
        (".he", _hundredths, 50, 250),
    ],
)
def test_hertz_without_a_range_follow_the_targets_documented_one(
    tmp_path, suffix, read, lowest, highest
):
    hertz = (100.0, 120.0, 190.0, 300.0)
    written = convert(_tones(tmp_path, hertz), tmp_path / f"x{suffix}")
    actual = {path.name: read(json.loads(path.read_text())) for path in written.files}
    for frequency_hz in hertz:
        expected = min(max((frequency_hz - lowest) / (highest - lowest), 0.0), 1.0)
        assert actual[f"x.{frequency_hz:g}{suffix}"] == pytest.approx(expected, abs=0.011)
    assert any(
        f"{lowest} to {highest} Hz" in messages and "300" in messages
        for messages in written.left_out
    )


def test_a_device_of_one_frequency_has_a_place_in_the_documented_range(tmp_path):
    device = load_device("bhaptics_tactosy_left")  # 100 Hz
    raster = raster_for(device)
    raster.values[:, 1::2] = 100.0
    written = writing.write("ahap", raster, device, tmp_path / "x")
    for path in written.files:
        actual = json.loads(path.read_text())
        (sharpness,) = {
            entry["Event"]["EventParameters"][1]["ParameterValue"]
            for entry in actual["Pattern"]
            if "Event" in entry and entry["Event"]["EventParameters"][0]["ParameterValue"] > 0.0
        }
        assert sharpness == pytest.approx(20 / 150, abs=1e-5)
        assert actual["Metadata"]["HfxFrequencyRangeHz"] == [80.0, 230.0]


def test_a_pattern_of_another_law_names_the_way_to_export_again():
    """Intensities of the square-root law, read as amplitudes, would be twice as strong at 0.5."""
    metadata = {"HfxIntensityLaw": "square root"}
    content = json.dumps({"Version": 1.0, "Metadata": metadata, "Pattern": []}).encode()
    with pytest.raises(InputError, match=r"x.ahap: Metadata: 'HfxIntensityLaw' is .*-f ahap"):
        ahap.decode(content, "x.ahap")


def test_a_step_is_no_error_of_the_keyframes(tmp_path):
    hertz = Curve.of([0, 1, 1, 2], [100.0, 100.0, 180.0, 180.0])
    step = Signal("a", Curve.of([0, 1, 1, 2], [0.2, 0.2, 0.9, 0.9]), hertz)
    (few,) = simplified_signals([step])
    amplitude, hertz = losses.errors_of(step, few, 2e-6)
    assert amplitude <= 0.01 and hertz <= 1.0 + 1e-9
    np.testing.assert_allclose(few.amplitude.at([0.5, 1.5]), [0.2, 0.9], atol=0.01)


def test_a_folder_as_target_is_called_a_folder(tmp_path, capsys):
    haptic.write([signal([0, 1])], RANGE, tmp_path / "x")
    source, target = tmp_path / "x.r1c1.haptic", tmp_path / "folder.ahap"
    target.mkdir()
    assert cli.run(["convert", str(source), str(target)]) == 3
    error = capsys.readouterr().err
    assert error == f"hfx: {target}: cannot be written (it is a folder, not a file).\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_device_as_target_is_refused_with_a_format_too(tmp_path, capsys):
    with track_of(tmp_path, "vibration", "volume", BEAT) as track:
        assert cli.run(["convert", str(track.path), "/dev/full", "--to", "jsonl"]) == 3
    assert capsys.readouterr().err == (
        "hfx: /dev/full: cannot be written (it is a device or a pipe, not a file).\n"
    )
    assert not list(Path("/dev").glob("full.*"))


@pytest.mark.parametrize(
    "content",
    [b"mine", b"", b'glTF\2\0\0\0\0\0\0\0\0\0\0\0JSON{"asset":{"generator":"Khronos"}}'],
)
def test_a_foreign_model_file_stays(tmp_path, capsys, content):
    with track_of(tmp_path, "vibration", "volume", BEAT) as track:
        model = tmp_path / "b.hfx-vibration-1.glb"
        model.write_bytes(content)
        assert cli.run(["convert", str(track.path), str(tmp_path / "b.hjif")]) == 3
        assert str(model) in capsys.readouterr().err
        assert model.read_bytes() == content and not (tmp_path / "b.hjif").exists()
        model.unlink()
        for _ in range(2):  # an own file is replaced
            assert cli.run(["convert", str(track.path), str(tmp_path / "b.hjif")]) == 0


FOREIGN = {  # as written by other programs
    "ahap": b'{"Version": 1.0, "Metadata": {"Project": "Mine"}, "Pattern": []}',
    "haptic": b'{"version": {"major": 1}, "metadata": {"editor": "Haptics Studio"}, "signals": {}}',
    "he": b'{"Metadata": {"Version": 2, "Description": "rain"}, "PatternList": []}',
    "v1.he": b'{"Metadata": {"Version": 1, "Description": "rain"}, "Pattern": []}',
    "openharmony.json": b'{"MetaData": {"Version": 1.0, "Description": ""}, "Channels": []}',
    "wav": b'{"channels": ["front left", "front right"]}',
}


@pytest.mark.parametrize("suffix", FOREIGN)
def test_a_foreign_companion_file_stays(tmp_path, capsys, suffix):
    npz_raster.write(raster_for(load_device("back_pad")), tmp_path / "x.raster.npz")
    target = tmp_path / f"y.{suffix}"
    words = ["convert", str(tmp_path / "x.raster.npz"), str(target), "--device", "back_pad"]
    assert cli.run(words) == 0
    assert cli.run(words) == 0, "its own files are replaced"
    companions = sorted(path for path in tmp_path.glob("y.*") if path != target)
    assert companions
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    capsys.readouterr()
    # A file of another program; an own file reformatted by another program; unreadable bytes.
    theirs = json.dumps(json.loads(before[companions[-1]]), indent=4).encode()
    for content in (FOREIGN[suffix], theirs, b"\xff\xfe"):
        companions[-1].write_bytes(content)
        assert cli.run(words) == 3
        (line,) = capsys.readouterr().err.splitlines()
        assert str(companions[-1]) in line and f"'{target.name}' needs this name" in line
        after = {path: path.read_bytes() for path in tmp_path.iterdir()}
        assert after == {**before, companions[-1]: content}


def test_times_of_haptic_that_fall_in_64_bits_only_are_taken() -> None:
    # In binary 9 * 0.002 + 0.002 is above 0.02 by a rounding step, and equal to it in 32 bits.
    times = [0.0, 9 * 0.002 + 0.002, 0.02, 0.05]
    assert times[1] > times[2] and np.float32(times[1]) == np.float32(times[2])
    points = [{"time": time, "amplitude": k / 4} for k, time in enumerate(times)]
    content = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "signals": {"continuous": {"envelopes": {"amplitude": points}}},
    }
    (signal,), _ = haptic.decode(json.dumps(content).encode(), "x.haptic")
    assert signal.amplitude.times_s.tolist() == [0.0, times[1], times[1], 0.05]
    assert signal.amplitude.values.tolist() == [0.0, 0.25, 0.5, 0.75]
