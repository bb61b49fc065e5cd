# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence of a device on a body that Blender tracks, after a stop, errors, another and a new file.

``python tests/manual/processes/track_body_stops.py --trials 1000`` tracks a body, with the firmware
of the shipped belt's board on a pseudo terminal, and prints the times from each ending to the first
silence at the port. ``silence_trials.py`` starts this file in Blender to quit or kill it. POSIX.
"""

from __future__ import annotations

import argparse
import logging
import os
import random
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import bpy
from live_timing import DistantBoard, prioritize_session, shown

import hfx_blender
from hfx_blender.avatars.tracked_rig import HumanPose
from hfx_blender.blender import events
from hfx_blender.devices.live.host_pipe import HostPipe
from hfx_blender.playback.live.body_tracking import body_tracking
from hfx_blender.playback.live.live import live

BELT = "waist_belt"
SENT_S = [0.0]
"""Time of the last stop that Blender has sent."""
_silence = HostPipe.silence


def _noted_silence(*arguments: Any, **settings: Any) -> None:
    _silence(*arguments, **settings)
    SENT_S[0] = time.perf_counter()


HostPipe.silence = _noted_silence  # type: ignore[method-assign]


class Person:
    """Source of a pose, the T-pose at each call; raises RuntimeError while ``is_broken`` is set."""

    title = "Person"
    is_broken = False

    def pose(self) -> HumanPose:
        if self.is_broken:
            raise RuntimeError("broken")
        return HumanPose({})

    def close(self) -> None: ...


def main_loop(condition: Callable[[], Any], limit_s: float) -> bool:
    """Run the timers of devices and tracking every 2 ms, in place of Blender's main loop, until a
    condition holds. Returns False if the condition fails for ``limit_s``, seconds."""
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


def end(kind: str, person: Person, saved: str) -> float:
    """Silence the belt by an ending of :data:`KINDS`: the stop button, an error of the pose source,
    an error in a frame handler, another file, a new file. Returns the time of the ending on the
    clock of ``time.perf_counter``: of the call, for the error in a frame of its raising."""
    ended_s = time.perf_counter()
    if kind == "stop":
        bpy.ops.hfx.live_stop_all()
    elif kind == "error":
        person.is_broken = True
        body_tracking.step()
    elif kind == "frame error":
        raised_s: list[float] = []

        def broken(_scene: object) -> None:
            raised_s.append(time.perf_counter())
            raise RuntimeError("broken")

        update, live.update = live.update, broken
        bpy.context.scene.frame_set(bpy.context.scene.frame_current + 1)
        live.update = update
        ended_s = raised_s[0]
    elif kind == "load":
        bpy.ops.wm.open_mainfile(filepath=saved)
    else:
        bpy.ops.wm.read_homefile(use_empty=True)
    return ended_s


KINDS = ("stop", "error", "frame error", "load", "new")


def is_felt(board: DistantBoard) -> bool:
    """Arm the belt again if it has stopped (:func:`arm_stopped`), and test for a vibration of the
    board."""
    arm_stopped()
    return board.strength > 0.0


def arm_stopped() -> None:
    """Arm all devices if the belt is in state "frozen" or "fault", as after the loading of body
    models, during which Blender sends no heartbeats."""
    if live.states[BELT].state in ("frozen", "fault"):
        live.arm()


def prepare(folder: str) -> str:
    """Register the extension, and save a file of an avatar in a vibrating ball; returns its
    path."""
    hfx_blender.register()
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    bpy.context.object.name = "Rig"
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.6, location=(0, 0, 1)
    )
    bpy.context.object.hfx.amplitude = 8.0
    bpy.ops.hfx.live_add(name=BELT)
    saved = str(Path(folder) / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    return saved


def run(trials: int, folder: str) -> int:
    saved = prepare(folder)
    board = DistantBoard()
    board.start()
    bpy.ops.hfx.live_connect(name=BELT, kind="DEVICE", port=board.port)
    times: dict[str, list[float]] = {}
    faults = 0
    for number in range(trials):
        if "Rig" not in bpy.data.objects:
            bpy.ops.wm.open_mainfile(filepath=saved)
        person = Person()
        body_tracking.start(bpy.data.objects["Rig"], person)
        live.arm()
        if not main_loop(lambda: is_felt(board), 60.0):
            print(f"trial {number}: no vibration: {live.states} {live.fault}")  # noqa: T201
            faults += 1
            body_tracking.stop_all()
            live.close()
            bpy.ops.hfx.live_connect(name=BELT, kind="DEVICE", port=board.port)
            continue
        goes_on_until_s = time.perf_counter() + random.uniform(0.02, 0.1)
        main_loop(lambda end_s=goes_on_until_s: time.perf_counter() > end_s, 1.0)
        kind = KINDS[number % len(KINDS)]
        SENT_S[0] = 0.0
        ended_s = end(kind, person, saved)
        sent_s = SENT_S[0] - ended_s
        is_silent = main_loop(lambda: board.strength == 0.0, 2.0)
        taken_s = board.changed_s - ended_s
        if not is_silent or board.is_by_dead_man or taken_s > 0.05:
            text = f"{1000.0 * taken_s:.1f} ms" if is_silent else "no silence"
            by = "dead-man switch" if board.is_by_dead_man else "a frame"
            sent, halted_s = f"sent after {1000.0 * sent_s:.1f} ms", board.halted_s
            halted = f"{sent}; the board's process halted for {1000.0 * halted_s:.1f} ms"
            print(f"trial {number}, {kind}: {text} by {by}; {halted}: {live.states}")  # noqa: T201
        if not is_silent or board.is_by_dead_man:
            faults += 1
        else:
            times.setdefault(kind, []).append(taken_s)
        body_tracking.stop_all()
        sys.stdout.flush()
    for kind, seconds in sorted(times.items()):
        shown(f"{kind} to silence", seconds)
    print(f"{faults} faults")  # noqa: T201
    live.close()
    board.close()
    return int(faults > 0)


def run_until_quit(descriptor: int, port: str, folder: str) -> None:
    """Track until SIGUSR1, then write the time to a pipe and return, so that this Blender quits."""
    prepare(folder)
    received: list[int] = []
    signal.signal(signal.SIGUSR1, lambda number, _frame: received.append(number))
    bpy.ops.hfx.live_connect(name=BELT, kind="DEVICE", port=port)
    for pid in (os.getpid(), live.client.pipe.pid):
        prioritize_session(pid or 0)
    body_tracking.start(bpy.data.objects["Rig"], Person())
    main_loop(lambda: arm_stopped() or received, 60.0)
    os.write(descriptor, struct.pack("d", time.perf_counter()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--child", type=int, help="pipe for silence_trials.py")
    parser.add_argument("--port")
    options = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else None)
    logging.disable()  # of the raised errors
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("HFX_USER_DATA", folder)
        if options.child is None:
            code = run(options.trials, folder)
            sys.stdout.flush()
            os._exit(code)
        run_until_quit(options.child, options.port, folder)
