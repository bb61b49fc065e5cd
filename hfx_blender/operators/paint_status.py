# SPDX-License-Identifier: GPL-3.0-or-later
"""Names the body part under the mouse in the status bar, while painting."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy_extras import view3d_utils

from ..authoring import effects, painting
from ..engine.body.parts import CENTRE, SIDES


class HFX_OT_paint_status(bpy.types.Operator):
    """Name the body part under the mouse in the status bar, as long as something is painted"""

    bl_idname = "hfx.paint_status"
    bl_label = "Name Body Parts"
    bl_options: ClassVar = {"INTERNAL"}

    _shown = ""

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        canvas = context.object
        if canvas is None or not canvas.get(painting.PAINTED_EFFECT):
            context.workspace.status_text_set(None)
            return {"FINISHED", "PASS_THROUGH"}
        if event.type == "MOUSEMOVE":
            text = _part_under(context, canvas, event.mouse_x, event.mouse_y)
            if text != self._shown:
                self._shown = text
                context.workspace.status_text_set(text or None)
        return {"PASS_THROUGH"}


def _part_under(
    context: bpy.types.Context, canvas: bpy.types.Object, mouse_x: int, mouse_y: int
) -> str:
    """Side and body part under the mouse; "" beside the body."""
    for area in context.screen.areas:
        if area.type != "VIEW_3D":
            continue
        region = next(each for each in area.regions if each.type == "WINDOW")
        x, y = mouse_x - region.x, mouse_y - region.y
        if not (0 <= x < region.width and 0 <= y < region.height):
            continue
        view = area.spaces.active.region_3d
        origin = view3d_utils.region_2d_to_origin_3d(region, view, (x, y))
        ray = view3d_utils.region_2d_to_vector_3d(region, view, (x, y))
        to_local = canvas.matrix_world.inverted_safe()
        evaluated = canvas.evaluated_get(context.evaluated_depsgraph_get())
        hit, _, _, face = evaluated.ray_cast(to_local @ origin, to_local.to_3x3() @ ray)
        if not hit or face >= len(canvas.data.polygons):
            return ""
        return part_name(canvas, canvas.data.polygons[face].vertices[0])
    return ""


def part_name(canvas: bpy.types.Object, vertex: int) -> str:
    """ "Calves (left)" for a vertex of a mesh that is painted on."""
    from ..engine.body.model import load_model
    from ..engine.body.regions import region_at

    effect = canvas[painting.PAINTED_EFFECT]
    model = load_model(effects.model_id_for(effect.hfx.modality))
    if vertex >= len(model):
        return ""
    region, side = region_at(model, vertex), int(model.side[vertex])
    return region.label if side == CENTRE else f"{region.label} ({SIDES[side]})"


register, unregister = bpy.utils.register_classes_factory((HFX_OT_paint_status,))
