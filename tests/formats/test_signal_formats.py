# SPDX-License-Identifier: GPL-3.0-or-later
"""AHAP, .haptic, .he and OpenXR: valid output and exact round trips."""

from __future__ import annotations

import json

import numpy as np
import pytest
from format_cases import RANGE, signal, signals
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats import files, registry
from hfx_blender.formats.device_files import (
    ahap,
    ahap_rules,
    haptic,
    he,
    he_events,
    he_rules,
    openxr,
)
from hfx_blender.formats.files import read_signals
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.signals.signals import (
    FrequencyRange,
    Signal,
    Transient,
    simplified_signals,
)
from hfx_blender.formats.writing import write, write_signals
from hfx_tools.formats.signal_raster import raster_of
from hfx_tools.formats.validation import validate

FORMATS = {
    "ahap": (ahap.document, ahap_rules.validate, ahap.decode, 0.0),
    "haptic": (haptic.document, haptic.validate, haptic.decode, 0.0),
    "he": (he.document, he_rules.validate, he.decode, 0.5e-3),
    "openxr": (lambda s, r: openxr.document([s], r), openxr.validate, openxr.decode, 0.0),
}

# Simplified, the frequency has a keyframe 0.1 ms before the zero at 66.7 ms: .he has one of both.
FREQUENCY_KEY_NEAR_A_ZERO = signal(
    [0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0],
    np.interp(np.linspace(0, 3, 12), range(4), [83.5, 67.75, 71.75, 50.0]),
    rate_hz=60.0,
)


def round_trip(kind, content, frequencies=RANGE):
    """Write a simplified signal, validate the file, and return the signal read back."""
    document, validate, decode, _ = FORMATS[kind]
    data = encoded(document(content, frequencies))
    assert validate(data, "x") == []
    (actual, *others), hertz = decode(data, "x")
    assert not others
    return actual, hertz


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=40, deadline=None)
@example(content=FREQUENCY_KEY_NEAR_A_ZERO)
@given(content=signals())
def test_a_signal_survives(kind, content):
    (few,) = simplified_signals([content])
    if few.is_silent:
        return
    actual, hertz = round_trip(kind, few)
    assert hertz.lowest_hz == pytest.approx(RANGE.lowest_hz)
    assert hertz.highest_hz == pytest.approx(RANGE.highest_hz)
    off_s = FORMATS[kind][3]
    times = np.linspace(0.0, content.duration_s, 301)[:-1]
    around = np.clip(times[:, None] + np.linspace(-2 * off_s, 2 * off_s, 41), 0, None)
    original = content.amplitude.at(around)
    level = actual.amplitude.at(times)
    slack = 0.01 + 1e-4 + np.abs(np.diff(original, axis=1)).max(initial=0.0)
    assert np.all(level >= original.min(axis=1) - slack)
    assert np.all(level <= original.max(axis=1) + slack)
    sounds = content.amplitude.at(times) > 0.05
    off_hz = np.abs(actual.frequency_hz.at(times) - content.frequency_hz.at(times))[sounds]
    # .he: half a millisecond of 25 kHz a second at most, and two hundredths of the range.
    assert off_hz.max(initial=0.0) <= 1.0 + 1e-2 + off_s * (25_000 + 8_000)


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=40, deadline=None)
@given(content=signals(most=20, ticks=True))
def test_ticks_survive(kind, content):
    (few,) = simplified_signals([content])
    if kind == "ahap":
        data = encoded(ahap.ticks(few, RANGE))
        assert ahap_rules.validate(data, "x") == []
        ((actual,), _) = ahap.decode(data, "x")
    elif not few.is_silent:
        actual, _ = round_trip(kind, few)
    else:
        return
    transients = sorted(content.transients, key=lambda each: each.time_s)
    ticks = sorted(actual.transients, key=lambda each: each.time_s)
    assert [t.time_s for t in ticks] == pytest.approx([t.time_s for t in transients], abs=0.6e-3)
    for first, second in zip(ticks, transients, strict=True):
        # Emphasis is never weaker than the envelope at the same time.
        level = second.amplitude
        if kind == "haptic":
            level = max(level, float(few.amplitude.at(second.time_s)))
        assert first.amplitude == pytest.approx(level, abs=0.006)
        assert first.frequency_hz == pytest.approx(second.frequency_hz, abs=1.01)


