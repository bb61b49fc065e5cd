# SPDX-License-Identifier: GPL-3.0-or-later
"""Losses of formats (dropped, cut, rounded to nothing) are reported once, with a count."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from format_cases import RANGE, raster_for, signal

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.conditioning.frequency import Partial
from hfx_blender.errors import InputError
from hfx_blender.files import strict_json
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats import writing
from hfx_blender.formats.device_files import ahap, haptic, he, tact
from hfx_blender.formats.device_files.tact_layouts import Motor
from hfx_blender.formats.files import read_signals
from hfx_blender.formats.registry import FORMATS
from hfx_blender.formats.signals import losses, signals
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.signals.signals import FrequencyRange, Transient
from hfx_blender.formats.signals.simplified_writer import error_note
from hfx_tools.commands import conversion
from hfx_tools.formats import hjif_from_actuators, signal_raster

DEVICE = load_device("phone_lra")
ITS_HZ = DEVICE.actuators[0].type.controls[1].neutral
LOUD = [0.0, 1.0, 0.0, 1.0, 0.0]


def written(name, signals, folder, frequencies=RANGE):
    return writing.write_signals(FORMATS[name], list(signals), frequencies, folder / "x", 0.01)


def left_out(*given):
    return written(*given).left_out


@pytest.mark.parametrize("name", [n for n, f in FORMATS.items() if f.held])
def test_frequencies_outside_of_a_range_are_reported(name, tmp_path):
    hertz = [120, 120, 120, 400, 400]
    actual = left_out(name, [signal(LOUD, hertz, name="a"), signal(LOUD, name="b")], tmp_path)
    (sentence,) = actual
    assert "50 to 250 Hz" in sentence and sentence.endswith("1 (a)")
    silent_there = signal([0, 1, 0, 0, 0], hertz, name="a")
    assert left_out(name, [silent_there], tmp_path) == ()


def test_openxr_has_a_range_of_its_own(tmp_path):
    slow = signal(LOUD, [0.5] * 5, name="slow")
    (sentence,) = left_out("openxr", [slow], tmp_path, FrequencyRange(0.5, 250.0))
    assert "1 to 250 Hz" in sentence and sentence.endswith("1 (slow)")
    assert left_out("ahap", [slow], tmp_path, FrequencyRange(0.5, 250.0)) == ()
    tick = replace(signal([0.0, 0.0]), transients=(Transient(0.0, 1.0, 0.5),))
    assert left_out("openxr", [tick], tmp_path, FrequencyRange(0.5, 250.0))


@pytest.mark.parametrize("name", ["wav", "ahap", "openxr", "hjif"])
def test_a_raster_beyond_a_file_is_reported(name, tmp_path):
    raster = raster_for(DEVICE, rows=4)
    raster.values[:, 0], raster.values[:, 1] = 1.0, 2000.0
    (reasons,) = writing.write(name, raster, DEVICE, tmp_path / "x").left_out
    assert ("above 1000 Hz" if name in ("wav", "hjif") else "it holds") in reasons
    raster.values[:, 0], raster.values[:, 1] = 1e6, ITS_HZ
    reasons = writing.write(name, raster, DEVICE, tmp_path / "x").left_out
    assert ["above full scale" in finding for finding in reasons] == [True] * (name != "hjif")


@pytest.mark.parametrize("name", ["ahap", "haptic", "he", "he1", "openharmony", "openxr"])
def test_signals_below_the_tolerance_are_reported(name, tmp_path):
    weak = signal([0, 0.004, 0, 0, 1, 0, 0, 0.004, 0], name="weak")
    notes = written(name, [weak, signal(LOUD, name="loud")], tmp_path).notes
    (sentence,) = [note for note in notes if "weaker than the tolerance" in note]
    assert "2 times" in sentence and sentence.endswith("1 (weak)")


def test_shared_and_coarse_motors_are_reported(tmp_path):
    motor = Motor("Vest", "VestBack", 0)
    names = [f"no{k}" for k in range(8)]
    signals = [signal(LOUD, name=name) for name in ("a", "b", "faint", *names)]
    signals[2] = signal([0.0, 0.004, 0.0], name="faint")
    motors = {"a": motor, "b": motor, "faint": Motor("Vest", "VestBack", 1)}
    result = tact.write(signals, motors, tmp_path / "x")
    (nowhere, shared), (_, weak) = result.left_out, result.notes
    assert nowhere.endswith("8 (no0, no1, no2, no3, no4, no5 and 2 more)")
    assert "strongest" in shared and shared.endswith("2 (a, b)")
    assert weak.endswith("1 (faint)")


def test_changed_ticks_are_reported(tmp_path):
    ticks = (Transient(0.01, 0.2, 120.0), Transient(0.02, 0.004, 120.0))
    content = replace(signal([1.0, 1.0, 0.0, 0.0]), transients=ticks)
    (raised,) = haptic.write([content], RANGE, tmp_path / "x").left_out
    assert "1 ticks weaker" in raised and "r1c1" in raised
    (silent,) = he.write([content], RANGE, tmp_path / "x").notes
    assert "1 ticks too weak" in silent and "r1c1" in silent
    loud = signal([1.0] * 5, [ITS_HZ] * 5)
    content = replace(loud, transients=(Transient(0.01, 0.2, ITS_HZ),))
    _, notes, _ = signal_raster.raster_of([content], DEVICE, "x")
    assert ["1 ticks weaker" in finding for finding in notes] == [True]


def test_sums_reduced_to_one_frequency_are_reported(tmp_path):
    device = load_device("sound_card_8")
    raster = raster_for(device, rows=4)
    names = raster.actuators[:2]
    one, two = np.full((4, 2), 1.0), np.array([[1.0, 0.0]] * 4)
    waves = (
        Partial("a", 0, one, np.full((4, 2), 60.0)),
        Partial("b", 0, two, np.full((4, 2), 90.0)),
    )
    raster = replace(raster, waveform_actuators=names, partials=waves)
    notes = writing.write("csv", raster, device, tmp_path / "x").notes
    assert [note.rpartition(": ")[2] for note in notes] == [f"1 ({names[0]})"]
    assert writing.write("wav", raster, device, tmp_path / "x").notes == ()
    alike = replace(raster, partials=waves[:1])
    assert writing.write("csv", alike, device, tmp_path / "x").notes == ()


def test_envelope_data_beyond_hjif_is_reported(tmp_path):
    content = [signal(LOUD, [1500.0] * 5, name="high"), signal([0, 0.004, 0], name="weak")]
    result = hjif_from_actuators.write_signals(content, RANGE, tmp_path / "x")
    (high,), (_, weak) = result.left_out, result.notes
    assert "0 to 1000 Hz" in high and high.endswith("1 (high)")
    assert "too weak" in weak and weak.endswith("1 (weak)")


def test_values_clipped_by_a_reader_are_reported():
    curve = {
        "ParameterID": "HapticIntensityControl",
        "Time": 0.0,
        "ParameterCurveControlPoints": [
            {"Time": 0.0, "ParameterValue": 2.0},
            {"Time": 0.5, "ParameterValue": 1.0},
        ],
    }
    event = {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 1.0}
    pattern = {"Version": 1.0, "Pattern": [{"Event": event}, {"ParameterCurve": curve}]}
    (actual,), _ = ahap.decode(json.dumps(pattern).encode(), "x.ahap")
    assert actual.left_out == (
        "1 values of HapticIntensityControl beyond 0 to 1, taken as the nearest",
    )
    points = [{"Time": t, "Intensity": 0.5, "Frequency": 60} for t in (0, 10, 20, 30)]
    points[0]["Intensity"] = points[3]["Intensity"] = 0
    parameters = {"Intensity": 50, "Frequency": 80, "Curve": points}
    event = {"Type": "continuous", "RelativeTime": 0, "Duration": 30, "Parameters": parameters}
    document = {"Metadata": {"Version": 1}, "Pattern": [{"Event": event}]}
    (actual,), _ = he.decode(json.dumps(document).encode(), "x.he")
    assert actual.left_out == ("4 frequencies of curves beyond 0 to 100, taken as the nearest",)


def test_hjif_ticks_above_full_scale_are_reported(tmp_path):
    content = replace(signal(LOUD), transients=(Transient(0.01, 0.9, 120.0),))
    (path,) = hjif_from_actuators.write_signals([content], RANGE, tmp_path / "x").files
    document = json.loads(path.read_text())
    document["perceptions"][0]["channels"][0]["gain"] = 2.0
    path.write_text(json.dumps(document))
    ((actual,), _) = read_signals(path)
    (tick,) = actual.transients
    assert tick.amplitude == 1.0
    assert "'r1c1': 1 effects are ticks louder than full scale: cut to it" in actual.left_out


def test_an_option_without_effect_is_reported(tmp_path):
    source = tmp_path / "a.ahap"
    (path,) = ahap.write([signal(LOUD)], RANGE, tmp_path / "a").files
    path.replace(source)
    converted = conversion.convert(source, tmp_path / "b.haptic", body="Anna")
    assert any("--body says nothing" in note for note in converted.notes)
    assert not any("--body" in n for n in conversion.convert(source, tmp_path / "c.he").notes)


def test_strict_refuses_omissions(tmp_path):
    raster = raster_for(DEVICE, rows=4)
    raster.values[:, 0], raster.values[:, 1] = 1.0, 2000.0
    (path,) = writing.write("csv", raster, DEVICE, tmp_path / "a").files
    with pytest.raises(InputError, match="above 1000 Hz"):
        conversion.convert(path, tmp_path / "b.wav", device=DEVICE.id, strict=True)
    assert not (tmp_path / "b.wav").exists()


# --- clipped values, and claims of notes ------------------------------------------------------


def keyframes_of(path):
    """Return amplitude and frequency keyframes in a file's JSON: times, and shares of the range."""
    actual = json.loads(path.read_bytes())
    if path.name.endswith(".haptic"):
        envelopes = actual["signals"]["continuous"]["envelopes"]
        return [
            np.array([(point["time"], point[name]) for point in envelopes[name]]).T
            for name in ("amplitude", "frequency")
        ]
    return [
        np.array(
            [
                (item["Time"] + point["Time"], point["ParameterValue"])
                for item in (entry.get("ParameterCurve", {}) for entry in actual["Pattern"])
                if item.get("ParameterID") == control
                for point in item["ParameterCurveControlPoints"]
            ]
        ).T
        for control in ("HapticIntensityControl", "HapticSharpnessControl")
    ]


