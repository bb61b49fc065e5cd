# SPDX-License-Identifier: GPL-3.0-or-later
"""bHaptics .tact: dots at the device's actuators, valid files, and round trips."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from format_cases import raster_for, signal, signals
from hypothesis import given, settings

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.device_config import BhapticsEncoder
from hfx_blender.errors import InputError
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats import writing
from hfx_blender.formats.device_files import tact
from hfx_blender.formats.device_files.tact_layouts import Motor, motors_of
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import npz_reader

BACK = Motor("Vest", "VestBack", 0)


def played(content):
    data = encoded(tact.document([content], {content.name: BACK}, "Vest", "x"))
    assert tact.validate(data, "x") == []
    return tact.decode(data, "x")[0]


@given(signals())
@settings(max_examples=40, deadline=None)
def test_each_20_ms_has_the_strongest_value(content):
    actual = played(content)
    if content.amplitude.values.max() < 0.005:
        return
    (one,) = actual
    for step in range(int(content.duration_s / 0.02)):
        at = (step + np.linspace(0.0, 1.0, 21)) * 0.02
        at = at[at <= content.duration_s]
        strongest = content.amplitude.at(at).max()
        inside = content.amplitude.times_s
        rows = content.amplitude.values[(inside >= at[0]) & (inside <= at[-1])]
        strongest = max(strongest, rows.max(initial=0.0))
        assert one.amplitude.at(step * 0.02 + 0.01) == pytest.approx(strongest, abs=0.0101 + 0.06)


def test_the_back_pad_is_the_back_of_the_vest():
    motors = motors_of(load_device("back_pad"))
    # r1c1 at the left shoulder blade is dot 0; r5c4 on the right is the last dot.
    expected = {
        f"r{r + 1}c{c + 1}": Motor("Vest", "VestBack", 4 * r + c)
        for r in range(5)
        for c in range(4)
    }
    assert motors == expected


def test_a_forearm_band_is_a_sleeve_on_its_side():
    for side, group in (("left", "ForearmL"), ("right", "ForearmR")):
        motors = motors_of(load_device(f"forearm_band_{side}"))
        assert {motor.position for motor in motors.values()} == {group}
        assert sorted(m.index for m in motors.values()) == list(range(len(motors)))


def _levels_at(document, time_ms):
    """Return the strength of each dot at a time, as the Player plays the file."""
    levels = {}
    for track in document["project"]["tracks"]:
        for effect in track["effects"]:
            for group, mode in effect["modes"].items():
                for feedback in mode["dotMode"]["feedback"]:
                    start, end = (
                        effect["startTime"] + feedback[k] for k in ("startTime", "endTime")
                    )
                    if start <= time_ms < end:
                        for dot in feedback["pointList"]:
                            levels[group, dot["index"]] = dot["intensity"]
    return levels


@pytest.mark.parametrize(
    ("name", "places"),
    [
        (
            "bhaptics_tactsuit_x40",
            [(side, k) for side in ("VestFront", "VestBack") for k in range(20)],
        ),
        ("bhaptics_tactosy_left", [("ForearmL", k) for k in range(6)]),
        ("bhaptics_tactosy_right", [("ForearmR", k) for k in range(6)]),
    ],
)
def test_each_motor_of_a_suit_is_at_the_dot_of_its_configuration(name, places, tmp_path):
    device = load_device(name)
    rows = np.zeros((40, 2 * len(places)))
    rows[:, 0::2] = 0.15 * (1 + np.arange(len(places)))  # 15 m/s^2 is full scale
    rows[:, 1::2] = 100.0
    written = writing.write("tact", raster_for(device, rows, len(rows)), device, tmp_path / "x")
    (file,) = written.files
    actual = _levels_at(json.loads(file.read_text()), 100)
    assert actual == {location: (k + 1) / 100.0 for k, location in enumerate(places)}
    assert written.left_out == ()


def test_dots_of_head_hand_and_foot_have_a_layout():
    encoder = BhapticsEncoder((("Head", 5), ("HandL", 2), ("FootR", 0)))
    shipped = load_device("bhaptics_tactsuit_x40")
    output = dataclasses.replace(shipped.output, encoder=encoder)
    device = dataclasses.replace(shipped, actuators=shipped.actuators[:3], outputs=(output,))
    motors = list(motors_of(device).values())
    assert motors == [
        Motor("Head", "Head", 5),
        Motor("Hands", "HandL", 2),
        Motor("Feet", "FootR", 0),
    ]
    for motor in motors:
        document = tact.document([signal([1, 1], name="a")], {"a": motor}, motor.kind, "x")
        assert tact.validate(encoded(document), "x") == []
        assert _levels_at(document, 0) == {(motor.position, motor.index): 1.0}


def test_actuators_without_motors_are_reported(tmp_path):
    device = load_device("insoles")
    with pytest.raises(InputError, match="torso or a forearm"):
        writing.write("tact", raster_for(device), device, tmp_path / "x")
    written = tact.write(
        [signal([0, 1], name="a"), signal([1, 1], name="b")], {"a": BACK}, tmp_path / "x"
    )
    assert "b" in written.left_out[0]


def test_a_device_is_written_and_read_back(tmp_path):
    device = load_device("back_pad")
    written = writing.write("tact", raster_for(device), device, tmp_path / "scene.back_pad")
    assert [path.name for path in written.files] == ["scene.back_pad.tact"]
    actual, _ = tact.decode(written.files[0].read_bytes(), "scene.tact")
    assert {entry.name for entry in actual} == {f"VestBack {k}" for k in range(20)}


def test_everything_that_the_official_parser_needs_is_there():
    actual = tact.document([signal([0, 1, 0])], {"r1c1": BACK}, "Vest", "x")
    assert {"intervalMillis", "size", "durationMillis", "project"} <= set(actual)
    (effect,) = actual["project"]["tracks"][0]["effects"]
    assert (
        set(effect["modes"])
        == {"VestFront", "VestBack"}
        == set(actual["project"]["layout"]["layouts"])
    )
    for mode in effect["modes"].values():
        assert "dotMode" in mode and mode["pathMode"]["feedback"][0]["playbackType"] == "NONE"
    assert "offsetTime" in effect


def test_long_silence_ends_an_effect():
    levels = np.zeros(300)
    levels[[10, 200]] = 1.0
    actual = tact.document([signal(levels)], {"r1c1": BACK}, "Vest", "x")
    assert len(actual["project"]["tracks"][0]["effects"]) == 2


def test_files_in_the_manner_of_other_tools_are_read():
    """Text as numbers, fades, a path, a disabled track and unknown members are accepted."""
    actual = json.loads(encoded(tact.document([signal([0, 0])], {"r1c1": BACK}, "Vest", "x")))
    dot = {
        "startTime": 0,
        "endTime": 200,
        "playbackType": "FADE_OUT",
        "pointList": [{"index": 9, "intensity": "0.500", "extra": 1}],
    }
    path = {
        "playbackType": "NONE",
        "movingPattern": "CONST_SPEED",
        "pointList": [
            {"x": "0.0", "y": "0.0", "intensity": "1.0", "time": 0},
            {"x": "1.0", "y": "1.0", "intensity": "0.4", "time": 100},
        ],
    }
    mode = {
        "mode": "DOT_MODE",
        "texture": 0,
        "dotMode": {"feedback": [dot]},
        "pathMode": {"feedback": [path]},
    }
    effect = {
        "startTime": 100,
        "offsetTime": 200,
        "modes": {"VestFront": mode, "VestBack": {**mode, "mode": "PATH_MODE"}},
    }
    actual["project"]["tracks"] = [
        {"enable": True, "effects": [effect]},
        {"enable": False, "effects": [effect]},
    ]
    actual["durationMillis"] = 400
    read = {entry.name: entry for entry in tact.decode(encoded(actual), "x")[0]}
    assert set(read) == {"VestFront 9", "VestBack 0", "VestBack 19"}
    assert read["VestFront 9"].amplitude.at([0.05, 0.1, 0.2, 0.31]) == pytest.approx(
        [0, 0.5, 0.25, 0]
    )
    assert read["VestBack 0"].amplitude.at([0.15, 0.25]) == pytest.approx([1.0, 0.0])
    assert read["VestBack 19"].amplitude.at([0.15, 0.25]) == pytest.approx([0.0, 0.4])


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        (("intervalMillis",), None, "TACT-MISSING"),
        (("size",), None, "TACT-MISSING"),
        (("project", "layout"), None, "TACT-MISSING"),
        (("project", "tracks", 0, "effects", 0, "offsetTime"), None, "TACT-MISSING"),
        (
            ("project", "tracks", 0, "effects", 0, "modes", "VestBack", "pathMode"),
            None,
            "TACT-MISSING",
        ),
        (
            ("project", "tracks", 0, "effects", 0, "modes", "VestBack", "dotMode"),
            None,
            "TACT-MISSING",
        ),
        (("project", "tracks", 0, "effects", 0, "startTime"), 10_000, "TACT-DURATION"),
        (("project", "layout", "layouts", "VestBack"), None, "TACT-POSITION"),
        (("project", "layout", "layouts", "VestBack"), [], "TACT-DOT"),
    ],
)
def test_a_broken_rule_is_found_by_its_code(path, value, code):
    actual = json.loads(encoded(tact.document([signal([0, 1, 0])], {"r1c1": BACK}, "Vest", "x")))
    at = actual
    for key in path[:-1]:
        at = at[key]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    assert code in [finding.code for finding in tact.validate(encoded(actual), "x")]


def test_unknown_members_are_reported_outside_projects_only():
    """bHaptics' tools store more members within a project than the player reads."""
    actual = json.loads(encoded(tact.document([signal([0, 1, 0])], {"r1c1": BACK}, "Vest", "x")))
    actual["project"]["more"] = actual["project"]["tracks"][0]["more"] = 1
    assert tact.validate(encoded(actual), "x") == []
    actual["more"] = 1
    (finding,) = tact.validate(encoded(actual), "x")
    assert (finding.code, finding.severity) == ("TACT-UNKNOWN", "warning")