@pytest.mark.parametrize("kind", FORMATS)
def test_one_frequency_is_kept(kind):
    (few,) = simplified_signals([signal([0.0, 1.0, 0.5, 0.0], [120.0] * 4)])
    actual, hertz = round_trip(kind, few, FrequencyRange(120.0, 120.0))
    assert actual.frequency_hz.values == pytest.approx(120.0)
    assert hertz == FrequencyRange(120.0, 120.0)


@pytest.mark.parametrize("kind", FORMATS)
def test_very_many_keyframes(kind):
    random = np.random.default_rng(4)
    count = 20_000  # quadratic time would take minutes here
    content = signal(random.random(count), rate_hz=100.0)
    actual, _ = round_trip(kind, content)
    times = np.arange(0, count, 997) / 100.0
    off = np.abs(actual.amplitude.at(times) - content.amplitude.at(times))
    assert off.max() <= 1e-3


@pytest.mark.parametrize("kind", ["ahap", "haptic", "he"])
def test_a_silent_actuator_gets_no_file(kind, tmp_path):
    module = {"ahap": ahap, "haptic": haptic, "he": he}[kind]
    written = module.write([signal([0, 0]), signal([0, 1], name="b")], RANGE, tmp_path / "x.pad")
    assert [path.name for path in written.files] == [f"x.pad.b.{kind}"]
    assert "r1c1" in written.notes[0]


def test_names_that_are_no_file_names_get_files(tmp_path):
    names = ["a/b\\c", "..", "", "Zoë 手", "con:", "x" * 60]
    contents = [signal([0, 1, 0], name=name) for name in names]
    written = haptic.write(contents, RANGE, tmp_path / "scene")
    assert sorted(tmp_path.iterdir()) == sorted(written.files)
    assert len(set(written.files)) == len(names)
    titles = [haptic.decode(path.read_bytes(), path.name)[0][0].name for path in written.files]
    assert titles == [name or path.stem for name, path in zip(names, written.files, strict=True)]


# --- the limits of each format -------------------------------------------------------------


def test_ahap_events_and_curves_keep_their_limits():
    content = signal(np.random.default_rng(1).random(10_000), rate_hz=100.0)
    pattern = ahap.document(content, RANGE)["Pattern"]
    events = [event["Event"] for event in pattern if "Event" in event]
    curves = [event["ParameterCurve"] for event in pattern if "ParameterCurve" in event]
    assert max(event["EventDuration"] for event in events) <= 30.0
    assert sum(event["EventDuration"] for event in events) == pytest.approx(99.99, abs=1e-5)
    assert max(len(curve["ParameterCurveControlPoints"]) for curve in curves) == 16


def test_ahap_puts_ticks_into_a_second_pattern(tmp_path):
    tick = Transient(0.01, 0.8, 150.0)
    written = ahap.write([signal([0, 1, 0], transients=[tick])], RANGE, tmp_path / "x")
    assert [path.name for path in written.files] == ["x.r1c1.ahap", "x.r1c1.transients.ahap"]


def test_he_versions_keep_their_limits():
    content = signal(np.random.default_rng(1).random(3000), rate_hz=100.0)
    patterns = he.document(content, RANGE)["PatternList"]
    events = [entry["Event"] for pattern in patterns for entry in pattern["Pattern"]]
    assert max(len(pattern["Pattern"]) for pattern in patterns) == 16
    assert max(len(event["Parameters"]["Curve"]) for event in events) <= 16
    assert max(event["Duration"] for event in events) <= 5000
    hold = he.document(signal([0, 1, 1, 0], rate_hz=0.05), RANGE)  # 60 s
    assert he_rules.validate(encoded(hold), "x") == []


def refused_at(document):
    """Return the first pattern refused by a player (Android's or RichTap's library), or None."""
    last_time = last_duration = library_end = 0
    for number, pattern in enumerate(document["PatternList"]):
        start = pattern["AbsoluteTime"]
        if number and start < max(last_time + last_duration, library_end):
            return number
        for event in (entry["Event"] for entry in pattern["Pattern"]):
            last_time = event["RelativeTime"]
            if event["Type"] == "continuous":
                last_duration = event["Duration"]
            ends = start + last_time + (event["Duration"] if "Duration" in event else 48)
            library_end = max(library_end, ends)
    return None


