# SPDX-License-Identifier: GPL-3.0-or-later
"""Gizmos in the viewport: sizes of a haptic volume, direction of wind, place and radius of a point
on the skin."""

from functools import partial
from typing import ClassVar

import bpy
from mathutils import Matrix, Vector

from ..authoring.paths import paths, skin_picking
from ..blender import compat
from ..blender.events import push_undo_soon
from ..errors import HfxError
from ..operators.paths.path_operators import active_spot
from ..operators.shared import active_effect
from ..playback.preview import effect_overlay

_AXES: dict[str, dict[int, tuple[str, int, float]]] = {
    "SPHERE": {0: ("radius", -1, 1.0)},
    "CYLINDER": {0: ("radius", -1, 1.0), 2: ("height", -1, 0.5)},
    "CAPSULE": {0: ("radius", -1, 1.0), 2: ("height", -1, 0.5)},
    "CUBOID": {axis: ("size", axis, 0.5) for axis in range(3)},
}
"""Size properties by shape and local axis: property, component (-1: a number), offset of the
boundary per unit of the property."""

_COLOURS = ((0.9, 0.25, 0.3), (0.45, 0.75, 0.15), (0.2, 0.5, 0.95))


def offset(effect: bpy.types.Object, axis: int) -> float:
    """Distance of the volume's boundary from its centre along a local axis, world units. KeyError
    for an axis without its own size."""
    name, component, share = _AXES[effect.hfx.shape][axis]
    value = getattr(effect.hfx, name)
    length = value if component < 0 else value[component]
    return length * share * _scale(effect, axis)


def set_offset(effect: bpy.types.Object, axis: int, distance: float) -> None:
    """Set the size whose boundary is at a distance (world units, 0 at least) along a local axis;
    Auto Keying adds a keyframe. KeyError as of :func:`offset`."""
    from ..authoring.paths import spot_placing

    name, component, share = _AXES[effect.hfx.shape][axis]
    length = max(distance, 0.0) / (share * _scale(effect, axis))
    if component < 0:
        setattr(effect.hfx, name, length)
    else:
        getattr(effect.hfx, name)[component] = length
    path = f"hfx.{name}"
    # Blender inserts keyframes for its own gizmos only.
    if spot_placing.is_auto_keyed(bpy.context, effect, path):
        effect.keyframe_insert(path, index=component)


def _scale(effect: bpy.types.Object, axis: int) -> float:
    """World length of a unit along an object's axis; at least 1e-9, to divide by."""
    return max(effect.matrix_world.col[axis].to_3d().length, 1e-9)


def shown_offset(axis: int) -> float:
    """Offset of a gizmo of the active volume; 0 without such a gizmo."""
    # Blender also queries hidden gizmos: Y of a sphere, all of a deleted volume.
    effect = active_effect(bpy.context)
    return offset(effect, axis) if effect and axis in _AXES.get(effect.hfx.shape, {}) else 0.0


def drag_offset(axis: int, distance: float) -> None:
    """Set the offset of a gizmo of the active volume; no effect without such a gizmo."""
    effect = active_effect(bpy.context)
    if effect and axis in _AXES.get(effect.hfx.shape, {}):
        set_offset(effect, axis, distance)
        if not compat.GIZMOS_MAKE_UNDO_STEPS:
            push_undo_soon()


class _ViewportGizmos:
    """Base of gizmo groups in the 3D viewport, made once and updated at each drawing."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options: ClassVar = {"3D", "PERSISTENT"}


class HFX_GGT_volume(_ViewportGizmos, bpy.types.GizmoGroup):
    """Size the active haptic volume"""

    bl_idname = "HFX_GGT_volume"
    bl_label = "Haptic Volume"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_effect(context)
        # Not for an emitter of volumes: the gizmo would stand at the emitter, not at the volume.
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
            # The box stands at the boundary itself, without a shaft.
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

    # Blender calls refresh after changes, draw_prepare before each drawing: effects are animated.
    refresh = draw_prepare


def along(world: Matrix, axis: int) -> Matrix:
    """Rigid matrix at an object's origin, Z along its axis; world Z for an axis scaled to 0."""
    direction = Vector(world.col[axis].to_3d())
    if direction.length < 1e-9:
        direction = Vector((0.0, 0.0, 1.0))
    turn = direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
    return Matrix.Translation(world.translation) @ turn


def turn_wind(effect: bpy.types.Object, direction: Vector) -> None:
    """Turn an effect about its origin so that local Z has a world-space direction; no effect for a
    zero vector. Auto Keying adds keyframes of the rotation."""
    from ..authoring.paths import spot_placing

    place, turned, scale = effect.matrix_world.decompose()
    if direction.length < 1e-9:
        return
    # The smallest rotation, so that the volume does not roll about the wind.
    before = turned @ Vector((0.0, 0.0, 1.0))
    turned = before.rotation_difference(direction) @ turned
    effect.matrix_world = Matrix.LocRotScale(place, turned, scale)
    names = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    path = names.get(effect.rotation_mode, "rotation_euler")
    if spot_placing.is_auto_keyed(bpy.context, effect, path):
        effect.keyframe_insert(path)


