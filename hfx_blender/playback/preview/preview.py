# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview: colours of samples on avatars, glow of the chosen devices' actuators, and a chart of
both over the whole timeline.

Nothing is stored in the user's meshes: all is laid over them while the viewport is drawn, and is
worked out only if something moved since it was.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import bpy
from bpy.app.handlers import persistent

from ...blender import events
from ...blender.events import add_handlers, call_soon, remove_handlers, remove_timers
from ...errors import HfxError
from ...reading.description import unreported
from ...reading.stepped import stepping
from ..timeline.timeline_recorder import QUIET_S, is_held, recorder

if TYPE_CHECKING:
    from .drawing import ChartView
    from .preview_layers import Preview

_log = logging.getLogger(__name__)

_PLAYING_S, _RECORDED_S = 0.25, 1.0
"""Intervals of looking for changes of the scene's description during playback, without and with a
record, seconds: scripts and drivers change it without notice. A record knows what drivers change.
"""

_SHORT_S, _REST = 0.01, 10.0
"""Duration of a look for changes after which it rests, seconds, and rest as a multiple of it."""

_PIECE_S = 0.004
"""Time slice for preparing the preview between two events of Blender, seconds."""


class ViewportPreview:
    """Preview in the viewports: follows the open scene, and is drawn over them.

    Attributes
    ----------
    is_drawn : bool
        Nothing has moved since the last drawing.
    is_describing : bool
        The scene is being read: what Blender reports meanwhile is no edit.
    cannot_draw : bool
        Drawing has failed; it is tried again in another file, or after an undo.
    on_scene_checked : list of callable
        Called after each look for changes of the scene.
    """

    def __init__(self) -> None:
        self.is_drawn = self.is_describing = self.cannot_draw = False
        self.on_scene_checked: list[Callable[[], None]] = []
        self._described_s = 0.0
        self._looked_s = self._looked_for_s = 0.0  # end and duration of the last look
        self._content: Preview | None = None
        self._chart: ChartView | None = None
        self._draw_handles: list[object] = []
        self._handlers = {
            "frame_change_post": self.on_frame,
            "depsgraph_update_post": self.on_update,
            "load_post": self.on_load,
            "undo_post": self.on_load,
            "redo_post": self.on_load,
        }

    @property
    def content(self) -> Preview:
        """Colours and actuators; created on first use, so that Blender's start does not wait."""
        if self._content is None:
            from .preview_layers import Preview

            self._content = Preview()
        return self._content

    @property
    def is_on(self) -> bool:
        """Test for anything that needs the scene's description, or its record."""
        manager = bpy.context.window_manager
        is_shown = manager.hfx_preview or manager.hfx_show_actuators or manager.hfx_show_values
        return bool(is_shown or recorder.is_wanted_by_devices)

    def listen(self) -> None:
        """Follow the open scene by Blender's handlers."""
        add_handlers(self._handlers)

    def stop_listening(self) -> None:
        """Remove handlers and timers."""
        remove_handlers(self._handlers)
        remove_timers(
            self.check_scene, self.schedule_check, self._reread, self._record, self._prepare
        )

    def begin_drawing(self) -> None:
        """Draw over all 3D viewports from now on."""
        add = bpy.types.SpaceView3D.draw_handler_add
        self._draw_handles.append(add(self._draw, (), "WINDOW", "POST_VIEW"))
        self._draw_handles.append(add(self._draw_chart, (), "WINDOW", "POST_PIXEL"))

    def end_drawing(self) -> None:
        """Draw no more."""
        for handle in self._draw_handles:
            bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        self._draw_handles.clear()

    def invalidate(self) -> None:
        """Note that something moved; colours are computed at the next drawing."""
        self.is_drawn = False
        if self._content is not None:
            self._content.invalidate()

    def forget(self) -> None:
        """Discard everything: another file, or an undo."""
        self.cannot_draw = False
        if self._content is not None:
            self._content.forget()
        recorder.forget()
        self._chart = None

    def switched(self) -> None:
        """Show or hide what the user has switched on or off."""
        self.invalidate()
        if self.is_on:
            call_soon(self.check_scene)
            call_soon(self._record)
            call_soon(self._prepare)
        self.redraw()

    def schedule_check(self) -> None:
        """Look for changes as soon as Blender is idle: after each drawing and each operator of
        ours.

        Whatever changes what is felt is noticed this way, also what Blender reports to nobody.
        """
        if not stepping.is_stepping():
            call_soon(self.check_scene)

    def check_scene(self) -> None:
        """Have Blender evaluate what changed without its notice, and describe the scene anew if
        its description changed.
        """
        if getattr(bpy.context, "scene", None) is None:  # at this moment
            return
        if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
            return  # nothing may be tagged; the next drawing looks again
        begun = time.perf_counter()
        unreported.tag(bpy.context.scene, bpy.context.view_layer)  # Blender evaluates it next
        self._looked_s = time.perf_counter()
        self._looked_for_s = self._looked_s - begun
        for function in self.on_scene_checked:
            function()
        if self.is_on:
            self.describe()

    def describe(self) -> None:
        """Look for changes of the scene's description."""
        content = self.content
        self.is_describing = True
        try:
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
        """Have all 3D viewports drawn again, their sidebars too, and the clips in timelines."""
        events.redraw("VIEW_3D", "DOPESHEET_EDITOR")

    def draw_over(self, scene: bpy.types.Scene) -> None:
        """Draw colours and actuators into the viewport that is being drawn."""
        from . import drawing

        manager, settings = bpy.context.window_manager, scene.hfx
        now = settings.palette, recorder.valid, scene.frame_current_final
        if manager.hfx_preview:
            layers = self.content.layers(*now)
            if layers:
                drawing.draw_layers(layers, settings.preview_opacity)
        if manager.hfx_show_actuators:
            drawing.draw_discs(self.content.discs(*now))

    @persistent
    def on_frame(self, _scene: bpy.types.Scene, *_: object) -> None:
        """Note that the frame changed; almost all work is left to the next drawing."""
        if self.is_describing or stepping.is_stepping():
            return
        self.invalidate()
        since_s = time.monotonic() - self._described_s
        if since_s < _PLAYING_S or (since_s < _RECORDED_S and recorder.valid is not None):
            return
        if self.is_on:  # not from here: describing evaluates the view layer, which calls this again
            call_soon(self.check_scene)

    @persistent
    def on_update(self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Note an edit."""
        if stepping.is_stepping():
            return
        if self.is_describing:
            # Reading changes nothing, but has Blender evaluate what was changed just before it.
            if scene == bpy.context.scene and recorder.has_relevant_update(depsgraph):
                self.invalidate()
                call_soon(self._reread)
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
        """Begin anew with another file, or after an undo."""
        self.forget()
        if self.is_on:
            call_soon(self.check_scene)
            call_soon(self._record)

    def _look_after_drawing(self) -> None:
        """Look for changes, in scenes of very many effects for a tenth of the time at most."""
        rest_s = _REST * self._looked_for_s if self._looked_for_s > _SHORT_S else 0.0
        left_s = self._looked_s + rest_s - time.perf_counter()
        if left_s > 0.0:
            call_soon(self.schedule_check, left_s)
        else:
            self.schedule_check()

    def _reread(self) -> None:
        """Note a change that was evaluated while the scene was read."""
        recorder.invalidate()
        self.schedule_check()
        self.redraw()

    def _record(self) -> float | None:
        """Record a piece of the values over time; called until they are complete."""
        if not self.is_on or not recorder.has_work:
            return None
        if is_held(bpy.context):
            return QUIET_S
        self.is_describing = True  # reading the scene is no change of it
        try:
            pause = recorder.work(bpy.context.scene)
        except Exception:  # a timer that raises shows its traceback and is not called again
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
        """Prepare the preview of one more frame of the record; called until all are complete."""
        record, scene = recorder.valid, bpy.context.scene
        if record is None or not bpy.context.window_manager.hfx_preview:
            return None
        if is_held(bpy.context):
            return QUIET_S
        begun = time.perf_counter()
        while time.perf_counter() - begun < _PIECE_S:
            frames = scene.frame_start, scene.frame_end
            if not self.content.prepare(scene.hfx.palette, record, *frames):
                return None
        return 0.02 + 2.0 * (time.perf_counter() - begun)

    def _draw(self) -> None:
        if not bpy.context.screen.is_animation_playing:  # which looks at intervals
            self._look_after_drawing()
        self.is_drawn = True
        space = bpy.context.space_data
        if space is None or not space.overlay.show_overlays or self.cannot_draw:
            return
        try:
            self.draw_over(bpy.context.scene)
        except Exception as error:  # it would be raised again at every redraw
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


def _switched(_self: object, _context: bpy.types.Context) -> None:
    preview.switched()


_SWITCHES: Final = {
    "hfx_preview": ("Show What Is Felt", "Colour the avatar where it feels something", True),
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
            name=label, description=description, default=is_on, update=_switched
        )
        setattr(bpy.types.WindowManager, name, switch)
    if bpy.app.background:  # nothing is drawn there, and exports step through time
        return
    preview.listen()
    preview.begin_drawing()


def unregister() -> None:
    preview.end_drawing()
    preview.stop_listening()
    for name in _SWITCHES:
        delattr(bpy.types.WindowManager, name)
    preview.forget()
    if not bpy.app.background:
        from . import drawing

        drawing.forget()
