# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of vendors' tools: playback as in the tools, and a note for every loss."""

from __future__ import annotations

import json

import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats import files
from hfx_blender.formats.device_files import (
    ahap,
    ahap_rules,
    haptic,
    he,
    he_rules,
    tact,
)
from hfx_tools.commands.conversion import convert
from hfx_tools.formats.validation import validate


def errors(findings):
    return [finding.code for finding in findings if finding.severity == "error"]


# --- AHAP ---------------------------------------------------------------------------------------


def event(kind="HapticContinuous", time=1.0, **parameters):
    listed = [{"ParameterID": key, "ParameterValue": value} for key, value in parameters.items()]
    actual = {"Time": time, "EventType": kind, "EventParameters": listed}
    return {"Event": {**actual, "EventDuration": 2.0} if "Continuous" in kind else actual}


def pattern_signal(*entries):
    (signal,), _ = ahap.decode(encoded({"Version": 1.0, "Pattern": list(entries)}), "x")
    return signal


@pytest.mark.parametrize(
    ("parameters", "times", "levels", "end_s"),
    [
        ({"AttackTime": 0.5}, [1.0, 1.25, 1.5, 2.9], [0.0, 0.4, 0.8, 0.8], 3.0),
        ({"ReleaseTime": 0.5}, [1.0, 2.9, 3.25, 3.5], [0.8, 0.8, 0.4, 0.0], 3.5),
        (
            {"AttackTime": 0.5, "DecayTime": 0.5, "Sustained": 0.0},
            [1.25, 1.5, 1.75, 2.5],
            [0.4, 0.8, 0.4, 0.0],
            3.0,
        ),
        ({"AttackTime": 4.0, "ReleaseTime": 1.0}, [2.0, 2.99, 3.5], [0.2, 0.398, 0.2], 4.0),
        ({"DecayTime": 0.5, "Sustained": 1.0}, [1.0, 2.9], [0.8, 0.8], 3.0),
    ],
)
def test_ramps_of_an_event_are_played(parameters, times, levels, end_s):
    actual = pattern_signal(event(HapticIntensity=0.8, **parameters))
    assert actual.amplitude.at(times) == pytest.approx(levels, abs=1e-6)
    assert actual.duration_s == pytest.approx(end_s)
    assert not any("Time" in reason for reason in actual.left_out)


def test_sounds_and_ramps_of_ticks_are_named_as_lost():
    actual = pattern_signal(
        event("AudioCustom"), event("HapticTransient", HapticIntensity=1.0, AttackTime=0.5)
    )
    assert "1 events of the kind AudioCustom" in actual.left_out
    assert "1 parameters AttackTime of events" in actual.left_out


def test_missing_members_have_core_haptics_defaults():
    whole = event(HapticIntensity=0.5)["Event"]
    curve = {"ParameterID": "HapticIntensityControl", "Time": 0.0}
    early = {key: value for key, value in whole.items() if key != "Time"}
    unnamed = {**whole, "EventParameters": [{"ParameterValue": 0.2}]}
    for entry, times, levels in (
        ({"Event": early}, [0.0, 1.9], [0.5, 0.5]),
        ({"Event": whole, "ParameterCurve": curve}, [0.5, 2.5], [0.0, 0.5]),
        ({"Event": unnamed}, [0.5, 2.5], [0.0, 1.0]),
    ):
        actual = pattern_signal(entry)
        assert actual.amplitude.at(times) == pytest.approx(levels)
        assert any("AHAP-MISSING" in note for note in actual.notes)
    endless = {key: value for key, value in whole.items() if key != "EventDuration"}
    actual = pattern_signal(event("HapticTransient", time=0.5), {"Event": endless})
    assert "1 continuous events without a duration" in actual.left_out


def test_more_than_16_points_are_a_warning():
    points = [{"Time": k / 10, "ParameterValue": k / 20} for k in range(20)]
    curve = {"ParameterID": "HapticIntensityControl", "Time": 0.0}
    curve["ParameterCurveControlPoints"] = points
    document = {"Version": 1.0, "Pattern": [event(), {"ParameterCurve": curve}]}
    (actual,) = ahap_rules.findings(document)
    assert (actual.code, actual.severity) == ("AHAP-CURVE-POINTS", "warning")


