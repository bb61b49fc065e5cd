# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewport preview: colours of samples on avatars, glowing actuators, and a chart over time.

The user's meshes are not changed: colours are drawn over them. Colours are computed only after a
change.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import bpy
from bpy.app.handlers import persistent

from ...authoring import painting
from ...blender import events
from ...blender.events import add_handlers, call_soon, remove_handlers, remove_timers
from ...errors import HfxError
from ...reading.description import visibility
from ...reading.stepped import stepping
from ..timeline.timeline_recorder import QUIET_S, is_held, recorder

if TYPE_CHECKING:
    from .drawing import ChartView
    from .preview_layers import Preview

_log = logging.getLogger(__name__)

_PLAYING_S, _RECORDED_S = 0.25, 1.0
"""Intervals between checks of the scene during playback, without and with a record, seconds.

Scripts and drivers change the scene without an update; a record includes the motion of drivers.
"""

_SHORT_S, _REST = 0.01, 10.0
"""Duration above which checks pause, seconds; pause as a multiple of the duration."""

# Time slice for preparing the preview between two events of Blender, seconds.
_PIECE_S = 0.004


class ViewportPreview:
    """Preview of the open scene in all 3D viewports."""

    def __init__(self) -> None:
        self.is_drawn = False  # True from a drawing until the next change
        self.is_describing = False  # the scene is read: depsgraph updates are no edits
        self.cannot_draw = False  # after an exception, until another file or an undo
        self.on_scene_checked: list[Callable[[], None]] = []  # called after each check_scene()
        self._described_s = 0.0
        self._checked_s = self._check_duration_s = 0.0  # end and duration of the last check
        self._content: Preview | None = None
        self._chart: ChartView | None = None
        view = bpy.types.SpaceView3D
        self.draw_handlers = events.DrawHandlers(
            (view, self._draw, "POST_VIEW"), (view, self._draw_chart, "POST_PIXEL")
        )
        self._handlers = {
            "frame_change_post": self.on_frame,
            "depsgraph_update_post": self.on_update,
            "load_post": self.on_load,
            "undo_post": self.on_load,
            "redo_post": self.on_load,
        }

    @property
    def content(self) -> Preview:
        """Colours and actuators, created on first use to keep Blender's start short."""
        if self._content is None:
            from .preview_layers import Preview

            self._content = Preview()
        return self._content

    @property
    def is_on(self) -> bool:
        """Test for a visible preview, or for devices with latency compensation."""
        manager = bpy.context.window_manager
        is_shown = manager.hfx_preview or manager.hfx_show_actuators or manager.hfx_show_values
        return bool(is_shown or recorder.is_wanted_by_devices)

    def listen(self) -> None:
        """Add the handlers of frame changes, depsgraph updates, file loading, undo and redo."""
        add_handlers(self._handlers)

    def stop_listening(self) -> None:
        """Remove handlers and timers."""
        remove_handlers(self._handlers)
        remove_timers(
            self.check_scene, self.schedule_check, self.reread, self._record, self._prepare
        )

    def invalidate(self) -> None:
        """Discard colours and glow; the next drawing computes them."""
        self.is_drawn = False
        if self._content is not None:
            self._content.invalidate()

    def forget(self) -> None:
        """Discard colours, record and chart of the scene, and allow drawing after an error."""
        self.cannot_draw = False
        if self._content is not None:
            self._content.forget()
        recorder.forget()
        self._chart = None

    def switched(self) -> None:
        """Apply a change of the preview's switches: invalidate, redraw, and schedule the timers of
        a visible preview."""
        self.invalidate()
        if self.is_on:
            call_soon(self.check_scene)
            call_soon(self._record)
            call_soon(self._prepare)
        self.redraw()

    def schedule_check(self) -> None:
        """Schedule :meth:`check_scene` for Blender's next idle moment.

        Called after each drawing and each haptic operator: finds changes without a depsgraph
        update.
        """
        if not stepping.is_stepping():
            call_soon(self.check_scene)

    def check_scene(self) -> None:
        """Tag effects and bodies changed without a depsgraph update, call the functions of
        :attr:`on_scene_checked`, and describe the scene for a visible preview.

        No effect without a scene, while stepping, and during a render.
        """
        if getattr(bpy.context, "scene", None) is None:  # at this moment
            return
        if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
            return  # nothing may be tagged; the next drawing looks again
        begun = time.perf_counter()
        # Blender evaluates tagged objects after this timer.
        visibility.tag_unreported(bpy.context.scene, bpy.context.view_layer)
        self._checked_s = time.perf_counter()
        self._check_duration_s = self._checked_s - begun
        for function in self.on_scene_checked:
            function()
        if self.is_on:
            self.describe()

    def describe(self) -> None:
        """Describe the scene for colours and record; after a change discard the colours. Redraws
        unless the preview is up to date. Without a readable scene all data are discarded."""
        content = self.content
        self.is_describing = True
        try:
            # The key changes with each new description: compare to invalidate only then.
            before, known = content.fault, content.key
            content.describe(bpy.context)
            if content.fault and content.fault != before:
                _log.info("preview: %s", content.fault)
            if content.key != known:
                self.invalidate()
            recorder.check_settings(bpy.context.scene)
            if recorder.has_work:
                call_soon(self._record)
        except (ReferenceError, AttributeError, HfxError):  # no scene at this moment
            self.forget()
        finally:
            self.is_describing = False
            self._described_s = time.monotonic()
        if not self.is_drawn:
            self.redraw()

    def redraw(self) -> None:
        """Redraw all 3D viewports with their sidebars, and all timelines."""
        events.redraw("VIEW_3D", "DOPESHEET_EDITOR")

    def draw_over(self, scene: bpy.types.Scene) -> None:
        """Draw colours and actuators, each if switched on, into the current viewport."""
        from . import drawing

        manager, settings = bpy.context.window_manager, scene.hfx
        # Only a valid record: an outdated record would show the scene before the last edit.
        now = settings.palette, recorder.valid, scene.frame_current_final
        if manager.hfx_preview:
            layers = self.content.layers(*now)
            if layers:
                drawing.draw_layers(layers, settings.preview_opacity)
        if manager.hfx_show_actuators:
            drawing.draw_discs(self.content.discs(*now))

    @persistent
    def on_frame(self, _scene: bpy.types.Scene, *_: object) -> None:
        """Invalidate after a frame change; check the scene at most every 0.25 s (1 s with a
        record). No effect while the scene is described or stepped."""
        if self.is_describing or stepping.is_stepping():
            return
        self.invalidate()
        since_s = time.monotonic() - self._described_s
        if since_s < _PLAYING_S or (since_s < _RECORDED_S and recorder.valid is not None):
            return
        if self.is_on:  # by a timer: describing evaluates the view layer, which calls this handler
            call_soon(self.check_scene)

    @persistent
    def on_update(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Invalidate after an edit, and schedule checks and recording; no effect while stepping,
        and after a stroke on a canvas."""
        if stepping.is_stepping() or painting.is_stroke(depsgraph):
            return
        if self.is_describing:
            # Reading evaluates pending edits: an update here is an edit from just before. A timer
            # discards the record, whose own recording may be the reader.
            if scene == bpy.context.scene and recorder.has_relevant_update(depsgraph):
                self.invalidate()
                call_soon(self.reread)
            return
        self.invalidate()
        recorder.on_update(depsgraph)
        if not self.is_on:
            return
        call_soon(self.check_scene)
        if recorder.has_work:
            call_soon(self._record)

    @persistent
    def on_load(self, *_: object) -> None:
        """Discard all data after an undo, a redo or the opening of a file, and schedule a check and
        a record for a visible preview."""
        self.forget()
        if self.is_on:
            call_soon(self.check_scene)
            call_soon(self._record)

    def reread(self) -> None:
        """Timer, run once after an edit that Blender evaluated during reading: discard record and
        colours in any case, schedule a check of the scene (not while stepping), and redraw."""
        recorder.invalidate()
        # A drawing between the edit and this timer has cached colours of the outdated record.
        self.invalidate()
        self.schedule_check()
        self.redraw()

    def _record(self) -> float | None:
        """Timer: record a piece of the values over time; returns the pause in seconds, None at the
        end."""
        if not self.is_on or not recorder.has_work:
            return None
        if is_held(bpy.context):
            return QUIET_S
        self.is_describing = True  # updates while reading are no edits
        try:
            pause = recorder.work(bpy.context.scene)
        except Exception:  # Blender prints the traceback and removes the timer otherwise
            _log.exception("values over time")
            return None
        finally:
            self.is_describing = False
        if recorder.has_work:
            return pause
        self.invalidate()
        self.redraw()
        call_soon(self._prepare)
        return None

    def _prepare(self) -> float | None:
        """Timer: compute preview colours of recorded frames for some milliseconds.

        Returns the pause until the next call, seconds; None when all frames are cached, without a
        valid record, and while the preview is off.
        """
        record, scene = recorder.valid, bpy.context.scene
        if record is None or not bpy.context.window_manager.hfx_preview:
            return None
        if is_held(bpy.context):
            return QUIET_S
        begun = time.perf_counter()
        # Work in short slices, with pauses of twice their duration: the interface stays smooth.
        while time.perf_counter() - begun < _PIECE_S:
            frames = scene.frame_start, scene.frame_end
            if not self.content.prepare(scene.hfx.palette, record, *frames):
                return None
        return 0.02 + 2.0 * (time.perf_counter() - begun)

    def _draw(self) -> None:
        """Draw handler: schedule a check of the scene, at once or after a pause of ten times the
        duration of a slow check, and draw. After an exception drawing stops, with a fault."""
        if not bpy.context.screen.is_animation_playing:  # playback checks at intervals, in on_frame
            # Checks compare all effects: in large scenes, limit their share of the time.
            rest_s = _REST * self._check_duration_s if self._check_duration_s > _SHORT_S else 0.0
            if bpy.context.mode == "PAINT_WEIGHT":
                rest_s = max(rest_s, _RECORDED_S)
            left_s = self._checked_s + rest_s - time.perf_counter()
            if left_s > 0.0:
                call_soon(self.schedule_check, left_s)
            else:
                self.schedule_check()
        self.is_drawn = True
        space = bpy.context.space_data
        if space is None or not space.overlay.show_overlays or self.cannot_draw:
            return
        try:
            self.draw_over(bpy.context.scene)
        except Exception as error:  # every redraw would raise it again
            self.cannot_draw = True
            self.content.fault = f"The graphics driver cannot draw the preview: {error}"
            _log.exception("preview")

    def _draw_chart(self) -> None:
        if not bpy.context.window_manager.hfx_show_values:
            return
        if self._chart is None:
            from .drawing import ChartView

            self._chart = ChartView()
        self._chart.draw(bpy.context, recorder)


preview = ViewportPreview()

_SWITCHES: Final = {
    "hfx_preview": ("Show What Is Felt", "Colour the avatar where effects are felt", True),
    "hfx_show_actuators": (
        "Show Actuators",
        "Actuators of the chosen devices glow with their values",
        True,
    ),
    "hfx_show_values": (
        "Values over Time",
        "Draw the values of each effect and each actuator over the whole timeline",
        False,
    ),
}


def register() -> None:
    for name, (label, description, is_on) in _SWITCHES.items():
        switch = bpy.props.BoolProperty(
            name=label,
            description=description,
            default=is_on,
            update=lambda _self, _context: preview.switched(),
        )
        setattr(bpy.types.WindowManager, name, switch)
    if bpy.app.background:  # no drawing there, and exports step through time
        return
    preview.listen()
    preview.draw_handlers.register()


def unregister() -> None:
    preview.draw_handlers.unregister()
    preview.stop_listening()
    for name in _SWITCHES:
        delattr(bpy.types.WindowManager, name)
    preview.forget()
    if not bpy.app.background:
        from . import drawing

        drawing.forget()
