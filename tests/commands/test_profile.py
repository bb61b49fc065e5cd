# SPDX-License-Identifier: GPL-3.0-or-later
"""Profiles of persons: answers of a walk, and strengths between first felt and strong enough."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations.person_profile import personal
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.dispatch import ActuatorGroup
from hfx_blender.errors import InputError
from hfx_tools.persons.personal_client import PersonalClient
from hfx_tools.persons.walk import PAUSE_S, RISE_S, Walk, walked

DEVICE = "waist_belt"


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HFX_USER_DATA", str(tmp_path / "data"))


def stored(tmp_path: Path, marks: Any, device: str = DEVICE) -> Path:
    folder = tmp_path / "data" / "profiles"
    folder.mkdir(parents=True, exist_ok=True)
    document = {"schema": "hfx-profile/1", "devices": {device: marks}}
    path = folder / "ada.json"
    path.write_text(json.dumps(document))
    return path


def marked(tmp_path: Path) -> Any:
    """Return the belt with marks of the first actuator: 1, 3 and 4 m/s^2."""
    first = load_device(DEVICE).actuators[0].id
    marks = {first: {"first_felt": 1.0, "strong_enough": 3.0, "too_strong": 4.0}}
    stored(tmp_path, marks)
    return personal(load_device(DEVICE), "ada")


def test_strengths_go_from_first_felt_to_strong_enough(tmp_path: Path) -> None:
    """Of a limit m: 0 stays 0, m / 2 is 1 + (3 - 1) / 2 = 2, m and more are 3."""
    device = marked(tmp_path)
    limit = load_device(DEVICE).actuators[0].type.strength.highest
    group = ActuatorGroup(device, "vibration", load_model)
    strengths = np.zeros((5, len(device.actuators)))
    strengths[:, 0] = [0.0, 1e-6 * limit, limit / 2.0, limit, 2.0 * limit]
    strengths[:, 1] = strengths[:, 0]
    played = strengths * group.personal_factors(strengths)
    np.testing.assert_allclose(played[:, 0], [0.0, 1.0, 2.0, 3.0, 3.0], atol=1e-5)
    # The second actuator has no answers: those of the nearest, the first, hold.
    np.testing.assert_allclose(played[:, 1], [0.0, 1.0, 2.0, 3.0, 3.0], atol=1e-5)


def test_an_actuator_without_answers_has_those_of_the_nearest_of_its_modality(
    tmp_path: Path,
) -> None:
    """Of limits 10, 20, 10, 10: answers of the first and fourth are given, and count
    twice for twice the limit; the actuator of pressure has none."""
    device = load_device(DEVICE)
    limits = (10.0, 20.0, 10.0, 10.0)
    kinds = []
    for limit in limits:
        kind = device.actuators[0].type
        control = replace(kind.strength, maximum=limit, highest=limit)
        kinds.append(replace(kind, controls=(control, *kind.controls[1:])))
    kinds.append(replace(kinds[0], modality="pressure"))
    actuators = [replace(a, type=k) for a, k in zip(device.actuators[:5], kinds, strict=True)]
    marks = {
        actuators[0].id: {"first_felt": 1.0, "strong_enough": 3.0, "too_strong": 4.0},
        actuators[3].id: {"first_felt": 2.0, "strong_enough": 5.0, "too_strong": 6.0},
    }
    stored(tmp_path, marks)
    own = [a.type for a in personal(replace(device, actuators=tuple(actuators)), "ada").actuators]
    assert [kind.strength.highest for kind in own] == [4.0, 8.0, 6.0, 6.0, 10.0]
    assert [kind.marks for kind in own] == [
        (1.0, 3.0, 10.0),
        (2.0, 6.0, 20.0),
        (2.0, 5.0, 10.0),
        (2.0, 5.0, 10.0),
        None,
    ]


def test_too_strong_is_a_limit_and_never_above_the_limit_of_the_device(tmp_path: Path) -> None:
    device = marked(tmp_path)
    assert device.actuators[0].type.strength.highest == 4.0
    plain = load_device(DEVICE).actuators[0]
    marks = {"first_felt": 1.0, "strong_enough": 3.0, "too_strong": 1000.0}
    stored(tmp_path, {plain.id: marks})
    wide = personal(load_device(DEVICE), "ada").actuators[0]
    assert wide.type.strength.highest == plain.type.strength.highest


def test_no_profile_changes_nothing() -> None:
    device = load_device(DEVICE)
    assert personal(device, "") is device


@pytest.mark.parametrize(
    ("marks", "text"),
    [
        ({"first_felt": 5, "strong_enough": 3, "too_strong": 4}, "first_felt up to strong_enough"),
        ({"first_felt": 1, "strong_enough": 3}, "too_strong"),
        ({"first_felt": -1, "strong_enough": 3, "too_strong": 4}, "first_felt"),
    ],
)
def test_invalid_marks_are_named(tmp_path: Path, marks: Any, text: str) -> None:
    path = stored(tmp_path, {"a": marks})
    with pytest.raises(InputError, match=text) as fault:
        personal(load_device(DEVICE), "ada")
    assert str(path) in str(fault.value)


def test_unknown_profiles_and_devices_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'ada' is unknown; there are: none"):
        personal(load_device(DEVICE), "ada")
    stored(tmp_path, {}, "insoles")
    with pytest.raises(InputError, match=r"no device 'waist_belt'; add .* --device waist_belt"):
        personal(load_device(DEVICE), "ada")


class _Client:
    """Stand-in for the client: the last values of a device."""

    values = np.zeros(0)

    def send(self, _name: str, values: Any) -> None:
        self.values = np.array(values)


def test_answers_are_the_strengths_of_their_moments() -> None:
    """The ramp is 40 dB in 9 s: 1 % at first, 10 % after half of the time, the limit at its end."""
    device, client, keys = load_device(DEVICE), _Client(), [""]
    walk = Walk("belt", device, lambda: keys.pop() if keys else "", lambda _text: None)
    limit = device.actuators[0].type.strength.highest
    column = device.strength_columns[0]
    walk.show(client, PAUSE_S / 2.0)  # type: ignore[arg-type]
    np.testing.assert_array_equal(client.values, device.neutral)
    for share in (0.0, 0.5, 0.75):
        keys.append(" ")
        walk.show(client, PAUSE_S + share * RISE_S)  # type: ignore[arg-type]
        if share < 0.75:
            assert client.values[column] == pytest.approx(limit * 0.01 * 100.0**share)
    assert walk.marks[device.actuators[0].id] == pytest.approx(
        {
            "first_felt": 0.01 * limit,
            "strong_enough": 0.1 * limit,
            "too_strong": 10.0**-0.5 * limit,
        }
    )
    assert not client.values[column], "silent after the last answer"


def test_a_walk_without_answers_ends_with_the_limits() -> None:
    device, client = load_device(DEVICE), _Client()
    walk = Walk("belt", device, lambda: "", lambda _text: None)
    time_s = 0.0
    while time_s < walk.end_s:
        walk.show(client, time_s)  # type: ignore[arg-type]
        time_s += 0.5
        assert time_s < 120.0
    for actuator in device.actuators:
        assert set(walk.all_marks()[actuator.id].values()) == {actuator.type.strength.highest}


def test_r_repeats_an_actuator() -> None:
    device, client, keys = load_device(DEVICE), _Client(), ["r", " "]
    walk = Walk("belt", device, lambda: keys.pop() if keys else "", lambda _text: None)
    for time_s in (5.0, 6.0):
        walk.show(client, time_s)  # type: ignore[arg-type]
    keys.append("   ")
    walk.show(client, 6.0 + PAUSE_S + RISE_S / 2.0)  # type: ignore[arg-type]
    limit = device.actuators[0].type.strength.highest
    marks = walk.marks[device.actuators[0].id]
    assert list(marks.values()) == pytest.approx([0.1 * limit] * 3)


def test_large_devices_are_walked_in_two_minutes() -> None:
    order = walked(load_device("bhaptics_tactsuit_x40"))
    assert len(order) == 12 and order[0] == 0 and order[-1] == 39
    with pytest.raises(InputError, match="no actuator of vibration, pressure or wind"):
        walked(load_device("peltier_sleeve_left"))


def test_clip_values_are_sent_with_the_marks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, sent = marked(tmp_path), []
    client = PersonalClient({"belt": device})
    monkeypatch.setattr(client, "_feed", lambda *arguments: sent.append(arguments))
    monkeypatch.setattr(
        "hfx_blender.devices.live.client.encode_values", lambda values: np.array(values)
    )
    values = device.neutral
    values[device.strength_columns[0]] = load_device(DEVICE).actuators[0].type.strength.highest
    client.send("belt", values)
    assert sent[0][2][device.strength_columns[0]] == pytest.approx(3.0)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_profile_is_made_in_a_terminal(tmp_path: Path) -> None:
    """Spaces pressed all the time answer each question at once; the simulator stays in limits."""
    import pty

    master, slave = pty.openpty()
    log = tmp_path / "log.csv"
    command = [sys.executable, "-m", "hfx_blender", "profile", "make", "ada"]
    command += ["--device", "subpac_m2", "--to", "simulator", "--path", str(log)]
    process = subprocess.Popen(
        command, stdin=slave, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=os.environ
    )

    def press() -> None:
        while process.poll() is None:
            os.write(master, b" ")
            time.sleep(0.2)

    thread = threading.Thread(target=press)
    thread.start()
    output = process.communicate(timeout=60)[0].decode()
    thread.join()
    assert process.returncode == 0, output
    marks = json.loads((tmp_path / "data" / "profiles" / "ada.json").read_text())
    (own,) = marks["devices"]["subpac_m2"].values()
    limit = load_device("subpac_m2").actuators[0].type.strength.highest
    assert 0.0 < own["first_felt"] < own["strong_enough"] < own["too_strong"] < limit


def test_make_needs_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hfx_blender", "profile", "make", "ada", "--device", DEVICE]
    done = subprocess.run(
        [*command, "--to", "simulator"], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode == 2 and "needs a terminal" in done.stderr
    assert not (tmp_path / "data" / "profiles").exists()