# Frequency ramps beyond the range of a file are clamped to the limit from there on.
@pytest.mark.parametrize("kind", ["ahap", "haptic"])
@pytest.mark.parametrize("hertz", [(20.0, 500.0), (500.0, 20.0), (150.0, 1000.0)])
def test_clipping_applies_at_every_time(kind, hertz, tmp_path):
    expected = signals.Signal(
        "a", Curve.of([0.0, 2.0], [0.1, 1.0]), Curve.of([0.0, 2.0], list(hertz))
    )
    written = writing.write_signals(
        FORMATS[kind],
        [expected],
        signals.FrequencyRange(80.0, 230.0),
        tmp_path / "x",
        0.01,
    )
    (claim,) = (note for note in written.notes if "keyframes are within" in note)
    percent, claimed_hz = map(float, re.findall(r"([0-9.]+)(?:%| Hz)", claim))
    amplitude, frequency = keyframes_of(written.files[0])
    times = np.linspace(0.0, 2.0, 2001)
    levels = np.interp(times, *amplitude)
    off = np.abs(levels - np.interp(times, [0.0, 2.0], [0.1, 1.0])).max()
    assert off <= percent / 100.0 + 5e-5 and percent <= 1.0
    wanted_hz = np.clip(np.interp(times, [0.0, 2.0], hertz), 80.0, 230.0)
    off_hz = np.abs(80.0 + 150.0 * np.interp(times, *frequency) - wanted_hz).max()
    assert off_hz <= claimed_hz + 0.05 and claimed_hz <= 1.6
    assert any("it holds 80 to 230 Hz" in reason for reason in written.left_out)


