# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence of a device on a body that Blender tracks, after a stop, an error and another file.

``python tests/manual/processes/track_body_stops.py --trials 1000`` tracks a body, with a double of
the shipped belt's board on a pseudo terminal, and prints the times from each ending to the first
frame at the port without vibration. POSIX.
"""

from __future__ import annotations

import argparse
import logging
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import bpy
from live_timing import Board, shown

import hfx_blender
from hfx_blender.avatars.tracked_rig import HumanPose
from hfx_blender.blender import events
from hfx_blender.playback.live.body_tracking import body_tracking
from hfx_blender.playback.live.live import live

BELT = "waist_belt"


class Person:
    """Source of poses at rest, which raises once ``is_broken``."""

    title = "Person"
    is_broken = False

    def pose(self) -> HumanPose:
        if self.is_broken:
            raise RuntimeError("broken")
        return HumanPose({})

    def close(self) -> None: ...


def main_loop(condition: Callable[[], Any], limit_s: float) -> bool:
    """Call timers as Blender's main loop until a condition holds."""
    end_s = time.perf_counter() + limit_s
    while not condition():
        if time.perf_counter() > end_s:
            return False
        live.handlers.beat()
        body_tracking.step()
        bpy.context.view_layer.update()  # the devices follow the pose, as any edit
        if events.is_waiting(live.handlers.describe):
            events.remove_timers(live.handlers.describe)
            live.handlers.describe()
        time.sleep(0.002)
    return True


def end(kind: str, person: Person) -> None:
    """End the touch of a tracked body by a stop, an error or another file."""
    if kind == "stop":
        bpy.ops.hfx.live_stop_all()
    elif kind == "error":
        person.is_broken = True
        body_tracking.step()
    else:
        for handler in list(bpy.app.handlers.load_pre):
            handler(bpy.context.scene, None)


def is_felt(board: Board) -> bool:
    """Test for a vibration; a device that stopped while body models were loaded is armed again."""
    if live.states[BELT].state in ("frozen", "fault"):
        live.arm()
    return board.strength > 0.0


def run(trials: int) -> int:
    hfx_blender.register()
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    avatar = bpy.context.object
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.6, location=(0, 0, 1)
    )
    bpy.context.object.hfx.amplitude = 8.0
    board = Board("pty")
    board.start()
    bpy.ops.hfx.live_add(name=BELT)
    bpy.ops.hfx.live_connect(name=BELT, kind="DEVICE", port=board.port)
    times: dict[str, list[float]] = {}
    for number in range(trials):
        person = Person()
        body_tracking.start(avatar, person)
        live.arm()
        if not main_loop(lambda: is_felt(board), 60.0):
            print(f"trial {number}: no vibration: {live.states} {live.fault}")  # noqa: T201
            return 1
        goes_on_until_s = time.perf_counter() + random.uniform(0.02, 0.1)
        main_loop(lambda end_s=goes_on_until_s: time.perf_counter() > end_s, 1.0)
        kind = random.choice(("stop", "error", "load"))
        ended_s = time.perf_counter()
        end(kind, person)
        if not main_loop(lambda: board.strength == 0.0, 2.0):
            print(f"trial {number}: no silence after {kind}: {live.states}")  # noqa: T201
            return 1
        times.setdefault(kind, []).append(board.changed_s - ended_s)
        body_tracking.stop_all()
    for kind, seconds in sorted(times.items()):
        shown(f"{kind} to silence", seconds)
    live.close()
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=1000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HFX_USER_DATA"] = folder
        logging.disable()  # of the raised errors
        code = run(options.trials)
    sys.stdout.flush()
    os._exit(code)