def ticking(gap_s, level, count=90):
    """Return a signal of short sounds, each with a tick at the end, or of ticks alone."""
    ticks = [Transient(gap_s * (k + 0.8), 0.8, 150.0) for k in range(count)]
    rows = np.where(np.arange(count * 10) % 10 < 6, level, 0.0)
    return signal(rows, rate_hz=10.0 / gap_s, transients=ticks)


@pytest.mark.parametrize("gap_s", [0.1, 0.3, 7.0, 0.02])
@pytest.mark.parametrize("level", [0.0, 0.7])
def test_he_patterns_that_end_in_ticks_are_played(gap_s, level, tmp_path):
    content = ticking(gap_s, level)
    written = he.write([content], RANGE, tmp_path / "x")
    actual = json.loads(written.files[0].read_text())
    assert he_rules.findings(actual) == [] and refused_at(actual) is None
    assert max(len(entry["Pattern"]) for entry in actual["PatternList"]) <= 16
    times = [
        item["AbsoluteTime"] + entry["Event"]["RelativeTime"]
        for item in actual["PatternList"]
        for entry in item["Pattern"]
        if entry["Event"]["Type"] == "transient"
    ]
    late = np.sort(times) - [1000.0 * tick.time_s for tick in content.transients]
    assert late.min() >= -0.5
    if gap_s >= 0.1:
        assert late.max() <= 0.5 and written.left_out == ()
    else:  # no pause of 48 ms anywhere
        assert late.max() < 48.0 and "ticks closer" in written.left_out[0]


def test_he_patterns_that_a_player_refuses_are_found():
    sound = {"Type": "continuous", "RelativeTime": 0, "Duration": 60, "Index": 0}
    sound["Parameters"] = {"Intensity": 50, "Frequency": 50}
    tick = {**sound, "Type": "transient", "RelativeTime": 80}
    del tick["Duration"]
    actual = {"Metadata": {"Version": 2}, "PatternList": []}
    for start in (0, 100):
        pattern = [{"Event": sound}, {"Event": tick}]
        actual["PatternList"].append({"AbsoluteTime": start, "Pattern": pattern})
    assert refused_at(actual) == 1
    assert [finding.code for finding in he_rules.findings(actual)] == [
        "HE-ABSOLUTE-TIME"
    ]  # 80 + 60
    actual["PatternList"][1]["AbsoluteTime"] = 140
    assert he_rules.findings(actual) == [] and refused_at(actual) is None


def test_he_version_1_simplifies_more_or_refuses(tmp_path):
    times = np.arange(1000) / 100.0
    gentle = signal(0.5 + 0.5 * np.sin(times * 14), rate_hz=100.0)
    written = he.write_v1([gentle], RANGE, tmp_path / "x", 0.001)
    assert any("kept within" in note for note in written.notes)
    actual = json.loads(written.files[0].read_text())
    assert len(actual["Pattern"]) <= 16
    assert he_rules.validate(written.files[0].read_bytes(), "x") == []
    wild = signal(np.random.default_rng(1).random(3000), rate_hz=100.0)
    with pytest.raises(InputError, match=r"16 events within 50 s; version 2 holds more"):
        he.write_v1([wild], RANGE, tmp_path / "wild")
    assert not list(tmp_path.glob("wild*"))


def test_an_openharmony_pattern_keeps_its_limits(tmp_path):
    content = signal(0.5 + 0.5 * np.sin(np.arange(6000) / 20.0), rate_hz=100.0)
    written = he.write_openharmony([content], RANGE, tmp_path / "x")
    data = written.files[0].read_bytes()
    assert len(data) <= 64 << 10
    assert he_rules.validate(data, "x") == []
    assert files.format_of(written.files[0]).id == "openharmony"
    wild = signal(np.random.default_rng(1).random(9000), rate_hz=100.0)
    with pytest.raises(InputError, match=r"128 events and 64 KiB"):
        he.write_openharmony([wild], RANGE, tmp_path / "wild")