def test_ticks_of_a_second_pattern_are_read(tmp_path):
    tick = event("HapticTransient", time=0.25, HapticIntensity=0.5)
    for name, entry in (("x.ahap", event()), ("x.transients.ahap", tick)):
        (tmp_path / name).write_bytes(encoded({"Version": 1.0, "Pattern": [entry]}))
    (actual,), _ = files.read_signals(tmp_path / "x.ahap")
    assert [(transient.time_s, transient.amplitude) for transient in actual.transients] == [
        (0.25, 0.5)
    ]
    assert actual.amplitude.at(2.0) == 1.0
    written = convert(tmp_path / "x.ahap", tmp_path / "y.ahap")
    assert [file.name for file in written.files] == ["y.ahap", "y.transients.ahap"]
    assert "read with x.transients.ahap beside it" in written.notes


# --- members in the wrong place ---------------------------------------------------------------


def tact_with(intensity):
    points = [{"index": 0, "intensity": intensity}]
    feedback = {"startTime": 0, "endTime": 100, "pointList": points}
    mode = {"mode": "DOT_MODE", "dotMode": {"feedback": [feedback]}}
    effect = {"startTime": 0, "offsetTime": 100, "modes": {"VestBack": mode}}
    return {"project": {"tracks": [{"effects": [effect]}]}}


def misplaced(**members):
    return {"Version": 1.0, "Pattern": [{"Event": members}, event()]}


HE = {"Metadata": {"Version": 2}, "PatternList": []}
INVALID = [
    *(("tact", tact_with(value)) for value in ("NaN", "-Infinity", "1e999", "loud", "", [0.5], {})),
    ("ahap", misplaced(Time=0.0, ParameterCurveControlPoints=0.4)),
    ("ahap", misplaced(ParameterCurveControlPoints=[0.4], EventType="HapticTransient", Time=0)),
    ("ahap", misplaced(ParameterCurveControlPoints=None)),
    ("ahap", {"Version": 1.0, "Pattern": [{"Parameter": {"EventParameters": 3}}, event()]}),
    ("he", {**HE, "PatternList": 3}),
]


@pytest.mark.parametrize(("kind", "document"), INVALID)
def test_misplaced_members_are_bad_input_to_every_command(kind, document, tmp_path, capsys):
    path = tmp_path / f"x.{kind}"
    path.write_bytes(encoded(document))
    commands = (["validate"], ["info"], ["convert", str(tmp_path / "y"), "--to", "hjif"])
    for command, *rest in commands:
        assert cli.run([command, str(path), *rest]) == 3
        messages = capsys.readouterr().err
        assert messages.count("\n") == (command != "validate") and "Traceback" not in messages


# Members known in another part of the format, of any type, must be ignored here.
@pytest.mark.parametrize("value", [None, 3, "x", [], [3], {"Event": 1}])
def test_unknown_members_are_not_looked_at(value, tmp_path, capsys):
    strange = dict.fromkeys(
        ("Metadata", "MetaData", "Description", "tracks", "effects", "pointList", "feedback"), value
    )
    whole = {"Type": "transient", "RelativeTime": 0, "Index": 0, **strange}
    whole["Parameters"] = {"Intensity": 50, "Frequency": 50, **strange}
    pattern = {"AbsoluteTime": 0, "Pattern": [{"Event": whole, **strange}], **strange}
    he_document = {"PatternList": [pattern], "Metadata": {"Version": 2, **strange}}
    tick = event("HapticTransient", time=0.0)
    for kind, document in (
        ("he", he_document),
        ("ahap", {"Pattern": [{**tick, **strange}], "Version": 1.0, "pointList": value}),
        ("haptic", {**clip([(0.0, 0.5), (1.0, 0.5)]), **strange}),
    ):
        path = tmp_path / f"x.{kind}"
        path.write_bytes(encoded(document))
        assert cli.run(["info", str(path)]) == 0, kind


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [1e308, -1e308, 10**15])
def test_absurd_numbers_of_he_are_cut(value):
    curve = [{"Time": k, "Intensity": value, "Frequency": -value} for k in range(4)]
    whole = {"Type": "continuous", "RelativeTime": 0, "Duration": 3, "Index": 0}
    whole["Parameters"] = {"Intensity": value, "Frequency": value, "Curve": curve}
    pattern = {"AbsoluteTime": 0, "Pattern": [{"Event": whole}] * 2}
    document = {"Metadata": {"Version": 2}, "PatternList": [pattern]}
    (actual,), _ = he.decode(encoded(document), "x")
    assert actual.amplitude.values.min() >= 0.0 and actual.amplitude.values.max() <= 1.0


