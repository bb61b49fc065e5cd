# SPDX-License-Identifier: GPL-3.0-or-later
"""Handles in the viewport that size a haptic volume: one for each dimension of its shape."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import bpy
from mathutils import Matrix, Vector

from ...blender import compat
from ...blender.events import push_undo_soon
from ...operators.shared import active_effect

_AXES: dict[str, dict[int, tuple[str, int, float]]] = {
    "SPHERE": {0: ("radius", -1, 1.0)},
    "CYLINDER": {0: ("radius", -1, 1.0), 2: ("height", -1, 0.5)},
    "CAPSULE": {0: ("radius", -1, 1.0), 2: ("height", -1, 0.5)},
    "CUBOID": {axis: ("size", axis, 0.5) for axis in range(3)},
}
"""Size properties by shape and local axis: property, its component (-1: it is a number), offset per
unit of it."""

_COLOURS = ((0.9, 0.25, 0.3), (0.45, 0.75, 0.15), (0.2, 0.5, 0.95))


def offset(effect: bpy.types.Object, axis: int) -> float:
    """Distance of the volume's boundary from its middle along a local axis, world units."""
    name, component, share = _AXES[effect.hfx.shape][axis]
    value = getattr(effect.hfx, name)
    length = value if component < 0 else value[component]
    return length * share * _scale(effect, axis)


def set_offset(effect: bpy.types.Object, axis: int, distance: float) -> None:
    """Move the boundary to a distance from the middle, and key that if Auto Keying is on."""
    name, component, share = _AXES[effect.hfx.shape][axis]
    length = max(distance, 0.0) / (share * _scale(effect, axis))
    if component < 0:
        setattr(effect.hfx, name, length)
    else:
        values = list(getattr(effect.hfx, name))
        values[component] = length
        setattr(effect.hfx, name, values)
    path = f"hfx.{name}"
    from ...authoring.paths import spot_placing

    if spot_placing.is_auto_keyed(bpy.context, effect, path):  # Blender keys its own handles only
        effect.keyframe_insert(path, index=component)


def _scale(effect: bpy.types.Object, axis: int) -> float:
    return max(effect.matrix_world.col[axis].to_3d().length, 1e-9)


def shown_offset(axis: int) -> float:
    """Offset of a handle of the active volume; 0 where it has none."""
    # Blender asks hidden handles, too: a sphere has one, and a deleted volume none.
    effect = active_effect(bpy.context)
    return offset(effect, axis) if effect is not None and _has(effect, axis) else 0.0


def drag_offset(axis: int, distance: float) -> None:
    """Move a handle of the active volume."""
    effect = active_effect(bpy.context)
    if effect is not None and _has(effect, axis):
        set_offset(effect, axis, distance)
        if not compat.GIZMOS_MAKE_UNDO_STEPS:
            push_undo_soon()


def _has(effect: bpy.types.Object, axis: int) -> bool:
    return axis in _AXES.get(effect.hfx.shape, {})


class HFX_GGT_volume(bpy.types.GizmoGroup):
    """Size the active haptic volume"""

    bl_idname = "HFX_GGT_volume"
    bl_label = "Haptic Volume"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options: ClassVar = {"3D", "PERSISTENT"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_effect(context)
        return (
            effect == context.object is not None
            and context.mode == "OBJECT"
            and effect.hfx.kind == "VOLUME"
            and effect.hfx.shape in _AXES
            and effect.select_get()
        )

    def setup(self, _context: bpy.types.Context) -> None:
        self.arrows = []
        for axis, colour in enumerate(_COLOURS):
            arrow = self.gizmos.new("GIZMO_GT_arrow_3d")
            arrow.draw_style = "BOX"
            arrow.color, arrow.alpha = colour, 0.7
            arrow.color_highlight, arrow.alpha_highlight = (1.0, 1.0, 1.0), 1.0
            arrow.length = 0.0
            if compat.GIZMOS_MAKE_UNDO_STEPS:
                arrow.use_undo = True
            arrow.target_set_handler(
                "offset", get=partial(shown_offset, axis), set=partial(drag_offset, axis)
            )
            self.arrows.append(arrow)

    def draw_prepare(self, context: bpy.types.Context) -> None:
        effect = active_effect(context)
        if effect is None or effect.hfx.shape not in _AXES:
            return
        for axis, arrow in enumerate(self.arrows):
            arrow.hide = axis not in _AXES[effect.hfx.shape]
            arrow.matrix_basis = along(effect.matrix_world, axis)

    refresh = draw_prepare


def along(world: Matrix, axis: int) -> Matrix:
    """A rigid matrix at an object's origin whose Z axis is one of the object's axes."""
    direction = Vector(world.col[axis].to_3d())
    if direction.length < 1e-9:
        direction = Vector((0.0, 0.0, 1.0))
    return (
        Matrix.Translation(world.translation)
        @ direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
    )
