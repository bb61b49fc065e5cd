# SPDX-License-Identifier: GPL-3.0-or-later
"""Records values over time in short pieces between edits and playback."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import bpy

from ...authoring.effects import effects
from ...errors import HfxError
from ...reading.description import visibility
from ...reading.stepped import stepping
from ...reading.stepped.reached import has_effects
from ..evaluation import evaluation

if TYPE_CHECKING:
    from .timeline_record import TimelineRecord

QUIET_S = 0.5  # time without an edit before recording starts, seconds

# Types of data without influence on haptic samples.
_CHANGES_NOTHING = frozenset(
    "Scene Screen WindowManager WorkSpace Collection Material World Camera Light Brush "
    "Image".split()
)


class TimelineRecorder:
    """Newest record of a scene, with validity."""

    # On the class, as `forget` runs `__init__` again.
    count = 0  # number of finished records
    is_wanted_by_devices = False  # set by live devices with latency compensation

    def __init__(self) -> None:
        self.result: TimelineRecord | None = None  # newest record, also when outdated
        self.is_fresh = False  # True until the next edit
        self.must_step = False  # the scene needs *Update Values*; `fault` gives the reason
        self._is_settled = False
        self.fault = ""  # error of the last recording; empty without an error
        self._key: tuple[object, ...] = ()
        self._changed_s = 0.0
        self._running: Iterator[TimelineRecord | None] | None = None
        self._is_working = False

    def forget(self) -> None:
        """Stop a recording and discard all state, for another file or after an undo."""
        self._stop()
        self.__init__()  # type: ignore[misc]
        self.invalidate()

    @property
    def valid(self) -> TimelineRecord | None:
        """Newest record; None after an edit, and while received values replace the scene's."""
        return self.result if self.is_fresh and not evaluation.overrides else None

    def invalidate(self) -> None:
        """Mark the record as outdated and stop recording until :data:`QUIET_S` have passed."""
        self.is_fresh = self._is_settled = self.must_step = False
        self._changed_s = time.monotonic()
        self._stop()

    def on_update(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Invalidate the record after a relevant depsgraph update, unless recording caused it."""
        if not self._is_working and self.has_relevant_update(depsgraph):
            self.invalidate()

    @staticmethod
    def has_relevant_update(depsgraph: bpy.types.Depsgraph) -> bool:
        """Test for updates of data other than cameras, lights, materials and similar."""
        return any(type(update.id).__name__ not in _CHANGES_NOTHING for update in depsgraph.updates)

    def check_settings(self, scene: bpy.types.Scene) -> None:
        """Invalidate the record after a change of range, rate, units, devices or tolerance."""
        key = _key_of(scene)
        if key != self._key:
            self._key = key
            self.invalidate()

    @property
    def has_work(self) -> bool:
        """True from a change until a record, an error, or the need of *Update Values*."""
        return not self._is_settled

    def work(self, scene: bpy.types.Scene) -> float:
        """Record a block of frames, unless the last edit is newer than :data:`QUIET_S`.

        Returns the seconds until the next call. Errors become :attr:`fault`.
        """
        # Each edit restarts the recording: wait for a pause in the user's work.
        quiet_s = time.monotonic() - self._changed_s
        if quiet_s < QUIET_S:
            return QUIET_S - quiet_s + 0.01
        begin = time.perf_counter()
        with self._working():
            try:
                self._piece(scene)
            except HfxError as error:
                self._done(None, str(error))
            except (ReferenceError, AttributeError):  # an undo removed objects
                self._stop()
        # Pauses of twice the work leave Blender two thirds of the time for the user.
        return 0.02 + 2.0 * (time.perf_counter() - begin)

    def update_now(self, scene: bpy.types.Scene) -> None:
        """Record the whole scene at once, stepping frames if needed; :attr:`valid` is the record
        then.

        The scene's frame is restored. Blender is blocked during the recording.

        Raises HfxError: the scene has no body or effect, or is too long; the last record is kept.
        """
        from .timeline_record import record

        self._stop()
        self._key = _key_of(scene)
        with self._working():
            # All blocks at once; the generator's last value is the record.
            *_, timeline = record(scene, may_step=True, with_positions=evaluation.with_positions)
            self._done(timeline, "")
            # Stepping wrote animated values of other frames into effects: evaluate these now.
            visibility.tag_unreported(scene, bpy.context.view_layer)

    @contextmanager
    def _working(self) -> Iterator[None]:
        """Context whose depsgraph updates, caused by reading, do not invalidate the record; at its
        end the view layers of all windows are updated."""
        self._is_working = True
        try:
            yield
        finally:
            # Reading tags objects, by scratch scenes and set frames. Evaluate them now: a later
            # update would look like an edit of the user.
            for window in bpy.context.window_manager.windows:
                window.view_layer.update()
            self._is_working = False

    def _piece(self, scene: bpy.types.Scene) -> None:
        """Record the next block, or start a recording: settled without a record for a scene without
        effects or bodies, and with :attr:`must_step` for a scene that needs stepping. HfxError as
        of :func:`.timeline_record.record`."""
        from .timeline_record import NeedsSteppingError, record

        # Each call advances the generator by a block. An edit closes the generator (`_stop`), as
        # its blocks would mix states of the scene.
        if self._running is None:
            if not (has_effects(scene) and effects.bodies_of(scene)):
                self._done(None, "")
                return
            self._running = record(scene, may_step=False, with_positions=evaluation.with_positions)
        try:
            timeline = next(self._running)
        except NeedsSteppingError as error:
            self._running = None
            self.fault, self.must_step, self._is_settled = str(error), True, True
            return
        if timeline is not None:
            self._done(timeline, "")

    def _done(self, timeline: TimelineRecord | None, fault: str) -> None:
        self.result, self.fault = timeline, fault
        self.is_fresh, self.must_step, self._is_settled = timeline is not None, False, True
        self.count += timeline is not None
        self._running = None

    def _stop(self) -> None:
        running, self._running = self._running, None
        # A generator cannot close itself while running.
        if running is not None and not self._is_working:
            running.close()  # type: ignore[attr-defined]


def _key_of(scene: bpy.types.Scene) -> tuple[object, ...]:
    render, unit = scene.render, scene.unit_settings
    return (
        scene.name,
        scene.frame_start,
        scene.frame_end,
        render.fps,
        render.fps_base,
        scene.hfx.rate,
        unit.system,
        unit.scale_length,
        tuple((device.name, device.scheme) for device in scene.hfx.devices),
        (scene.hfx.live_tolerance, scene.hfx.tolerance, scene.hfx.tolerance_custom),
        evaluation.with_positions,
    )


recorder = TimelineRecorder()


def is_held(context: bpy.types.Context) -> bool:
    """Test for a job of Blender that excludes recording: stepping, rendering, playback."""
    if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
        return True
    return any(window.screen.is_animation_playing for window in context.window_manager.windows)
