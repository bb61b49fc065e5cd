# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices of a user in a temporary folder, with approved scripts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import approval
from hfx_blender.files import resources

BAND = "my_band_left"


def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set up user devices with a band, and no approvals; return the device folder."""
    folder = tmp_path / "devices"
    folder.mkdir()
    monkeypatch.setenv("HFX_DEVICES", str(folder))
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    own_device(folder, "forearm_band", "my_band")
    return folder


def own_device(folder: Path, shipped: str, name: str, **kind: Any) -> None:
    content = json.loads((resources.device_configs() / f"{shipped}.json").read_text())
    content["id"] = name
    for actuator_type in content["actuator_types"].values():
        actuator_type.update(kind)
    (folder / f"{name}.json").write_text(json.dumps(content))


def scripted(folder: Path, source: str, name: str = BAND, *, is_approved: bool = True) -> Any:
    """Write a device with the given script."""
    (folder / f"{name.removesuffix('_left')}.py").write_text(source)
    script = approval.script_of(name)
    assert script is not None
    if is_approved:
        approval.approve(script)
    return load_device(name)