@pytest.mark.parametrize("kind", ["he", "openxr"])
def test_claims_hold_of_other_formats_when_they_are_read_again(kind, tmp_path):
    expected = signals.Signal(
        "a", Curve.of([0.0, 2.0], [0.1, 1.0]), Curve.of([0, 2], [20.0, 500.0])
    )
    written = writing.write_signals(
        FORMATS[kind],
        [expected],
        signals.FrequencyRange(80.0, 230.0),
        tmp_path / "x",
        0.01,
    )
    claim = next(note for note in written.notes if "keyframes are within" in note)
    _, claimed_hz = map(float, re.findall(r"([0-9.]+)(?:%| Hz)", claim))
    (read,), _ = read_signals(written.files[0])
    times = np.linspace(0.01, 1.99, 199)
    low, high = (np.clip(20.0 + 240.0 * (times + off), 80.0, 230.0) for off in (-1e-3, 1e-3))
    actual = read.frequency_hz.at(times)
    assert (actual >= low - claimed_hz - 0.05).all() and (actual <= high + claimed_hz + 0.05).all()


def test_clipping_of_mixed_signals_applies_at_every_time():
    ramp, tone = Curve.of([0.0, 1.0], [0.0, 1.0]), Curve.of([0.0], [100.0])
    actual = signals.mixed("a", [signals.Piece(0.0, 1.0, ramp, tone)] * 2)
    assert actual.amplitude.at([0.25, 0.5, 0.75]) == pytest.approx([0.5, 1.0, 1.0])


def test_sharpness_above_its_range_stays_at_its_limit():
    control = [{"Time": 0.0, "ParameterValue": 0.0}, {"Time": 1.0, "ParameterValue": 1.0}]
    curve = {"ParameterID": "HapticSharpnessControl", "Time": 0.0}
    curve["ParameterCurveControlPoints"] = control
    event = {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 1.0}
    event["EventParameters"] = [{"ParameterID": "HapticSharpness", "ParameterValue": 0.5}]
    document = {"Version": 1.0, "Pattern": [{"Event": event}, {"ParameterCurve": curve}]}
    (actual,), _ = ahap.decode(encoded(document), "x")
    assert actual.frequency_hz.at([0.25, 0.5, 0.75]) == pytest.approx([192.5, 230.0, 230.0])


