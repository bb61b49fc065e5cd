# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects dragged out in the viewport: sphere, box, wind, point on the skin."""

from typing import ClassVar

import bpy
from bpy.props import EnumProperty, FloatProperty, FloatVectorProperty
from mathutils import Vector, geometry

from ...authoring.effects import effects
from ...authoring.paths import skin_picking
from ...blender.scene_info import metres_of
from ...blender.translation import translated
from ...engine.modality import MODALITY_ITEMS
from ...errors import InputError
from .. import framing
from ..paths.path_operators import add_spot_at
from ..shared import HfxOperator, select_only, target_body
from .effect_operators import show_wire_colours

KINDS = (
    ("SPHERE", "Sphere", "Drag out a sphere from its centre, beside objects as deep as the body"),
    (
        "CUBOID",
        "Box",
        "Drag out the base of a box, beside objects as deep as the body, then click its height",
    ),
    ("SPOT", "Point on the Skin", "Drag out a disc from a place on the body"),
    ("WIND", "Wind", "Drag out an arrow in the direction of the wind, as deep as the body"),
)
_DRAG_HINT = "Release: confirm     Esc or right click: cancel"
_HEIGHT_HINT = "Move: height     Click: confirm     Esc or right click: cancel"
_LEAST_PIXELS = 4.0  # a shorter drag is a click, which adds the default size
_DEFAULT_M = {"SPHERE": 0.5, "CUBOID": 1.0, "SPOT": 0.03, "WIND": 1.0}


def depth_of(context: bpy.types.Context, origin: Vector, ray: Vector) -> Vector:
    """Middle of the body nearest to a ray of length 1; the 3D cursor without a body."""
    bodies = effects.bodies_of(context.scene)
    corners = ([body.matrix_world @ Vector(c) for c in body.bound_box] for body in bodies)
    middles = (sum(box, Vector()) / len(box) for box in corners)
    distance = lambda middle: (middle - origin).cross(ray).length  # noqa: E731
    return min(middles, key=distance, default=context.scene.cursor.location)


