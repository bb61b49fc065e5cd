# SPDX-License-Identifier: GPL-3.0-or-later
"""Gizmos of a point on the skin: one slides it over the body, a ring around it sizes its disc."""

from __future__ import annotations

from typing import ClassVar

import bpy
from mathutils import Matrix, Vector

from ...authoring.paths import paths, skin_picking
from ...errors import HfxError
from ...operators.paths.paths import active_spot

_MIDDLE_PIXELS = 8.0
_LEAST_RING_PIXELS = 24.0
_COLOUR = (1.0, 0.85, 0.2)
_SHOWN_BIG = (1.0, 1.0, 1.0)


class HFX_GGT_spot(bpy.types.GizmoGroup):
    """Slide the active point over the skin, and size its disc"""

    bl_idname = "HFX_GGT_spot"
    bl_label = "Point on the Skin"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options: ClassVar = {"3D", "PERSISTENT"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_spot(context)
        return (
            effect is not None
            and context.mode == "OBJECT"
            and effect.select_get()
            and effect.hfx.body is not None
            and bool(effect.get(paths.PATH))
        )

    def setup(self, _context: bpy.types.Context) -> None:
        self.middle = self.gizmos.new("GIZMO_GT_move_3d")
        self.middle.draw_style = "RING_2D"
        self.middle.draw_options = {"FILL_SELECT", "ALIGN_VIEW"}
        self.middle.scale_basis = _MIDDLE_PIXELS / 75.0
        self.middle.target_set_operator("hfx.slide_spot").release_confirm = True
        self.ring = self.gizmos.new("GIZMO_GT_dial_3d")
        self.ring.use_draw_scale = False
        self.ring.target_set_operator("hfx.resize_spot").release_confirm = True
        for gizmo in (self.ring, self.middle):
            gizmo.color, gizmo.alpha = _COLOUR, 0.8
            gizmo.color_highlight, gizmo.alpha_highlight = _SHOWN_BIG, 1.0
            gizmo.line_width = 2.0
            gizmo.use_draw_modal = True

    def draw_prepare(self, context: bpy.types.Context) -> None:
        effect = active_spot(context)
        placed = placed_on_body(context, effect) if effect is not None else None
        self.middle.hide = self.ring.hide = placed is None
        if placed is None:
            return
        self.middle.matrix_basis = placed
        least = _LEAST_RING_PIXELS * pixel_size(context, placed.translation)
        radius = max(effect.hfx.radius, least)
        self.ring.matrix_basis = placed @ Matrix.Scale(radius, 4)

    refresh = draw_prepare


def placed_on_body(context: bpy.types.Context, effect: bpy.types.Object) -> Matrix | None:
    """Place of a point on its posed body, the skin's normal along Z; None if it has no place."""
    import numpy as np

    from ...engine.areas.spot import places_on

    try:
        depsgraph = context.evaluated_depsgraph_get()
        path = paths.path_of(effect)
        if not len(path) or effect.hfx.body is None:
            return None
        position = effect.evaluated_get(depsgraph).hfx.path_position
        anchors = skin_picking.Anchors.of(places_on(path, np.array([position])))
        points, normals = anchors.posed_on(effect.hfx.body, depsgraph)
    except (HfxError, ReferenceError):
        return None  # the panels report faults
    turn = Vector(normals[0].tolist()).to_track_quat("Z", "Y").to_matrix().to_4x4()
    return Matrix.Translation(points[0].tolist()) @ turn


def pixel_size(context: bpy.types.Context, place: Vector) -> float:
    """Width of a viewport's pixel at a place of the world."""
    view = context.region_data.perspective_matrix
    depth = abs((view @ place.to_4d()).w)
    return 2.0 * depth / max(context.region.width * view.row[0].to_3d().length, 1e-9)