def test_successive_events_of_he_join_without_a_gap():
    """In binary numbers 0.257 + 0.292 is less than 0.549."""
    point = {"Intensity": 1.0, "Frequency": 0}
    pattern_list = []
    for start, duration in ((257, 292), (549, 100)):
        curve = [{"Time": time, **point} for time in (0, 0, duration, duration)]
        parameters = {"Intensity": 50, "Frequency": 40, "Curve": curve}
        event = {"Type": "continuous", "RelativeTime": 0, "Duration": duration, "Index": 0}
        pattern = [{"Event": {**event, "Parameters": parameters}}]
        pattern_list.append({"AbsoluteTime": start, "Pattern": pattern})
    document = {"Metadata": {"Version": 2}, "PatternList": pattern_list}
    (actual,), _ = he.decode(encoded(document), "x.he")
    times, levels = actual.amplitude.times_s, actual.amplitude.values
    assert levels[(times > 0.2571) & (times < 0.6489)] == pytest.approx(0.5)
    assert 0.549 in times


def test_a_zero_error_is_reported_as_none():
    one = signal([0.5, 0.5])
    assert error_note([(one, one)]) == "keyframes are within 0.00% of full scale and 0.0 Hz"


def test_errors_consider_values_near_in_time():
    one = signals.Signal("a", Curve.of([0, 1, 1, 2], [0.2, 0.2, 0.9, 0.9]), Curve.of([0], [100.0]))
    late = signals.Signal(
        "a", Curve.of([0, 1.001, 1.001, 2], [0.2, 0.2, 0.95, 0.95]), Curve.of([0], [103.0])
    )
    assert losses.errors_of(one, late, 2e-3) == pytest.approx((0.05, 3.0))
    assert losses.errors_of(one, late, 1e-6)[0] == pytest.approx(0.7)


# A ramp from silence: any frequency at the silent end gives the same signal.
@pytest.mark.parametrize("levels", [[0.0, 0.8], [0.8, 0.0], [0.5, 0.0, 0.9]])
def test_hjif_keeps_the_frequency_of_a_ramp_from_silence(levels, tmp_path):
    times = np.linspace(0.0, 2.0, len(levels))
    expected = signals.Signal("a", Curve(times, np.array(levels)), Curve.of([0, 2], [60.0, 300.0]))
    actual = hjif_from_actuators.write_signals([expected], RANGE, tmp_path / "x", 0.01)
    (claim,) = (note for note in actual.notes if "keyframes are within" in note)
    _, claimed_hz = map(float, re.findall(r"([0-9.]+)(?:%| Hz)", claim))
    document = json.loads(actual.files[0].read_bytes())
    scale = document["timescale"]
    (band,) = document["perceptions"][0]["channels"][0]["bands"]
    for effect in band["effects"]:
        ticks = [
            effect["position"] + keyframe["relative_position"] for keyframe in effect["keyframes"]
        ]
        hertz = [keyframe["frequency_modulation"] for keyframe in effect["keyframes"]]
        at = np.linspace(ticks[0], ticks[-1], 1000)
        off = np.abs(np.interp(at, ticks, hertz) - (60.0 + 120.0 * at / scale)).max()
        assert off <= claimed_hz + 0.1 and claimed_hz <= 1.1


@pytest.mark.parametrize("kind", ["ahap", "haptic", "openxr"])
def test_sound_between_silent_keyframes_keeps_its_frequency(kind, tmp_path):
    levels = Curve.of([0, 1, 2, 4, 6], [0.0, 1.0, 0.0, 0.0, 1.0])
    expected = signals.Signal("a", levels, Curve.of([0, 2, 4, 6], [90.0, 200.0, 100.0, 150.0]))
    actual = writing.write_signals(
        FORMATS[kind], [expected], FrequencyRange(80.0, 230.0), tmp_path / "x", 0.01
    )
    (read,), _ = read_signals(actual.files[0])
    assert read.frequency_hz.at([0.5, 1.0, 1.5, 5.0]) == pytest.approx(
        [117.5, 145.0, 172.5, 125.0], abs=1.6
    )


def test_a_file_too_large_to_be_read_again_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(strict_json, "MAX_BYTES", 100)
    actual = written("haptic", [signal(LOUD)], tmp_path)
    assert len(actual.files) == 1
    assert any("is not measured" in note and "larger than" in note for note in actual.notes)
