# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx device``: user and shipped devices, and the information for integrators."""

from __future__ import annotations

import json

import pytest
from device_documents import FULL

from hfx_blender import cli
from hfx_blender.devices.configuration import find_file, list_devices, load_device
from hfx_blender.devices.live import discovery
from hfx_blender.devices.live.discovery import Found, FoundPort

NODE_MAP = {
    "nodes": [{"node_data": {"x": 0.1, "y": 1.2, "z": 0.1}, "radius": 0.05, "target_bone": "Chest"}]
}


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Set the user's device folder to a temporary folder."""
    folder = tmp_path / "own"
    monkeypatch.setenv("HFX_DEVICES", str(folder))
    return folder


def hfx(capsys, *arguments):
    code = cli.run([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def test_a_device_that_was_imported_is_listed_and_found_by_its_name(own, tmp_path, capsys):
    (tmp_path / "map.json").write_text(json.dumps(NODE_MAP))
    assert "vest" not in list_devices()
    code, out, _ = hfx(capsys, "device", "import", tmp_path / "map.json", "--name", "vest")
    assert code == 0 and str(own / "vest.json") in out
    assert load_device("vest").id == "vest" and "vest" in list_devices()
    assert find_file("vest") == own / "vest.json"
    code, out, _ = hfx(capsys, "device", "list", "--json")
    listed = json.loads(out)
    assert code == 0 and listed["vest"]["actuators"] == 1 and "back_pad" in listed


def test_a_device_of_the_users_own_goes_before_a_shipped_one(own):
    own.mkdir()
    (own / "back_pad.json").write_text(json.dumps(FULL | {"id": "back_pad"}))
    assert load_device("back_pad").name == "Test sleeve (left)"


def test_a_broken_device_of_the_users_own_does_not_hide_the_others(own, capsys):
    own.mkdir()
    (own / "broken.json").write_text("{")
    code, out, err = hfx(capsys, "device", "list")
    assert code == 0 and "back_pad" in out
    assert err.count("\n") == 1 and "broken.json: the content is not valid JSON" in err
    code, out, _ = hfx(capsys, "device", "list", "--json")
    assert "not valid JSON" in json.loads(out)["broken"]["fault"]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", None, "there is no such file"),
        ("folder", "folder", "is a folder"),
        ("a.json", b"", "is not valid JSON"),
        ("a.json", b'{"id": 1}', "'schema' is missing"),
        ("a.json", json.dumps(FULL | {"side": "up"}).encode(), 'side is "up", allowed is one of'),
        ("a.json", json.dumps(FULL).encode(), "actuators[1].place: its vertices were chosen on"),
    ],
)
def test_check_names_file_field_found_and_allowed_and_exits_with_3(
    own, tmp_path, capsys, name, content, message
):
    path = tmp_path / name
    if content == "folder":
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    code, out, err = hfx(capsys, "device", "check", path)
    assert code == 3 and not out
    assert err.count("\n") == 1 and str(path) in err and message in err


@pytest.mark.parametrize(("name", "is_noted"), [("test_sleeve", False), ("copy", True)])
def test_check_notes_an_id_that_is_not_the_files_name(own, tmp_path, capsys, name, is_noted):
    path = tmp_path / f"{name}.json"
    document = FULL | {"actuators": FULL["actuators"][:1], "substitutions": {}}
    path.write_text(json.dumps(document))
    code, out, err = hfx(capsys, "device", "check", path)
    assert code == 0 and "is right" in out and not err
    assert ("its id is 'test_sleeve'" in out) == is_noted


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (NODE_MAP, "Bad Name", "is no name for a device; allowed: 1 to 64"),
        (NODE_MAP, "taken", "exists already"),
        (FULL, "mine", "is a device configuration already"),
        ({"nodes": []}, "mine", "nodes is [], allowed is a list of 1 to 1000"),
        ([1], "mine", "the document is [1], allowed is an object with 'nodes'"),
        ({"actuators": [], "views": []}, "mine", "actuators is [], allowed is a list of 1 to 1000"),
    ],
)
def test_import_refuses_an_invalid_map_in_one_line(own, tmp_path, capsys, content, name, message):
    own.mkdir()
    (own / "taken.json").write_text("{}")
    (tmp_path / "map.json").write_text(json.dumps(content))
    code, out, err = hfx(capsys, "device", "import", tmp_path / "map.json", "--name", name)
    assert code == 3 and not out
    assert err.count("\n") == 1 and message in err
    assert [path.name for path in own.iterdir()] == ["taken.json"]


@pytest.mark.parametrize("arguments", [(), ("list", "more"), ("check",), ("import",), ("paint",)])
def test_wrong_usage_exits_with_2(capsys, arguments):
    assert cli.run(["device", *arguments]) == 2
    assert "usage" in capsys.readouterr().err


def test_find_names_ports_and_which_of_several_devices_of_a_server(own, monkeypatch, capsys):
    actual = [
        Found("board", "/dev/ttyACM0", "a board", "S-1"),
        Found("toy", "", "Lush (left) at a program on 127.0.0.1:12345", "Lush (left)"),
    ]
    monkeypatch.setattr(discovery, "serial_ports", lambda: [FoundPort("/dev/ttyACM0", "x", None)])
    monkeypatch.setattr(discovery, "found_devices", lambda devices, ports: actual)
    code, out, _ = hfx(capsys, "device", "find")
    assert (code, out.splitlines()) == (
        0,
        [
            "--device board --port /dev/ttyACM0: a board",
            "--device toy --unit 'Lush (left)': Lush (left) at a program on 127.0.0.1:12345",
        ],
    )
    code, out, _ = hfx(capsys, "device", "find", "--json")
    document = json.loads(out)
    assert document["ports"] == ["/dev/ttyACM0"]
    assert [device["unit"] for device in document["devices"]] == ["S-1", "Lush (left)"]
    actual.clear()
    _, out, _ = hfx(capsys, "device", "find")
    assert out == "no known device; serial ports: /dev/ttyACM0\n"