def active_wind(context: bpy.types.Context) -> bpy.types.Object | None:
    """Selected active effect whose local Z axis is the direction of the air; otherwise None."""
    effect = active_effect(context)
    is_shown = effect is not None and effect == context.object and effect.select_get()
    return effect if is_shown and effect_overlay.is_windy(effect) else None


def _wind_offset() -> tuple[float, float, float]:
    """Arrow of the active wind from the effect's origin, world space; zero without wind."""
    effect = active_wind(bpy.context)
    if effect is None:
        return (0.0, 0.0, 0.0)
    return tuple(effect_overlay.wind_tip(effect) - effect.matrix_world.translation)


def _drag_wind(offset: tuple[float, float, float]) -> None:
    effect = active_wind(bpy.context)
    if effect is not None:
        turn_wind(effect, Vector(offset))
        if not compat.GIZMOS_MAKE_UNDO_STEPS:
            push_undo_soon()


class HFX_GGT_wind(_ViewportGizmos, bpy.types.GizmoGroup):
    """Turn the direction of the active wind"""

    bl_idname = "HFX_GGT_wind"
    bl_label = "Wind Direction"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and active_wind(context) is not None

    def setup(self, _context: bpy.types.Context) -> None:
        self.tip = _point_handle(self.gizmos)
        if compat.GIZMOS_MAKE_UNDO_STEPS:
            self.tip.use_undo = True
        self.tip.target_set_handler("offset", get=_wind_offset, set=_drag_wind)

    def draw_prepare(self, context: bpy.types.Context) -> None:
        effect = active_wind(context)
        self.tip.hide = effect is None
        if effect is not None:
            self.tip.matrix_basis = Matrix.Translation(effect.matrix_world.translation)

    refresh = draw_prepare


_MIDDLE_PIXELS = 8.0
_LEAST_RING_PIXELS = 24.0
_COLOUR = (1.0, 0.85, 0.2)


def _point_handle(gizmos: bpy.types.Gizmos) -> bpy.types.Gizmo:
    """New gizmo of 8 pixels for a point that is moved in the plane of the view."""
    handle = gizmos.new("GIZMO_GT_move_3d")
    handle.draw_style = "RING_2D"
    handle.draw_options = {"FILL_SELECT", "ALIGN_VIEW"}
    # Blender draws a gizmo of scale 1 with 75 pixels by default.
    handle.scale_basis = _MIDDLE_PIXELS / 75.0
    _show_as_handle(handle)
    return handle


def _show_as_handle(gizmo: bpy.types.Gizmo) -> None:
    gizmo.color, gizmo.alpha = _COLOUR, 0.8
    gizmo.color_highlight, gizmo.alpha_highlight = (1.0, 1.0, 1.0), 1.0
    gizmo.line_width = 2.0
    gizmo.use_draw_modal = True


class HFX_GGT_spot(_ViewportGizmos, bpy.types.GizmoGroup):
    """Slide the active point over the skin, and resize its disc"""

    bl_idname = "HFX_GGT_spot"
    bl_label = "Point on the Skin"

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
        self.middle = _point_handle(self.gizmos)
        self.middle.target_set_operator("hfx.slide_spot").release_confirm = True
        self.ring = self.gizmos.new("GIZMO_GT_dial_3d")
        self.ring.use_draw_scale = False
        self.ring.target_set_operator("hfx.resize_spot").release_confirm = True
        _show_as_handle(self.ring)

    def draw_prepare(self, context: bpy.types.Context) -> None:
        effect = active_spot(context)
        placed = placed_on_body(context, effect) if effect is not None else None
        # The ring is the rim of the disc, but stays large enough to be clicked around the middle.
        self.middle.hide = self.ring.hide = placed is None
        if placed is None:
            return
        self.middle.matrix_basis = placed
        # The homogeneous coordinate of a projected point is the depth; 1 in orthographic views.
        view = context.region_data.perspective_matrix
        depth = abs((view @ placed.translation.to_4d()).w)
        pixel = 2.0 * depth / max(context.region.width * view.row[0].to_3d().length, 1e-9)
        radius = max(effect.hfx.radius, _LEAST_RING_PIXELS * pixel)
        self.ring.matrix_basis = placed @ Matrix.Scale(radius, 4)

    refresh = draw_prepare


def placed_on_body(context: bpy.types.Context, effect: bpy.types.Object) -> Matrix | None:
    """World matrix of a point on the posed body, Z along the skin's normal; None without a position
    or body, and after an error."""
    import numpy as np

    from ..engine.areas.spot import places_on

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