class HFX_OT_drag_effect(HfxOperator):
    """Drag out a haptic effect in the viewport. Esc cancels"""

    bl_label = "Drag Out Effect"
    bl_options: ClassVar = {"REGISTER", "UNDO", "BLOCKING"}
    leaves_mode = True

    kind: EnumProperty(name="Effect", description="Effect to drag out", items=KINDS)
    modality: EnumProperty(
        name="Modality", description="Sensation of the effect", items=MODALITY_ITEMS
    )
    start: FloatVectorProperty(
        name="Start", description="World-space start of the drag", subtype="TRANSLATION"
    )
    end: FloatVectorProperty(
        name="End", description="World-space end of the drag", subtype="TRANSLATION"
    )
    height: FloatProperty(
        name="Height", description="Height of a box above its base", unit="LENGTH"
    )

    def work(self, context: bpy.types.Context) -> None:
        effect = self._added(context)
        self._fit(context, effect)
        self._show_added(context, effect)

    def _show_added(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        show_wire_colours(context)
        select_only(context, effect)

    def _added(self, context: bpy.types.Context) -> bpy.types.Object:
        """Add the effect with its default size, not selected."""
        if self.kind != "SPOT":
            modality = "wind" if self.kind == "WIND" else self.modality
            shape = "CUBOID" if self.kind == "WIND" else self.kind
            return effects.add_volume(context.scene, modality, shape)
        body = target_body(context)
        if body is None:
            raise InputError("Add an avatar, or mark an armature as haptic body first.")
        picker = skin_picking.Picker(body, context.evaluated_depsgraph_get())
        place = picker.nearest(Vector(self.start), float("inf"))
        modality = "vibration" if self.modality == "wind" else self.modality
        return add_spot_at(context, modality, body, place.tolist())

    def _fit(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        """Give an effect the place and size of the drag; the default size for a click."""
        start, end = Vector(self.start), Vector(self.end)
        drag = end - start
        default = _DEFAULT_M[self.kind] / metres_of(context.scene)
        length = drag.length or default
        effect.hfx.radius = length
        effect.hfx.size = (length, length, length)
        if self.kind == "CUBOID" and drag.length:
            # The base is across a world axis: the drag has no length along this axis.
            drag[min(range(3), key=lambda axis: abs(drag[axis]))] = self.height
            effect.hfx.size = [abs(edge) for edge in drag]
        elif self.kind == "WIND":
            effect.hfx.size = (length / 2.0, length / 2.0, length)
            drag = drag if drag.length else Vector((length, 0.0, 0.0))
            effect.rotation_euler = drag.to_track_quat("Z", "Y").to_euler()
        if self.kind != "SPOT":
            effect.location = start if self.kind == "SPHERE" else start + drag / 2.0

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if context.area is None or context.area.type != "VIEW_3D":
            return self.execute(context)
        self._region = framing.region_at(context.area, event.mouse_x, event.mouse_y)
        self._pressed = Vector((event.mouse_x, event.mouse_y))
        self._has_base = False
        origin, ray = framing.ray_at(self._region, *self._pressed)
        depsgraph = context.evaluated_depsgraph_get()
        is_hit, place, *_ = context.scene.ray_cast(depsgraph, origin, ray)
        # The base of a box lies across the world axis that points most to the viewer.
        along = max(range(3), key=lambda axis: abs(ray[axis]))
        self._across = Vector([float(axis == along) for axis in range(3)])
        if self.kind != "CUBOID":
            self._across = ray
        if self.kind == "SPOT" and not is_hit:
            raise InputError("Start on the body.")
        # A wind crosses the body, also where the drag starts on the skin.
        if not is_hit or self.kind == "WIND":
            place = self._on_plane(self._pressed, depth_of(context, origin, ray))
        self.start = self.end = place
        self.height = 0.0
        self._shown = self._added(context).name
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("CROSSHAIR")
        context.workspace.status_text_set(translated(_DRAG_HINT))
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        pixel = Vector((event.mouse_x, event.mouse_y))
        is_click = (pixel - self._pressed).length < _LEAST_PIXELS
        if event.type == "MOUSEMOVE":
            if self._has_base:
                self.height = self._height_at(pixel)
            else:
                place = self._on_plane(pixel, Vector(self.start))
                self.end = self.start if is_click else place
            self._fit(context, bpy.data.objects[self._shown])
            context.area.tag_redraw()
        if event.type == "LEFTMOUSE" and event.value == ("PRESS" if self._has_base else "RELEASE"):
            if self.kind == "CUBOID" and not self._has_base and not is_click:
                self._has_base = True
                context.workspace.status_text_set(translated(_HEIGHT_HINT))
                return {"RUNNING_MODAL"}
            self._end(context)
            self._show_added(context, bpy.data.objects[self._shown])
            return {"FINISHED"}
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Remove the effect shown during the drag, and restore cursor and status bar."""
        shown = bpy.data.objects.get(self._shown)
        if shown is not None:
            bpy.data.objects.remove(shown)
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)

    def _on_plane(self, pixel: Vector, place: Vector) -> Vector:
        """Point under a window pixel on the plane of the drag through a place; the place itself
        where the plane is seen edge-on."""
        origin, ray = framing.ray_at(self._region, *pixel)
        hit = geometry.intersect_line_plane(origin, origin + ray, place, self._across)
        return place if hit is None else hit

    def _height_at(self, pixel: Vector) -> float:
        """Signed height of a box for a window pixel: nearest point of the axis through the end of
        the base; towards the viewer, the distance from there in the view's plane."""
        end = Vector(self.end)
        origin, ray = framing.ray_at(self._region, *pixel)
        if abs(ray.dot(self._across)) > 0.95:
            beside = geometry.intersect_line_plane(origin, origin + ray, end, ray)
            return -(beside - end).length if ray.dot(self._across) < 0.0 else (beside - end).length
        on_axis, _ = geometry.intersect_line_line(end, end + self._across, origin, origin + ray)
        return (on_axis - end).dot(self._across)