def test_a_device_without_motors_costs_no_other(tmp_path):
    vest, soles = (load_device(name) for name in ("back_pad", "insoles"))
    played = [(tmp_path / f"x.{item.id}", item, raster_for(item)) for item in (vest, soles)]
    written = writing.write_all(("tact",), played, None, (vest, soles), tmp_path / "x")
    assert [path.name for path in written.files] == ["x.back_pad.tact"]
    (sentence,) = written.left_out
    assert "'insoles' has no vibration actuators on the torso" in sentence
    alone = writing.write_all(("tact",), played[1:], None, (soles,), tmp_path / "y")
    assert not alone.files and "torso or a forearm" in alone.left_out[0]


def test_a_format_that_cannot_hold_a_device_costs_nothing_else(tmp_path):
    """Version 1 of .he holds 16 events, too few for the raster of one pad."""
    pad, phone = (load_device(name) for name in ("back_pad", "phone_wide_band"))
    wild = raster_for(pad)
    wild.values[:, 2::2] = 12.0 * (np.arange(200)[:, None] // 2 % 2)
    calm = raster_for(phone)
    played = [(tmp_path / "x.pad", pad, wild), (tmp_path / "x.phone", phone, calm)]
    written = writing.write_all(("he1", "csv"), played, None, (pad, phone), tmp_path / "x")
    names = {path.name for path in written.files}
    assert {"x.pad.csv", "x.phone.csv", "x.phone.phone.v1.he"} <= names
    # Of the pad, only the first actuator has few enough events for a file.
    assert {name for name in names if name.endswith(".v1.he")} == {
        "x.phone.phone.v1.he",
        "x.pad.r1c1.v1.he",
    }
    assert all("16 events" in reason for reason in written.left_out) and len(written.left_out) == 19
    wild.values[:, 0] = wild.values[:, 4]
    written = writing.write_all(("he1", "csv"), played, None, (pad, phone), tmp_path / "x")
    assert "x.phone.phone.v1.he" in {path.name for path in written.files}
    (sentence,) = written.left_out
    assert "'back_pad'" in sentence and "16 events" in sentence


def test_a_file_of_a_suit_is_played_by_the_device_of_its_dots(tmp_path):
    """Dot 13 of the front and dot 2 of the back, in the maker's numbering, are in the suit."""
    lit = {"startTime": 0, "endTime": 400, "playbackType": "NONE"}
    actual = tact.document([signal([0, 1, 0])], {"r1c1": BACK}, "Vest", "x")
    (effect,) = actual["project"]["tracks"][0]["effects"]
    for group, index, level in (("VestFront", 13, 0.75), ("VestBack", 2, 0.5)):
        dots = [{"index": index, "intensity": level}]
        mode = {"mode": "DOT_MODE", "pathMode": {"feedback": []}}
        mode["dotMode"] = {"dotConnected": False, "feedback": [{**lit, "pointList": dots}]}
        effect["modes"][group] = mode
    (tmp_path / "x.tact").write_bytes(encoded(actual))
    convert(tmp_path / "x.tact", tmp_path / "x.raster.npz", device="bhaptics_tactsuit_x40")
    raster = npz_reader.read(tmp_path / "x.raster.npz")
    suit = load_device("bhaptics_tactsuit_x40")
    motors = dict(zip(suit.output.encoder.dots, suit.actuators, strict=True))
    full = suit.actuators[0].type.strength.highest
    levels = {
        column.actuator: values[50] / full
        for column, values in zip(raster.columns, raster.values.T, strict=True)
        if column.parameter == "amplitude_m_s2"
    }
    for dot, level in ((("VestFront", 13), 0.75), (("VestBack", 2), 0.5), (("VestBack", 3), 0.0)):
        assert levels[motors[dot].id] == pytest.approx(level)
