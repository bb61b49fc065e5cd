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
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ...blender.events import add_handlers, call_soon, remove_handlers
from ...errors import HfxError
from ...reading.description import unreported
from ...reading.stepped import stepping
from ..timeline.timeline_recorder import QUIET_S, is_held, recorder

if TYPE_CHECKING:
    from .drawing import ChartDrawing
    from .preview_layers import Preview

_log = logging.getLogger(__name__)

_is_describing = False
_is_drawn = False  # what was described last
_described_s = 0.0
_compared_for_s = _compared_s = 0.0  # duration and time of the last look for changes
_cannot_draw = False
_preview: Preview | None = None
_charts: dict[tuple[object, ...], ChartDrawing] = {}  # by what they show and how large
_draw_handles: list[object] = []

after_looking: list[Callable[[], None]] = []
"""Functions to be called after each look for changes of the scene."""

_PLAYING_S, _RECORDED_S = 0.25, 1.0
"""Intervals of looking for changes of the scene's description during playback, without and with a
record, seconds: scripts and drivers change it without notice. A record knows what drivers change.
"""

_SHORT_S, _REST = 0.01, 10.0
"""Duration of a look for changes after which it rests, seconds, and rest as a multiple of it."""

_PIECE_S = 0.004
"""Duration of one slice of preparing the preview, seconds."""

_TALLEST = 0.45  # of the chart, as a share of the viewport


def preview() -> Preview:
    """Get the only preview; created on first use, so that Blender's start does not wait for it."""
    global _preview
    if _preview is None:
        from .preview_layers import Preview

        _preview = Preview()
    return _preview


def touch() -> None:
    """Note that something moved; colours are computed at the next drawing."""
    global _is_drawn
    _is_drawn = False
    if _preview is not None:
        _preview.touch()


def forget() -> None:
    """Discard everything: another file, or an undo."""
    global _cannot_draw
    _cannot_draw = False
    if _preview is not None:
        _preview.forget()
    recorder.forget()
    _charts.clear()


def _is_on() -> bool:
    manager = bpy.context.window_manager
    is_shown = manager.hfx_preview or manager.hfx_show_actuators or manager.hfx_show_values
    return bool(is_shown or recorder.is_wanted_by_devices)


@persistent
def on_frame(scene: bpy.types.Scene, *_: object) -> None:
    """Note that the frame changed; almost all work is left to the next drawing."""
    if _is_describing or stepping.is_stepping():
        return
    touch()
    since_s = time.monotonic() - _described_s
    if since_s < _PLAYING_S or (since_s < _RECORDED_S and recorder.valid is not None):
        return
    if _is_on():  # not from here: describing evaluates the view layer, which would call this again
        call_soon(look)


@persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if stepping.is_stepping():
        return
    if _is_describing:
        # Reading changes nothing, but has Blender evaluate what was changed just before it.
        if scene == bpy.context.scene and recorder.changes(depsgraph):
            touch()
            call_soon(_reread)
        return
    touch()
    recorder.notice(depsgraph)
    if not _is_on():
        return
    call_soon(look)
    if recorder.wants_time:
        call_soon(_record)


@persistent
def _on_load(*_: object) -> None:
    forget()
    if _is_on():
        call_soon(look)
        call_soon(_record)


def check_soon() -> None:
    """Look for changes as soon as Blender is idle: after each drawing and each operator of ours.

    Whatever changes what is felt is noticed this way, also what Blender reports to nobody.
    """
    if not stepping.is_stepping():
        call_soon(look)


def look() -> None:
    """Have Blender evaluate what changed without its notice, and describe the scene anew if its
    description changed.
    """
    global _compared_for_s, _compared_s
    if getattr(bpy.context, "scene", None) is None:  # at this moment
        return
    if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
        return  # nothing may be tagged; the next drawing looks again
    begun = time.perf_counter()
    unreported.tag(bpy.context.scene, bpy.context.view_layer)  # Blender evaluates it next
    _compared_s = time.perf_counter()
    _compared_for_s = _compared_s - begun
    for function in after_looking:
        function()
    if _is_on():
        describe()


def _look_after_drawing() -> None:
    """Look for changes, in scenes of very many effects for a tenth of the time at most."""
    rest_s = _REST * _compared_for_s if _compared_for_s > _SHORT_S else 0.0
    left_s = _compared_s + rest_s - time.perf_counter()
    if left_s > 0.0:
        call_soon(_look_later, left_s)
    else:
        check_soon()


def _look_later() -> None:
    check_soon()


def _reread() -> None:
    """Note a change that was evaluated while the scene was read."""
    recorder.changed()
    check_soon()
    redraw()


def describe() -> None:
    """Look for changes of the scene's description."""
    global _is_describing, _described_s
    _is_describing = True
    try:
        before, known = preview().fault, preview().key
        preview().describe(bpy.context)
        if preview().fault and preview().fault != before:
            _log.info("preview: %s", preview().fault)
        if preview().key != known:
            touch()
        recorder.look(bpy.context.scene)
        if recorder.wants_time:
            call_soon(_record)
    except (ReferenceError, AttributeError, HfxError):  # no scene at this moment
        forget()
    finally:
        _is_describing = False
        _described_s = time.monotonic()
    if not _is_drawn:
        redraw()