# --- .haptic, .he, .tact ------------------------------------------------------------------------


def clip(amplitude, frequency=((0.0, 0.5),), metadata=None):
    envelopes = {
        "amplitude": [{"time": time, "amplitude": value} for time, value in amplitude],
        "frequency": [{"time": time, "frequency": value} for time, value in frequency],
    }
    version = {"major": 1, "minor": 0, "patch": 0}
    signals = {"continuous": {"envelopes": envelopes}}
    return {"version": version, "metadata": metadata or {}, "signals": signals}


@pytest.mark.parametrize("late_s", [0.0, 0.014, 0.5])
def test_a_late_last_frequency_is_a_warning(late_s):
    """Lofelt's reader has no such rule; Meta's has none for older files (ValidationMode)."""
    data = encoded(clip([(0.0, 0.5), (1.0, 0.5)], [(0.0, 0.5), (1.0 + late_s, 0.5)]))
    actual = haptic.validate(data, "x")
    assert errors(actual) == [] and bool(actual) == (late_s > 0.0)
    assert haptic.decode(data, "x")[0][0].duration_s == 1.0


@pytest.mark.parametrize("points", [[(0.0, 0.5)], [(0.0, 0.5), (0.0, 0.2)]])
def test_an_envelope_without_duration_is_a_warning(points, tmp_path):
    """Lofelt's reader needs a single breakpoint; Meta's reader two, with time in between."""
    data = encoded(clip(points))
    actual = haptic.validate(data, "x")
    assert [(entry.code, entry.severity) for entry in actual] == [("HAPTIC-DURATION", "warning")]
    path = tmp_path / "x.haptic"
    path.write_bytes(data)
    for name in ("y.ahap", "y.he", "y.hjif", "y.openxr.json", "y.haptic"):
        written = convert(path, tmp_path / name)
        assert written.files or name in ("y.ahap", "y.he")  # without empty vibrations


def test_strengths_and_times_are_compared_with_32_bits():
    """Both vendors' readers compare in 32 bits: 0.6 and the nearest 32-bit number are equal."""
    document = clip([(0.0, 0.0), (0.3, 0.6000000238418579), (1.0, 0.0)])
    points = document["signals"]["continuous"]["envelopes"]["amplitude"]
    points[1]["emphasis"] = {"amplitude": 0.6, "frequency": 0.5}
    points.insert(1, {"time": 0.30000001192092896, "amplitude": 0.1})
    assert haptic.validate(encoded(document), "x") == []
    points[2]["emphasis"]["amplitude"] = 0.5999
    assert errors(haptic.validate(encoded(document), "x")) == ["HAPTIC-EMPHASIS"]


@pytest.mark.parametrize(
    ("version", "text"),
    [(0.0, "phones do not play it"), (2, "phones do not play it"), (None, "is missing")],
)
def test_versions_of_ahap_that_phones_do_not_play_are_warnings(version, text):
    document = {"Version": version, "Pattern": [event()]}
    if version is None:
        del document["Version"]
    (actual,) = ahap_rules.findings(document)
    assert (actual.code, actual.severity) == ("AHAP-VERSION", "warning") and text in actual.message
    notes = ahap.decode(encoded(document), "x")[0][0].notes
    assert any("AHAP-VERSION" in note for note in notes)
    assert ahap_rules.findings({"Version": 1, "Pattern": [event()]}) == []


@pytest.mark.parametrize("metadata", [{"tags": "a"}, {"tags": [1]}, {"author": 3}, []])
def test_metadata_of_wrong_types_is_refused_by_validate(metadata):
    document = clip([(0.0, 0.5), (1.0, 0.5)])
    document["metadata"] = metadata
    assert errors(haptic.validate(encoded(document), "x")) == ["HAPTIC-TYPE"]
    assert haptic.decode(encoded(document), "x")[0][0].notes


def test_members_that_metas_reader_takes_as_missing_may_be_null():
    document = clip([(0.0, 0.5), (1.0, 0.5)])
    document["signals"]["continuous"]["envelopes"]["amplitude"][0]["emphasis"] = None
    assert haptic.validate(encoded(document), "x") == []
    document["version"]["minor"] = 2**32  # beyond the 32 bits of the vendor's reader
    assert errors(haptic.validate(encoded(document), "x")) == ["HAPTIC-RANGE"]


def pattern_event(**members):
    parameters = {"Intensity": 100, "Frequency": 50}
    actual = {"Type": "continuous", "RelativeTime": 0, "Duration": 400, "Parameters": parameters}
    return {"Event": {**actual, **members}}


