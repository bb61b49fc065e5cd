# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts of forbidden events: values out of range behind the limiter, code run from a file."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.guard import Guard
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.errors import InputError
from hfx_blender.processes import blender_session

_ACTUATORS: Final = 1000
_ROWS: Final = 256
_STEP_S: Final = 0.01

_EVIL_TEXT: Final = "open({mark!r}, 'a').write('text ')\ndef register():\n    pass\nregister()\n"
_EVIL_DRIVER: Final = "(open({mark!r}, 'a').write('driver ') and 0) or frame"


def limiter(count: int) -> dict[str, Any]:
    """Push ``count`` hostile values through the devices' guard and count faults; plain data."""
    device = _large_device()
    controls = device.controls
    lowest = np.array([control.lowest for control in controls])
    highest = np.array([control.highest for control in controls])
    neutral = device.neutral
    is_strength = np.array(
        [c is a.type.strength for a in device.actuators for c in a.type.controls]
    )
    rise = np.repeat(
        [a.type.slew_per_s * _STEP_S for a in device.actuators],
        [len(a.type.controls) for a in device.actuators],
    )
    rng = np.random.default_rng(1)
    rows = _hostile_rows(rng, lowest, highest)
    guard = Guard(device)
    before = neutral
    faults = 0
    rounds = -(-count // len(controls))
    for k in range(rounds):
        roll = np.roll(rows[k % _ROWS], int(rng.integers(len(controls))))
        limited = guard.limited(roll, _STEP_S)
        is_wrong = ~np.isfinite(limited) | (limited < lowest) | (limited > highest)
        farther = np.abs(limited - neutral) - np.abs(before - neutral)
        is_wrong |= is_strength & (farther > rise * (1.0 + 1e-9))
        faults += int(np.count_nonzero(is_wrong))
        before = limited
    return {
        "trials": rounds * len(controls),
        "what": "values through the limiter, out of range or risen too fast",
        "faults": faults,
    }


def _large_device() -> DeviceConfig:
    """Build a device of 1000 actuators, all with a limited slew of strength."""
    actuators = []
    for name in ("forearm_band_left", "pressure_vest", "fan_heater", "peltier_sleeve_left"):
        for actuator in load_device(name).actuators:
            kind = replace(actuator.type, slew_per_s=200.0, maximum_on_s=0.5, rest_s=0.1)
            actuators.append(replace(actuator, type=kind))
    first = load_device("forearm_band_left")
    many = (actuators * _ACTUATORS)[:_ACTUATORS]
    return replace(first, actuators=tuple(many))


def _hostile_rows(
    rng: np.random.Generator, lowest: np.ndarray[Any, Any], highest: np.ndarray[Any, Any]
) -> np.ndarray[Any, Any]:
    """Hostile rows (256, C) of values: in range, out of range, huge, tiny, infinite, NaN."""
    size = (_ROWS, len(lowest))
    middle, reach = 0.5 * (lowest + highest), highest - lowest + 1.0
    rows = middle + reach * rng.normal(0.0, 1.0, size)
    odd = [np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -0.0, 2.0**63, -(2.0**31) - 1.0]
    is_odd = rng.random(size) < 0.1
    rows[is_odd] = rng.choice(odd, int(np.count_nonzero(is_odd)))
    return np.asarray(rows)


def opened_files(folder: Path, count: int) -> dict[str, Any]:
    """Open, link and append a .blend with a text module and a driver; count runs of their code.

    Raises
    ------
    InputError
        The file's code does not run even with permission, so the count would mean nothing.
    """
    bpy = blender_session.start()
    mark, path = folder / "was_run", folder / "evil.blend"
    with _without_driver_messages():
        _make_evil(bpy, path, mark)
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=True)
        bpy.context.scene.frame_set(3)
        ran = set(mark.read_text().split()) if mark.exists() else set()
        if ran != {"text", "driver"}:
            raise InputError(f"the trap does not work here: only {sorted(ran)} ran when allowed")
        faults = 0
        for k in range(count):
            mark.unlink(missing_ok=True)
            if k % 3 == 0:
                blender_session.open_blend(path)
            else:
                blender_session.open_blend(_empty_file(bpy, folder))
                with bpy.data.libraries.load(str(path), link=k % 3 == 1) as (source, target):
                    target.objects, target.texts = source.objects, source.texts
                for obj in target.objects:
                    bpy.context.scene.collection.objects.link(obj)
            bpy.context.scene.frame_set(2 + k % 5)
            faults += mark.exists()
    return {
        "trials": count,
        "what": "files with code opened, linked or appended, of which code ran",
        "faults": faults,
    }


@contextmanager
def _without_driver_messages() -> Iterator[None]:
    """Context with descriptors 1 and 2 redirected: Blender prints a message per blocked driver."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    duplicates = [os.dup(number) for number in (1, 2)]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in (1, 2):
            os.dup2(null, number)
        yield
    finally:
        for number, duplicate in zip((1, 2), duplicates, strict=True):
            os.dup2(duplicate, number)
        for descriptor in (*duplicates, null):
            os.close(descriptor)


def _empty_file(bpy: Any, folder: Path) -> Path:
    path = folder / "empty.blend"
    if not path.exists():
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def _make_evil(bpy: Any, path: Path, mark: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    obj = bpy.data.objects.new("Evil", None)
    bpy.context.scene.collection.objects.link(obj)
    driver = obj.driver_add("location", 0).driver
    driver.type = "SCRIPTED"
    driver.expression = _EVIL_DRIVER.format(mark=str(mark))
    text = bpy.data.texts.new("evil.py")
    text.write(_EVIL_TEXT.format(mark=str(mark)))
    text.use_module = True
    text.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    mark.unlink(missing_ok=True)