def test_openxr_frames_hold_500_points_at_most():
    content = signal(np.random.default_rng(1).random(4000), np.linspace(50, 250, 4000))
    frames = openxr.document([content], RANGE)["channels"][0]["frames"]
    assert max(len(frame["amplitudePoints"]) for frame in frames) == 500
    kinds = [frame["streamFrameType"] for frame in frames]
    assert kinds[0] == "FIRST_FRAME" and kinds[-1] == "LAST_FRAME"
    assert set(kinds[1:-1]) == {"INTERMEDIATE_FRAME"}
    bend = signal([0.0, 1.0, 0.0], rate_hz=1.0)
    many = np.linspace(0.0, 2.0, 3000)
    wavering = type(bend)(
        "x", bend.amplitude, type(bend.amplitude)(many, 100 + 50 * np.sin(9 * many))
    )
    data = encoded(openxr.document([wavering], RANGE))
    assert openxr.validate(data, "x") == []


# --- rules, each broken once ---------------------------------------------------------------

AHAP = {
    "Version": 1.0,
    "Pattern": [
        {"Event": {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 1.0}},
        {
            "ParameterCurve": {
                "ParameterID": "HapticIntensityControl",
                "Time": 0.0,
                "ParameterCurveControlPoints": [
                    {"Time": 0.0, "ParameterValue": 0.0},
                    {"Time": 1.0, "ParameterValue": 1.0},
                ],
            }
        },
    ],
}
HAPTIC = {
    "version": {"major": 1, "minor": 0, "patch": 0},
    "signals": {
        "continuous": {
            "envelopes": {
                "amplitude": [
                    {"time": 0.0, "amplitude": 0.2},
                    {"time": 1.0, "amplitude": 0.5, "emphasis": {"amplitude": 0.6, "frequency": 1}},
                ],
                "frequency": [{"time": 0.0, "frequency": 0.5}, {"time": 1.0, "frequency": 0.5}],
            }
        }
    },
}
CURVE = [{"Time": t, "Intensity": i, "Frequency": 0} for t, i in [(0, 0), (9, 1), (20, 1), (99, 0)]]
EVENT = {
    "Type": "continuous",
    "RelativeTime": 0,
    "Duration": 99,
    "Index": 0,
    "Parameters": {"Intensity": 90, "Frequency": 50, "Curve": CURVE},
}
HE2 = {
    "Metadata": {"Version": 2, "Created": "", "Description": ""},
    "PatternList": [
        {"AbsoluteTime": 0, "Pattern": [{"Event": EVENT}]},
        {"AbsoluteTime": 99, "Pattern": [{"Event": EVENT}]},
    ],
}
HE1 = {"Metadata": {"Version": 1}, "Pattern": [{"Event": EVENT}]}
CONTROL = ("Pattern", 1, "ParameterCurve", "ParameterCurveControlPoints")
ENVELOPE = ("signals", "continuous", "envelopes")
FIRST = ("PatternList", 0, "Pattern", 0, "Event")
BROKEN = [
    (AHAP, ("Pattern",), None, "AHAP-MISSING"),
    (AHAP, ("Pattern", 0, "Event", "EventType"), "Haptic", "AHAP-CHOICE"),
    (AHAP, ("Pattern", 0, "Event", "EventDuration"), 31.0, "AHAP-DURATION"),
    (AHAP, ("Pattern", 0, "Event", "EventDuration"), None, "AHAP-DURATION-MISSING"),
    (AHAP, ("Pattern", 0, "Event", "Time"), True, "AHAP-TYPE"),
    (AHAP, ("Pattern", 0, "Event", "Time"), -1.0, "AHAP-RANGE"),
    (AHAP, (*CONTROL, 0, "Time"), 2.0, "AHAP-CURVE-ORDER"),
    (AHAP, (*CONTROL, 0, "ParameterValue"), 1.5, "AHAP-RANGE"),
    (AHAP, CONTROL, [{"Time": 0, "ParameterValue": 0}] * 17, "AHAP-CURVE-POINTS"),
    (AHAP, ("Pattern", 0), {}, "AHAP-ENTRY"),
    (AHAP, ("Patern",), [], "AHAP-UNKNOWN"),
    (HAPTIC, ("version", "major"), 2, "HAPTIC-RANGE"),
    (HAPTIC, (*ENVELOPE, "amplitude"), [], "HAPTIC-COUNT"),
    (HAPTIC, (*ENVELOPE, "amplitude"), [{"time": 0, "amplitude": 0}], "HAPTIC-DURATION"),
    (HAPTIC, (*ENVELOPE, "amplitude", 1, "time"), 0.0, "HAPTIC-DURATION"),
    (HAPTIC, (*ENVELOPE, "amplitude", 0, "time"), 2.0, "HAPTIC-ORDER"),
    (HAPTIC, (*ENVELOPE, "amplitude", 0, "time"), 0.5, "HAPTIC-START"),
    (HAPTIC, (*ENVELOPE, "amplitude", 1, "amplitude"), 0.9, "HAPTIC-EMPHASIS"),
    (HAPTIC, (*ENVELOPE, "frequency", 1, "time"), 1.1, "HAPTIC-FREQUENCY-TIME"),
    (HAPTIC, (*ENVELOPE, "frequency", 1, "frequency"), 1.1, "HAPTIC-RANGE"),
    (HE2, ("Metadata", "Version"), 1, "HE-VERSION"),
    (HE2, (*FIRST, "Index"), None, "HE-MISSING"),
    (HE2, (*FIRST, "RelativeTime"), 50_001, "HE-RANGE"),
    (HE2, (*FIRST, "Duration"), None, "HE-DURATION"),
    (HE2, (*FIRST, "Duration"), 98, "HE-CURVE-ENDS"),
    (HE2, (*FIRST, "Type"), "transient", "HE-TRANSIENT-CURVE"),
    (HE2, (*FIRST, "Parameters", "Curve"), CURVE[:1] + CURVE[2:], "HE-CURVE-POINTS"),
    (HE2, (*FIRST, "Parameters", "Curve", 1, "Time"), 30, "HE-CURVE-ORDER"),
    (HE2, ("PatternList", 1, "AbsoluteTime"), 98, "HE-ABSOLUTE-TIME"),
    (HE2, ("PatternList", 0, "Pattern"), [{"Event": EVENT}] * 17, "HE-EVENTS"),
    (HE1, ("Pattern", 0, "Event", "Parameters", "Curve", 3, "Intensity"), 0.1, "HE-CURVE-ZERO"),
]


