# SPDX-License-Identifier: GPL-3.0-or-later
"""Unusual environments: editors with byte order marks, users without a home."""

from __future__ import annotations

import codecs
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations import surface_calibration
from hfx_blender.devices.live import live_settings
from hfx_blender.engine.body import model_library
from hfx_blender.files import kinds, resources
from hfx_blender.files.atomic import stored_json
from hfx_blender.formats.pictures import point_cloud
from hfx_blender.processes import start
from hfx_tools.commands import texture


def _device(path: Path) -> object:
    device = load_device(str(path))
    return device.id, [actuator.id for actuator in device.actuators]


def _table(path: Path) -> object:
    return texture.path_table(path).tolist()


def _points(path: Path) -> object:
    return point_cloud.read(path).tolist()


def _manifest(path: Path) -> object:
    return model_library.read_manifest(path.parent)


INSOLES = (resources.device_configs() / "insoles.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("read", "name", "text"),
    [
        (_device, "insoles.json", INSOLES),
        (stored_json, "x.report.json", '{"scene": "A", "files": []}'),
        (kinds.title_of, "x.json", '{"format": "hfx-device"}'),
        (_table, "path.csv", "1,2\n3,4\n"),
        (_points, "scan.xyz", "0 0 0\n1 0 0\n0 1 0\n"),
        (_manifest, model_library.MANIFEST_FILE, '{"models": {}}'),
    ],
)
def test_a_byte_order_mark_changes_nothing(
    tmp_path: Path, read: Callable[[Path], object], name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    plain = read(path)
    path.write_bytes(codecs.BOM_UTF8 + text.encode())
    assert read(path) == plain is not None


def test_a_mark_in_the_users_own_data_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HFX_USER_DATA", str(tmp_path))
    for file, load in (
        (resources.surface_calibration(), surface_calibration.load),
        (resources.live_settings(), live_settings.load),
    ):
        text = json.dumps({"insoles": 0.5} if load is surface_calibration.load else {})
        file.write_text(text)
        plain = load()
        file.write_bytes(codecs.BOM_UTF8 + text.encode())
        assert load() == plain


def test_without_a_home_there_is_no_users_data(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", none)
    for name in ("XDG_DATA_HOME", "APPDATA", "HFX_DEVICES", "HFX_USER_DATA"):
        monkeypatch.delenv(name, raising=False)
    assert not resources.user_devices().exists()
    assert not resources.time_on().parent.exists()
    monkeypatch.setenv("HFX_DEVICES", "~nobody-of-this-name/devices")
    assert not resources.user_devices().exists()


@pytest.mark.skipif(sys.platform != "linux", reason="a variable of Linux desktops")
def test_a_relative_data_folder_is_ignored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As the XDG Base Directory Specification demands: it would change with the working folder."""
    monkeypatch.delenv("HFX_USER_DATA", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", "data")
    assert resources.time_on() == tmp_path / ".local/share/hfx/time_on"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert resources.time_on() == tmp_path / "data/hfx/time_on"


@pytest.mark.skipif(shutil.which("unshare") is None, reason="needs a user without an entry")
def test_a_user_without_home_and_entry_can_validate(tmp_path: Path) -> None:
    path = tmp_path / "a.ahap"
    path.write_text(
        '{"Version": 1.0, "Pattern": [{"Event": {"Time": 0.0, "EventType": "HapticTransient", '
        '"EventParameters": []}}]}'
    )
    nobody = ["unshare", "-U", "--map-user=54321"]
    if subprocess.run([*nobody, "true"], check=False).returncode:
        pytest.skip("may not")
    variables = start.environment()
    for name in ("HOME", "XDG_DATA_HOME", "HFX_DEVICES", resources.BODY_MODELS_VARIABLE):
        variables.pop(name, None)
    done = subprocess.run(
        [*nobody, sys.executable, "-P", "-m", "hfx_blender", "validate", str(path)],
        env={**variables, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr


_WITHOUT_UTF_8 = """
import sys
from pathlib import Path
from hfx_blender.errors import HfxError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.processes.blender_session import refuse_name

def write(path):
    with atomic_file(path):
        pass

for call, name in ((write, "W\\u00e4rme.csv"), (refuse_name, sys.argv[2])):
    try:
        call(Path(sys.argv[1]) / name)
    except HfxError as error:
        print(ascii(str(error)))
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has names in UTF-16")
def test_without_utf_8_the_encoding_of_names_is_named(tmp_path: Path) -> None:
    surroundings = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-c", _WITHOUT_UTF_8, str(tmp_path), "Zo\u00eb.blend"]
    completed = subprocess.run(
        command, env={**os.environ, **surroundings}, capture_output=True, text=True, check=True
    )
    unwritable, unreadable = completed.stdout.splitlines()
    assert "cannot be written (file names are ascii here, allowed is UTF-8" in unwritable
    assert "names are ascii here, allowed is UTF-8: set LC_ALL=C.UTF-8" in unreadable
    assert not list(tmp_path.iterdir())
