# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic bodies that follow tracked persons while nothing plays.

A timer poses the rigs; live devices and the preview follow the poses as any edit of the scene. A
lost sender fades the devices to silence. Opening a file, undo, an error and quitting end the
tracking.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import bpy
from bpy.app.handlers import persistent

from ...avatars.tracked_rig import HumanPose, TrackedRig, keep_pose, restore_pose
from ...blender.events import add_handlers, call_soon, redraw, remove_handlers, remove_timers
from ...blender.scene_info import fps_of
from ...errors import HfxError, InputError
from ...reading.stepped import stepping
from ...tracking.vmc_body import FADE_S, LOST_S
from .listening import listening
from .live import live
from .live_handlers import is_playing
from .vr_source import create_actions

if TYPE_CHECKING:
    from ...avatars.tracked_action import RigRecording

STEP_S: Final = 1.0 / 60.0

_log = logging.getLogger(__name__)


class PoseSource(Protocol):
    """Poses of a person, such as a :class:`.vmc_source.VmcSource`."""

    title: str  # for the panel

    def pose(self) -> HumanPose | None:
        """Newest pose; None without a new pose since the last call."""

    def close(self) -> None:
        """End receiving; may be called again."""


@dataclass(eq=False)
class Tracker:
    """Body that follows a person."""

    armature: bpy.types.Object
    rig: TrackedRig
    source: PoseSource
    begun_s: float  # monotonic, of this tracker or the last pose
    is_lost: bool = False
    has_poses: bool = False
    recording: RigRecording | None = None

    def follow(self, now_s: float) -> bool:
        """Take a new pose, if any, at a monotonic time; returns True if the rig has moved. Rigs in
        Edit Mode and rigs of a playing animation stay as they are."""
        pose = self.source.pose()
        if pose is None:
            return False
        self.begun_s, self.has_poses = now_s, True
        if self.armature.mode == "EDIT" or is_playing() or stepping.is_stepping():
            return False
        bases = self.rig.bases(pose, self.armature)
        self.rig.apply(bases, self.armature)
        if self.recording is not None:
            self.recording.add(now_s, bases)
        return True

    def factor(self, now_s: float) -> float:
        """Factor of all devices: 1, and 0 once a sender that had sent poses is lost and faded."""
        if not self.has_poses:
            return 1.0
        return min(max(1.0 - (now_s - self.begun_s - LOST_S) / FADE_S, 0.0), 1.0)


class BodyTracking:
    """Tracked bodies of this Blender."""

    def __init__(self) -> None:
        self.trackers: list[Tracker] = []
        self.fault = ""  # error that ended the tracking; "" without
        self._handlers = dict.fromkeys(("load_pre", "undo_pre", "redo_pre"), self.on_end)

    def of(self, armature: bpy.types.Object) -> Tracker | None:
        """Tracker of a body; None if not tracked."""
        return next((t for t in self.trackers if t.armature == armature), None)

    def start(self, armature: bpy.types.Object, source: PoseSource) -> None:
        """Let a body follow the poses of a source, which is closed with the tracking or here after
        an error. Raises InputError: a tracked or linked body, or a rig without human bones."""
        try:
            if self.of(armature) is not None:
                raise InputError(f"'{armature.name}' is tracked already.")
            if armature.library is not None:
                raise InputError(
                    f"'{armature.name}' is linked from a file; make a library override to pose it."
                )
            rig = TrackedRig(armature)
        except InputError:
            source.close()
            raise
        keep_pose(armature, rig.names)
        self.fault = ""
        self.trackers.append(Tracker(armature, rig, source, time.monotonic()))
        add_handlers(self._handlers)
        call_soon(self.step, STEP_S)

    def stop(self, tracker: Tracker) -> None:
        """End receiving and restore the pose before; a running recording is discarded."""
        tracker.source.close()
        if tracker in self.trackers:
            self.trackers.remove(tracker)
        try:
            restore_pose(tracker.armature)
        except ReferenceError:
            pass  # the body was deleted
        if not self.trackers:
            remove_handlers(self._handlers)
            remove_timers(self.step)
        self._set_factor(time.monotonic())

    def stop_all(self) -> None:
        for tracker in list(self.trackers):
            self.stop(tracker)

    def record(self, tracker: Tracker, scene: bpy.types.Scene) -> None:
        """Begin a recording at the current frame."""
        from ...avatars.tracked_action import RigRecording  # loads numpy

        tracker.recording = RigRecording(tracker.rig, scene.frame_current)

    def finish_recording(self, tracker: Tracker, scene: bpy.types.Scene) -> bpy.types.Action:
        """End the tracking, and bake the recording into a new action of the body.

        Raises InputError: nothing was received; the tracking goes on.
        """
        recording, tracker.recording = tracker.recording, None
        if recording is None or recording.length_s == 0.0:
            raise InputError("Nothing was received during the recording.")
        # The pose before comes back first: keys of the action replace it at their frames only.
        self.stop(tracker)
        return recording.bake(tracker.armature, fps_of(scene))

    def step(self) -> float | None:
        """Timer: pose all tracked bodies; returns the interval in seconds, None at the end. Errors
        end the tracking and stop the devices."""
        now_s = time.monotonic()
        try:
            for tracker in list(self.trackers):
                tracker.follow(now_s)
                is_lost = tracker.has_poses and now_s - tracker.begun_s > LOST_S
                if is_lost != tracker.is_lost:
                    tracker.is_lost = is_lost
                    redraw("VIEW_3D")
            self._set_factor(now_s)
        except ReferenceError:
            self.fail("A tracked body was deleted.")
        except HfxError as error:
            self.fail(str(error))
        except Exception as error:
            self.fail(f"{type(error).__name__}: {error}")
            _log.error("body tracking", exc_info=error)
        return STEP_S if self.trackers else None

    def _set_factor(self, now_s: float) -> None:
        """Fade all devices for a lost sender, to silence in 2 s; back to full at its return."""
        factor = min((t.factor(now_s) for t in self.trackers), default=1.0)
        if factor != live.factors.get("tracking", 1.0):
            live.factors["tracking"] = factor
            live.resend(bpy.context.scene)

    def fail(self, text: str) -> None:
        """Stop all devices, then the tracking, with an error message for the panel."""
        live.fail(text)  # first, as the end of receiving waits for a thread
        self.stop_all()
        self.fault = text
        redraw("VIEW_3D")

    @persistent
    def on_end(self, *_: object) -> None:
        """End the tracking before an undo, a redo and another file."""
        self.stop_all()


body_tracking = BodyTracking()


@persistent
def restore_poses(*_: object) -> None:
    """Restore poses before a tracking, from files saved and undo steps pushed during it."""
    for obj in bpy.data.objects:
        if obj.type == "ARMATURE":
            restore_pose(obj)


_HANDLERS = dict.fromkeys(("load_post", "undo_post", "redo_post"), restore_poses)


def register() -> None:
    """Restore poses in every opened file."""
    add_handlers(_HANDLERS)


def unregister() -> None:
    """End all receiving, of bodies and of values."""
    listening.stop()
    body_tracking.stop_all()
    remove_handlers(_HANDLERS)
    remove_handlers({"xr_session_start_pre": create_actions})