def changed(document, path, value):
    """Return a copy with one member changed; None removes the member."""
    copy = json.loads(json.dumps(document))
    at = copy
    for key in path[:-1]:
        at = at[key]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return encoded(copy)


def check(document, data):
    if document is AHAP:
        return ahap_rules.validate(data, "x")
    return haptic.validate(data, "x") if document is HAPTIC else he_rules.validate(data, "x")


@pytest.mark.parametrize(("document", "path", "value", "code"), BROKEN, ids=lambda x: None)
def test_a_broken_rule_is_found_by_its_code(document, path, value, code):
    assert check(document, encoded(document)) == []
    actual = check(document, changed(document, path, value))
    assert code in [entry.code for entry in actual], actual
    named = next(entry for entry in actual if entry.code == code)
    last = next((str(k) for k in reversed(path) if isinstance(k, str)), "")
    assert last.split("[")[0] in named.place + named.message or path[0] in named.place


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"\xff",
        b'{"a":1,"a":2}',
        b'{"a":NaN}',
        b'{"a":1e999}',
        b"[" * 100_000,
        b"9" * 100,
    ],
)
@pytest.mark.parametrize("suffix", [".ahap", ".haptic", ".he", ".tact", ".openxr.json", ".hjif"])
def test_an_invalid_document_is_refused_in_one_sentence(content, suffix, tmp_path):
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        files.read_signals(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


# --- files in the manner of other tools ----------------------------------------------------


def test_a_fault_does_not_hide_behind_a_thousand_others():
    ticks = [{"Event": {"Time": 0.1, "EventType": "HapticTransient", "odd": 1}}] * 1200
    document = {"Version": 1.0, "Pattern": [*ticks, {"Event": {"Time": "no"}}]}
    findings = ahap_rules.validate(encoded(document), "x")
    assert [finding.place for finding in findings if finding.code == "AHAP-TYPE"] == [
        "Pattern[1200].Event.Time"
    ]
    assert len(findings) < 1100
    with pytest.raises(InputError, match="AHAP-TYPE"):
        ahap.decode(encoded(document), "x")


def test_an_ahap_of_defaults_is_read():
    """Single parameters, ticks, values out of range and audio are read as in Apple's reader."""
    pattern = [
        {"Event": {"Time": 0.5, "EventType": "HapticTransient"}},
        {"Event": {"Time": 0.0, "EventType": "AudioCustom", "EventWaveformPath": "a.wav"}},
        {
            "Event": {
                "Time": 1.0,
                "EventType": "HapticContinuous",
                "EventDuration": 2.0,
                "EventParameters": [{"ParameterID": "HapticIntensity", "ParameterValue": 1.5}],
            }
        },
        {
            "Parameter": {
                "ParameterID": "HapticIntensityControl",
                "Time": 2.0,
                "ParameterValue": 0.25,
            }
        },
    ]
    ((actual,), hertz) = ahap.decode(encoded({"Pattern": pattern}), "folder/tap.ahap")
    assert actual.name == "tap" and hertz == ahap.DEFAULT_RANGE
    assert [(t.time_s, t.amplitude) for t in actual.transients] == [(0.5, 1.0)]
    assert actual.amplitude.at([0.9, 1.5, 2.5]).tolist() == [0.0, 1.0, 0.25]


def test_overlapping_he_events_add():
    loud = json.loads(json.dumps(EVENT))
    loud["Parameters"] = {"Intensity": 40, "Frequency": 50}
    entries = [{"Event": loud}, {"Event": {**loud, "RelativeTime": 50}}]
    actual = {"Metadata": {"Version": 2}, "PatternList": [{"AbsoluteTime": 0, "Pattern": entries}]}
    ((both,), _) = he.decode(encoded(actual), "two.he")
    assert both.amplitude.at([0.02, 0.07, 0.12]) == pytest.approx([0.4, 0.8, 0.4])


@given(st.binary(max_size=200))
@settings(max_examples=50)
def test_any_bytes_are_read_or_refused(content):
    for decode in (ahap.decode, haptic.decode, he.decode, openxr.decode):
        with pytest.raises(InputError):
            decode(content, "x")


def _two_ticks():
    """Return half strength for a second at 150 Hz, with ticks at 0.2 and 0.7 s."""
    kinds = (Transient(0.2, 0.8, 50.0), Transient(0.7, 0.4, 250.0))
    return signal([0.5] * 100 + [0.0], [150.0] * 101, transients=kinds)


def test_the_ticks_of_an_envelope_are_a_pattern_of_their_own(tmp_path):
    """50 to 250 Hz map to sharpness 0 to 1, so 150 Hz is 0.5."""
    written = write_signals(registry.FORMATS["ahap"], [_two_ticks()], RANGE, tmp_path / "x", 0.01)
    assert [path.name for path in written.files] == ["x.r1c1.ahap", "x.r1c1.transients.ahap"]
    envelope, ticks = (json.loads(path.read_text())["Pattern"] for path in written.files)
    assert not any("HapticTransient" in str(item) for item in envelope)
    events = [tick["Event"] for tick in ticks]
    assert [event["EventType"] for event in events[:2]] == ["HapticTransient"] * 2
    values = [
        (event["Time"], *(one["ParameterValue"] for one in event["EventParameters"]))
        for event in events[:2]
    ]
    assert values == [pytest.approx((0.2, 0.8, 0.0)), pytest.approx((0.7, 0.4, 1.0))]
    for path in written.files:
        assert [finding for finding in validate(path)[1] if finding.severity == "error"] == []
    (read,), _ = read_signals(written.files[0])
    assert [transient.time_s for transient in read.transients] == pytest.approx([0.2, 0.7])
    assert read.amplitude.at(np.array([0.5])) == pytest.approx([0.5], abs=0.01)


def test_ticks_are_in_the_strengths_of_a_tact_file(tmp_path):
    """Strengths have steps of 20 ms: ticks rise above the envelope only in the tick's step."""
    device = load_device("bhaptics_tactsuit_x40")
    raster, _, _ = raster_of([_two_ticks()], device, "x")  # on every motor
    written = write("tact", raster, device, tmp_path / "x")
    (path,) = written.files
    assert [finding for finding in validate(path)[1] if finding.severity == "error"] == []
    (read, *_), _ = read_signals(path)
    at = read.amplitude.at(np.array([0.1, 0.21, 0.5, 0.71, 0.9]))
    assert at == pytest.approx([0.5, 0.8, 0.5, 0.5, 0.5], abs=0.06)


@pytest.mark.parametrize(("tick_s", "kept"), [(0.1, (101, 1.0)), (0.101, (100, 0.5))])
def test_an_event_of_version_1_that_is_cut_at_a_jump_keeps_its_other_side(tick_s, kept):
    """A jump from 0.5 to 1 within the millisecond after 100 ms, cut by a tick at one of both."""
    tick = Transient(tick_s, 0.5, 120.0)
    jump = Signal(
        "r1c1",
        Curve(np.array([0.0, 0.1, 0.101, 0.2]), np.array([0.5, 0.5, 1.0, 1.0])),
        Curve(np.array([0.0]), np.array([120.0])),
        (tick,),
    )
    events = he_events.events_of(jump, RANGE, falls_to_zero=True)
    points = {(e.start_ms + ms, level) for e in events for ms, level, _ in e.points}
    assert kept in points


@pytest.mark.parametrize("falls_to_zero", [False, True])
@pytest.mark.parametrize("rate_hz", [20.0, 400.0, 1000.0, 4000.0])
@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_points_of_a_he_event_have_different_times(falls_to_zero, rate_hz, data):
    """Also of sounds of a millisecond, between ticks of successive milliseconds, and at 5 s."""
    levels = data.draw(st.lists(st.sampled_from([0.0, 0.0, 0.4, 1.0]), min_size=2, max_size=40))
    hold = data.draw(st.sampled_from([1, 150]))
    last_s = (len(levels) * hold - 1) / rate_hz
    ticks = data.draw(st.lists(st.floats(0.0, last_s), max_size=4))
    content = signal(
        np.repeat(levels, hold),
        rate_hz=rate_hz,
        transients=[Transient(time, 0.5, 100.0) for time in ticks],
    )
    (few,) = simplified_signals([content], 0.01)
    events = he_events.events_of(few, RANGE, falls_to_zero=falls_to_zero)
    for item in events:
        if item.transient is None:
            times = [time for time, _, _ in item.points]
            assert 4 <= len(times) <= 16 and (np.diff(times) > 0).all(), times
            assert times[0] == 0 and 3 <= times[-1] <= 5000
    played = sorted(item.start_ms for item in events if item.transient)
    wanted = sorted(round(1000.0 * time) for time in ticks)
    assert all(abs(a - b) <= 2 for a, b in zip(played, wanted, strict=True))


def test_a_sound_of_two_milliseconds_has_four_points():
    """A peak of 0.8 between zeros at 1 and 3 ms: the event ends with a further zero at 4 ms."""
    (event,) = he_events.events_of(
        signal([0, 0, 0.8, 0, 0], rate_hz=1000.0), RANGE, falls_to_zero=False
    )
    assert event.start_ms == 1
    assert [(time, level) for time, level, _ in event.points] == [(0, 0), (1, 0.8), (2, 0), (3, 0)]


def test_ticks_next_to_the_end_of_an_event_are_at_its_end():
    """No event may last 1 or 2 ms: the ticks at 1, 101 and 199 ms move by a millisecond."""
    ticks = [Transient(time_s, 0.5, 100.0) for time_s in (0.001, 0.1, 0.101, 0.199)]
    content = signal([0.5, 0.5], rate_hz=5.0, transients=ticks)
    events = he_events.events_of(content, RANGE, falls_to_zero=False)
    assert [e.start_ms for e in events if e.transient] == [0, 100, 100, 200]
    assert [(e.start_ms, e.end_ms) for e in events if not e.transient] == [(0, 100), (100, 200)]


def test_an_event_of_five_seconds_leaves_no_short_rest():
    """5.001 s at a constant level: the second event would last 1 ms, and lasts 3 ms."""
    content = Signal(
        "r1c1",
        Curve(np.array([0.0, 5.001]), np.array([0.5, 0.5])),
        Curve(np.array([0.0]), np.array([120.0])),
    )
    events = he_events.events_of(content, RANGE, falls_to_zero=False)
    assert [(e.start_ms, e.end_ms) for e in events] == [(0, 4998), (4998, 5001)]
    assert {level for e in events for _, level, _ in e.points} == {0.5}


def test_a_sound_of_one_millisecond_is_silent_a_millisecond_later():
    """0.8 from 0 to 1 ms, then silence: 0 from 2 ms on, not on a line down to 3 ms."""
    content = Signal(
        "r1c1",
        Curve(np.array([0.0, 0.001, 0.001]), np.array([0.8, 0.8, 0.0])),
        Curve(np.array([0.0]), np.array([120.0])),
    )
    (event,) = he_events.events_of(content, RANGE, falls_to_zero=False)
    points = [(time, level) for time, level, _ in event.points]
    assert points == [(0, 0.8), (1, 0.8), (2, 0.0), (3, 0.0)]
