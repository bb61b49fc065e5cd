# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx doctor``: facts of an installation, without personal names."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.commands import doctor
from hfx_blender.devices.live import discovery
from hfx_blender.files import resources
from hfx_blender.version import __version__


def _facts(capsys: pytest.CaptureFixture[str]) -> dict[str, str]:
    assert cli.run(["doctor", "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_versions_and_libraries_are_those_in_use(capsys: pytest.CaptureFixture[str]) -> None:
    facts = _facts(capsys)
    assert facts["HFX"] == f"{__version__}, command"
    assert facts["Blender"].startswith(bpy.app.version_string)
    assert facts["Library numpy"] == np.__version__
    assert cli.run(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"Library numpy: {np.__version__}" in lines and len(lines) == len(facts)


def test_a_missing_library_is_named_with_its_use(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pythonosc", None)  # an import raises ImportError
    facts = _facts(capsys)
    assert facts["Library pythonosc"].startswith("missing (")
    assert facts["Library pythonosc"].endswith("needed for OSC")


@pytest.mark.parametrize("code", ["1 / 0", "a b", "raise OSError('no libfoo')"])
def test_damaged_libraries_are_named_beside_all_other_facts(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: str
) -> None:
    """An installation of mixed versions can fail in any way, and needs the report most."""
    for name in ("serial", "websockets"):
        for loaded in [module for module in sys.modules if module.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, loaded)
        (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    facts = _facts(capsys)
    assert facts["Library websockets"].startswith("cannot be loaded (")
    assert facts["Serial ports"].startswith("unknown (")
    assert facts["Library numpy"] == np.__version__


def test_a_device_file_with_a_fault_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HFX_DEVICES", str(tmp_path))
    shipped = resources.device_configs() / "waist_belt.json"
    (tmp_path / "belt.json").write_text(shipped.read_text())
    (tmp_path / "torn.json").write_text('{"bad json')
    named = _facts(capsys)["Devices of the user"]
    assert named == "belt, torn (has a fault: hfx device check)"


def test_ports_without_permission_are_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = SimpleNamespace(name="/dev/no_such_port", description="Belt", usb=(0x2341, 0x43))
    monkeypatch.setattr(discovery, "serial_ports", lambda: [port])
    monkeypatch.setattr(sys, "platform", "linux")
    expected = "/dev/no_such_port (Belt 2341:0043, no permission (group dialout or uucp))"
    assert _facts(capsys)["Serial ports"] == expected


def test_neither_the_home_folder_nor_the_user_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for variable in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.setenv(variable, "jane.doe")
    monkeypatch.setenv("HOME", str(tmp_path / "jane.doe"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "jane.doe"))
    monkeypatch.setenv("HFX_USER_DATA", str(tmp_path / "jane.doe" / "data"))
    monkeypatch.setenv("HFX_EFFECTS", str(tmp_path / "shared" / "jane.doe"))
    facts = _facts(capsys)
    assert "jane" not in json.dumps(facts)
    assert facts["Folder of settings"] == f"~{os.sep}data (not there yet)"
    assert facts["Folder of the user's sensations"] == f"...{os.sep}USER (not there yet)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/home/jane", "~"),
        ("/home/jane/.local/share/hfx (read only)", "~/.local/share/hfx (read only)"),
        ("/home/janet/hfx", ".../hfx"),  # another user's home
        ("/media/Jane's disk/a b/body_models", ".../body_models"),
        (
            "missing (cannot open /mnt/big disk/x.so: no file); needed for OSC",
            "missing (cannot open .../x.so: no file); needed for OSC",
        ),
        ("/Volumes/Customer X/body_models", ".../body_models"),
        ("D:\\Customer X\\hfx\\body_models", "...\\body_models"),
        (
            "/usr/lib/python3/x.so and /opt/blender/y.so",
            "/usr/lib/python3/x.so and /opt/blender/y.so",
        ),
        ("/dev/ttyUSB0 (Belt 2341:0043)", "/dev/ttyUSB0 (Belt 2341:0043)"),
        ("C:\\Program Files\\Blender\\x.dll", "C:\\Program Files\\Blender\\x.dll"),
        ("HDMI / Line 1/2 (2 channels)", "HDMI / Line 1/2 (2 channels)"),
        ("Jane's AirPods (2 channels), Janet", "USER's AirPods (2 channels), Janet"),
        ("https://example.org/a/b", "https://example.org/a/b"),
    ],
)
def test_folders_of_a_person_are_not_named(
    text: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.setenv(variable, "jane")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path.replace("~", "/home/jane"))
    assert doctor.without_personal_names(text) == expected