def _record() -> float | None:
    """Record a piece of the values over time; called until they are complete."""
    global _is_describing
    if not _is_on() or not recorder.wants_time:
        return None
    if is_held(bpy.context):
        return QUIET_S
    _is_describing = True  # reading the scene is no change of it
    try:
        pause = recorder.work(bpy.context.scene)
    except Exception:  # a timer that raises shows its traceback and is not called again
        _log.exception("values over time")
        return None
    finally:
        _is_describing = False
    if recorder.wants_time:
        return pause
    touch()
    redraw()
    call_soon(_prepare)
    return None


def _prepare() -> float | None:
    """Prepare the preview of one more frame of the record; called until all are complete."""
    recorded, scene = recorder.valid, bpy.context.scene
    if recorded is None or not bpy.context.window_manager.hfx_preview:
        return None
    if is_held(bpy.context):
        return QUIET_S
    begun = time.perf_counter()
    while time.perf_counter() - begun < _PIECE_S:
        if not preview().prepare(scene.hfx.palette, recorded, scene.frame_start, scene.frame_end):
            return None
    return 0.02 + 2.0 * (time.perf_counter() - begun)


def redraw() -> None:
    """Have all 3D viewports drawn again, their sidebars too, and the clips in timelines."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "DOPESHEET_EDITOR"):
                area.tag_redraw()


def _switched(_self: object, _context: bpy.types.Context) -> None:
    touch()
    if _is_on():
        call_soon(look)
        call_soon(_record)
        call_soon(_prepare)
    redraw()


def _draw() -> None:
    global _cannot_draw, _is_drawn
    if not bpy.context.screen.is_animation_playing:  # which looks at intervals
        _look_after_drawing()
    _is_drawn = True
    space = bpy.context.space_data
    if space is None or not space.overlay.show_overlays or _cannot_draw:
        return
    try:
        draw_over(bpy.context.scene)
    except Exception as error:  # it would be raised again at every redraw
        _cannot_draw = True
        preview().fault = f"The graphics driver cannot draw the preview: {error}"
        _log.exception("preview")


def draw_over(scene: bpy.types.Scene) -> None:
    """Draw colours and actuators into the viewport that is being drawn."""
    from . import drawing

    manager, settings, shown = bpy.context.window_manager, scene.hfx, preview()
    now = settings.palette, recorder.valid, scene.frame_current_final
    if manager.hfx_preview:
        layers = shown.layers(*now)
        if layers:
            drawing.draw_layers(layers, settings.preview_opacity)
    if manager.hfx_show_actuators:
        drawing.draw_discs(shown.discs(*now))


def _draw_chart() -> None:
    from ...engine.colouring import PALETTES
    from ..timeline import value_chart
    from . import drawing

    space, scene, found = bpy.context.space_data, bpy.context.scene, recorder.result
    if not bpy.context.window_manager.hfx_show_values or not space.overlay.show_overlays:
        return
    area, region = bpy.context.area, bpy.context.region
    if region != next(each for each in area.regions if each.type == "WINDOW"):
        return  # one chart is enough in quad view: beside the sidebar
    left, right = drawing.free_part(area, region)
    if right - left < 120.0:
        return
    if found is None:
        drawing.write_note(recorder.fault or "Values over time: nothing is felt yet", left)
        return
    scale = bpy.context.preferences.system.ui_scale
    size = right - left, _TALLEST * region.height, scale
    palette = PALETTES[scene.hfx.palette]
    key = (id(found), *palette.values(), *size)
    if key not in _charts:
        if len(_charts) > 8:
            _charts.clear()
        made = value_chart.chart(found, palette, *size)
        _charts[key] = drawing.ChartDrawing(made)
    shown = _charts[key]
    note = "; ".join(found.notes)
    if recorder.must_step:
        note = "Not up to date: press Update Values"
    elif shown.chart.hidden:
        note = f"{shown.chart.hidden} more rows; enlarge the viewport to see them"
    shown.draw(left, scene.frame_current_final, recorder.is_fresh, note)


_HANDLERS = {
    "frame_change_post": on_frame,
    "depsgraph_update_post": _on_update,
    "load_post": _on_load,
    "undo_post": _on_load,
    "redo_post": _on_load,
}


def register() -> None:
    switches = {
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
    for name, (label, description, is_on) in switches.items():
        switch = bpy.props.BoolProperty(
            name=label, description=description, default=is_on, update=_switched
        )
        setattr(bpy.types.WindowManager, name, switch)
    if bpy.app.background:  # nothing is drawn there, and exports step through time
        return
    add_handlers(_HANDLERS)
    add = bpy.types.SpaceView3D.draw_handler_add
    _draw_handles.append(add(_draw, (), "WINDOW", "POST_VIEW"))
    _draw_handles.append(add(_draw_chart, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    for handle in _draw_handles:
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
    _draw_handles.clear()
    remove_handlers(_HANDLERS)
    del bpy.types.WindowManager.hfx_show_values
    del bpy.types.WindowManager.hfx_show_actuators
    del bpy.types.WindowManager.hfx_preview
    forget()
    if not bpy.app.background:
        from . import drawing

        drawing.forget()