def test_patterns_of_other_tools_are_read_with_a_note():
    # Without an index, longer than the editor's maximum, two overlapping patterns.
    patterns = [
        {"AbsoluteTime": 0, "Pattern": [pattern_event(Duration=6000)]},
        {"AbsoluteTime": 500, "Pattern": [pattern_event(RelativeTime=60_000)]},
    ]
    document = {"Metadata": {"Version": 2}, "PatternList": patterns}
    assert set(errors(he_rules.findings(document))) == {"HE-MISSING", "HE-RANGE"}
    (actual,), _ = he.decode(encoded(document), "x")
    assert actual.amplitude.at([5.9, 7.0, 60.7]).tolist() == [1.0, 0.0, 1.0]
    assert any("HE-RANGE" in note for note in actual.notes)
    del patterns[0]["Pattern"][0]["Event"]["Type"]
    with pytest.raises(InputError, match="HE-MISSING"):
        he.decode(encoded(document), "x")


def test_a_suit_file_without_optional_members():
    dots = [{"index": k, "x": k % 4 / 3, "y": k // 4 / 4} for k in range(20)]
    points = [{"index": 3, "intensity": "0.5"}, {"index": 99, "intensity": 2}]
    front = {
        "mode": "DOT_MODE",
        "dotMode": {"feedback": [{"startTime": 100, "endTime": 200, "pointList": points}]},
        "pathMode": None,
    }
    back = {
        "mode": "PATH_MODE",
        "pathMode": {"feedback": [{"pointList": []}, {"pointList": [{"x": 1, "y": 0}]}]},
    }
    effect = {"startTime": 0, "offsetTime": 300, "modes": {"VestFront": front, "VestBack": back}}
    layout = {"layouts": {"VestFront": dots}}
    document = {"project": {"layout": layout, "tracks": [{"effects": [effect]}]}}
    document["durationMillis"] = 1000
    assert errors(tact.findings(document))
    signals, _ = tact.decode(encoded(document), "x")
    assert [signal.name for signal in signals] == ["VestFront 3", "VestFront 99"]
    assert signals[0].amplitude.at([0.05, 0.15, 0.25]).tolist() == [0.0, 0.5, 0.0]
    assert signals[0].duration_s == 1.0 and signals[1].amplitude.values.max() == 1.0
    assert "1 paths without points, which are silent" in signals[0].left_out
    assert any("TACT-MISSING" in note for note in signals[0].notes)


# --- kept in conversions --------------------------------------------------------------------------


@pytest.mark.parametrize("is_silent", [False, True])
@pytest.mark.parametrize(
    "suffix", ["ahap", "haptic", "he", "v1.he", "openharmony.json", "openxr.json", "hjif"]
)
def test_silence_at_the_end_is_kept(tmp_path, suffix, is_silent):
    loud = [] if is_silent else [(0.0, 0.5), (1.0, 0.5)]
    (tmp_path / "x.haptic").write_bytes(encoded(clip([*loud, (1.001, 0.0), (7.5, 0.0)])))
    written = convert(tmp_path / "x.haptic", tmp_path / f"y.{suffix}")
    (actual,), _ = files.read_signals(written.files[0])
    assert actual.duration_s == pytest.approx(7.5, abs=0.002)
    assert actual.amplitude.at(0.5) == pytest.approx(0.0 if is_silent else 0.5, abs=0.011)
    assert not actual.amplitude.at([2.0, 7.0]).any()
    assert ("all of it is silent" in written.notes) == is_silent


def test_every_companion_file_of_a_sound_is_known(tmp_path, capsys):
    (tmp_path / "x.haptic").write_bytes(encoded(clip([(0.0, 0.5), (0.1, 0.5)])))
    written = convert(tmp_path / "x.haptic", tmp_path / "y.wav", device="back_pad")
    listed = tmp_path / "y.wav.channels.json"
    assert listed in written.files
    assert cli.run(["validate", *map(str, written.files)]) == 0
    assert cli.run(["info", str(listed)]) == 0
    assert "device: back_pad" in capsys.readouterr().out
    document = json.loads(listed.read_text())
    document["channels"] = document["channels"][::-1]
    listed.write_bytes(encoded(document))
    assert errors(validate(listed)[1])[0] == "CHANNELS-ORDER"
    assert np.isfinite(document["full_scale_m_s2"])
