# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows the mouse while an area is painted: names the body part under it in the status bar, keeps
the brush's size on the skin, and finishes painting when Weight Paint is left.
"""

from __future__ import annotations

from contextlib import suppress
from typing import ClassVar

import bpy
from bpy.app.handlers import persistent
from bpy_extras import view3d_utils

from ...authoring.areas import painting
from ...authoring.effects import effects
from ...blender.events import add_handlers, call_soon, remove_handlers
from ...engine.body.parts import CENTRE, SIDES
from .. import framing
from . import paint_view


class HFX_OT_paint_status(bpy.types.Operator):
    """Name the body part under the mouse in the status bar, as long as something is painted"""

    bl_idname = "hfx.paint_status"
    bl_label = "Name Body Parts"
    bl_options: ClassVar = {"INTERNAL"}

    _is_running: ClassVar = False
    _shown = ""
    _brush: paint_view.SceneBrush
    _hidden: set[str]  # names of what is shown again if the mesh is deleted

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        canvas = painting.canvas_in(context)
        if canvas is None:
            return {"CANCELLED"}
        self._brush = paint_view.brush_for(canvas, canvas[painting.PAINTED_EFFECT])
        self._brush.fit(context, canvas, event)
        self._hidden = paint_view.hidden_by(canvas)
        HFX_OT_paint_status._is_running = True
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        canvas = painting.canvas_in(context)
        if canvas is None:  # finished, undone or deleted
            paint_view.show([context.view_layer], self._hidden)
            return self._ended(context)
        if canvas != context.object or canvas.mode == "OBJECT":  # left by Blender's own ways
            with suppress(RuntimeError):  # the mesh was edited: which Finish Painting tells
                bpy.ops.hfx.paint_end("EXEC_DEFAULT", True)  # a step of its own to undo
            return self._ended(context)
        if event.type == "MOUSEMOVE":
            vertex = _vertex_under(context, canvas, event.mouse_x, event.mouse_y)
            if vertex is not None:
                effect = canvas[painting.PAINTED_EFFECT]
                self._brush.least = painting.spacing(canvas, effect, vertex)
            text = "" if vertex is None else part_name(canvas, vertex)
            if text != self._shown:
                self._shown = text
                context.workspace.status_text_set(text or None)
        if canvas.mode == "WEIGHT_PAINT":
            self._brush.fit(context, canvas, event)
        return {"PASS_THROUGH"}

    def _ended(self, context: bpy.types.Context) -> set[str]:
        HFX_OT_paint_status._is_running = False
        paint_view.leave()
        context.workspace.status_text_set(None)
        return {"FINISHED", "PASS_THROUGH"}


def _resume() -> None:
    """Follow the mouse again: a file that was saved while painting, or an undo of its end."""
    canvas = painting.canvas_in(bpy.context)
    if canvas is None or HFX_OT_paint_status._is_running or canvas.mode == "OBJECT":
        return
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        paint_view.enter(bpy.context, canvas)
        bpy.ops.hfx.paint_status("INVOKE_DEFAULT")


@persistent
def _after_undo(*_: object) -> None:
    call_soon(_resume)


@persistent
def _after_loading(*_: object) -> None:
    paint_view.forget()
    HFX_OT_paint_status._is_running = False  # loading ends what follows the mouse
    call_soon(_resume)


def _vertex_under(
    context: bpy.types.Context, canvas: bpy.types.Object, mouse_x: int, mouse_y: int
) -> int | None:
    """Vertex of the mesh that is painted on, under the mouse; None beside the body."""
    for area in context.screen.areas:
        if area.type != "VIEW_3D":
            continue
        region = framing.region_at(area, mouse_x, mouse_y)
        if not framing.holds(region, mouse_x, mouse_y):
            continue
        at = mouse_x - region.x, mouse_y - region.y
        origin = view3d_utils.region_2d_to_origin_3d(region, region.data, at)
        ray = view3d_utils.region_2d_to_vector_3d(region, region.data, at)
        to_local = canvas.matrix_world.inverted_safe()
        evaluated = canvas.evaluated_get(context.evaluated_depsgraph_get())
        hit, _, _, face = evaluated.ray_cast(to_local @ origin, to_local.to_3x3() @ ray)
        if not hit or face >= len(canvas.data.polygons):
            return None
        return int(canvas.data.polygons[face].vertices[0])
    return None


def part_name(canvas: bpy.types.Object, vertex: int) -> str:
    """ "Calves (left)" for a vertex of a mesh that is painted on."""
    from ...engine.body.model import load_model
    from ...engine.body.regions import region_at

    effect = canvas[painting.PAINTED_EFFECT]
    model = load_model(effects.model_id_for(effect.hfx.modality))
    if vertex >= len(model):
        return ""
    region, side = region_at(model, vertex), int(model.side[vertex])
    return region.label if side == CENTRE else f"{region.label} ({SIDES[side]})"


_HANDLERS = {"undo_post": _after_undo, "redo_post": _after_undo, "load_post": _after_loading}


def register() -> None:
    if not bpy.app.background:
        add_handlers(_HANDLERS)


def unregister() -> None:
    remove_handlers(_HANDLERS)
