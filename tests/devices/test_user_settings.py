# SPDX-License-Identifier: GPL-3.0-or-later
"""User settings: concurrent writes of two processes lose nothing."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path

import pytest

from hfx_blender.devices.configurations import surface_calibration
from hfx_blender.devices.host.duty_budget_store import DutyBudgetStore
from hfx_blender.devices.live import live_settings
from hfx_blender.files import resources
from hfx_blender.files.atomic import amend_json
from hfx_blender.processes import start
from hfx_tools import processes

COUNT = 30
STORES = {
    "connections": "devices.live.live_settings import LiveSettings, store as _store\n"
    "store = lambda name: _store(name, LiveSettings(port=name))",
    "calibration": "devices.configurations.surface_calibration import store as _store\n"
    "store = lambda name: _store(7.0, name)",
}
PROGRAM = """
import sys
from hfx_blender.{store}
print("ready", flush=True)
sys.stdin.read(1)
for k in range({count}):
    store(sys.argv[1] + str(k))
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set the user's data folder to a temporary folder."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.mark.parametrize("what", STORES)
def test_two_processes_that_write_at_the_same_time_lose_nothing(what: str) -> None:
    program = PROGRAM.format(store=STORES[what], count=COUNT)
    both = [
        start.start(processes.program(program, name), stdin=-1, stdout=-1, text=True)
        for name in ("one", "other")
    ]
    for process in both:
        assert process.stdout.readline() == "ready\n"
    for process in both:
        process.communicate("x")
        assert process.returncode == 0
    load = live_settings.load if what == "connections" else surface_calibration.load
    assert sorted(load()) == sorted(f"{name}{k}" for name in ("one", "other") for k in range(COUNT))


def test_a_failed_change_keeps_the_file_and_removes_the_lock(folder: Path) -> None:
    path = folder / "a.json"
    amend_json(path, lambda: {"a": 1})
    with pytest.raises(ZeroDivisionError):
        amend_json(path, lambda: {"b": 1 // 0})
    amend_json(path, lambda: {**json.loads(path.read_bytes()), "c": 2})
    assert json.loads(path.read_bytes()) == {"a": 1, "c": 2}


def test_connections_of_the_first_version_keep_their_members(folder: Path) -> None:
    """Commit 7be0f488 stored five members; later members have their defaults."""
    entry = {"kind": "DEVICE", "port": "8000", "host": "192.168.1.7", "path": "", "offset_ms": 40.0}
    resources.live_settings().parent.mkdir(parents=True)
    resources.live_settings().write_text(json.dumps({"back_pad": entry}), encoding="utf-8")
    settings = live_settings.load()["back_pad"]
    assert settings == live_settings.LiveSettings("DEVICE", "8000", "192.168.1.7", "", 40.0)
    live_settings.store("waist_belt", live_settings.LiveSettings())
    assert live_settings.load()["back_pad"] == settings


def test_time_on_of_the_first_version_is_counted(folder: Path) -> None:
    """Commit 929d0731 stored loads by the actuators' numbers. A rest since then is credited."""
    store = DutyBudgetStore(resources.time_on())
    name = hashlib.sha256(b"serial:COM3").hexdigest()[:32] + ".json"
    content = {
        "device": "serial:COM3",
        "filled": [0.25, 1.0],
        "is_resting": [False, True],
        "is_open": False,
        "wall_s": time.time(),
        "monotonic_s": time.monotonic(),
    }
    resources.time_on().mkdir(parents=True)
    (resources.time_on() / name).write_text(json.dumps(content), encoding="utf-8")
    budget = store.budget("serial:COM3")
    assert budget.load.tolist() == [0.25, 1.0] and budget.is_cooling.tolist() == [False, True]
