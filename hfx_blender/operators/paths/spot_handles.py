# SPDX-License-Identifier: GPL-3.0-or-later
"""Modal operators of a point on the skin: slide, resize, keyframe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import bpy
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty
from bpy_extras import view3d_utils
from mathutils import Vector

from ...authoring.paths import paths, skin_picking
from ...blender.scene_info import metres_of
from ...blender.translation import translated
from ...errors import InputError
from .. import framing
from ..shared import IN_OBJECT_MODE, KeyBindings
from . import path_overlay
from .path_operators import PathOperator, active_spot

if TYPE_CHECKING:
    from ...engine.arrays import F64


_LEAST_RADIUS_M = 0.001
_PRECISE = 0.1
_NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
_SHORTCUTS = {"G", "S", "I"}


def _is_for_blender(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Test for G, S or I with further selected objects, or a point that is not selected: Blender's
    own operators then move, scale and key the selection."""
    effect = active_spot(context)
    others = any(selected != effect for selected in context.selected_objects)
    return event.type in _SHORTCUTS and (others or not effect.select_get())


def _on_body(context: bpy.types.Context, effect: bpy.types.Object, anchor: F64) -> Vector:
    """Position of a canonical anchor on the effect's body now, world space."""
    depsgraph = context.evaluated_depsgraph_get()
    points, _ = skin_picking.Anchors.of(anchor[None]).posed_on(effect.hfx.body, depsgraph)
    return Vector(points[0].tolist())


class _HeldSpotOperator(PathOperator):
    """Base of modal operators that follow the mouse; subclasses define the change."""

    bl_options: ClassVar = {"REGISTER", "UNDO", "BLOCKING"}

    release_confirm: BoolProperty(options={"HIDDEN", "SKIP_SAVE"})

    requires = (*PathOperator.requires, IN_OBJECT_MODE)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        effect = active_spot(context)
        if _is_for_blender(context, event):
            return {"PASS_THROUGH"}
        if context.area is None or context.area.type != "VIEW_3D":
            return self.execute(context)
        self._region = framing.region_at(context.area, event.mouse_x, event.mouse_y)
        self._at = Vector((event.mouse_x, event.mouse_y))
        self._seen = self._at.copy()
        self._begin(context, effect)
        context.window.cursor_modal_set("SCROLL_XY")
        context.window_manager.modal_handler_add(self)
        self._tell(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        effect = active_spot(context)
        if effect is None or context.area is None:
            self._end(context)
            return {"CANCELLED"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            # Movements are added up: Shift then changes the speed without a jump.
            seen = Vector((event.mouse_x, event.mouse_y))
            self._at += (seen - self._seen) * (_PRECISE if event.shift else 1.0)
            self._seen = seen
            self._follow(context, effect)
            self._tell(context)
            context.area.tag_redraw()
            return {"RUNNING_MODAL"}
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self._take_back(effect)
            self._end(context)
            return {"CANCELLED"}
        let_go = event.type == "LEFTMOUSE" and event.value == (
            "RELEASE" if self.release_confirm else "PRESS"
        )
        if let_go or (event.type in ("RET", "NUMPAD_ENTER") and event.value == "PRESS"):
            # The operator itself makes the change, as a script would, in one undo step.
            self._take_back(effect)
            self._end(context)
            return self.execute(context)
        if self._key(context, effect, event):
            self._tell(context)
            context.area.tag_redraw()
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"} if event.type in _NAVIGATION else {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore the point after Blender has ended the operator, as opening a file does."""
        effect = active_spot(context)
        if effect is not None:
            self._take_back(effect)
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        path_overlay.show_pending(None)
        context.workspace.status_text_set(None)
        context.window.cursor_modal_restore()
        if context.area is not None:
            context.area.header_text_set(None)
            context.area.tag_redraw()

    def _tell(self, context: bpy.types.Context) -> None:
        heading, more = self._words(context)
        confirm = "Release" if self.release_confirm else "Click or Enter"
        keys = f"{confirm}: confirm     Esc or right click: cancel     Shift: precise{more}"
        context.area.header_text_set(translated(heading))
        context.workspace.status_text_set(translated(keys))

    def _window_place(self, context: bpy.types.Context, anchor: F64) -> Vector | None:
        """Window pixel of a canonical point; None behind the viewer."""
        region = self._region
        world = _on_body(context, active_spot(context), anchor)
        seen = view3d_utils.location_3d_to_region_2d(region, region.data, world)
        return None if seen is None else seen + Vector((region.x, region.y))

    # Methods of subclasses

    def _begin(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        """Store the state before the change; InputError if the effect cannot be changed."""
        raise NotImplementedError

    def _follow(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        """Show the change for the pointer's pixel ``_at``, and store it for :meth:`work`."""
        raise NotImplementedError

    def _take_back(self, effect: bpy.types.Object) -> None:
        """Restore the state before the change."""
        raise NotImplementedError

    def _key(
        self, _context: bpy.types.Context, _effect: bpy.types.Object, _event: bpy.types.Event
    ) -> bool:
        """React to a key of the subclass; returns True for a known key."""
        return False

    def _words(self, context: bpy.types.Context) -> tuple[str, str]:
        """Header text, and the end of the status bar's text."""
        raise NotImplementedError


class HFX_OT_slide_spot(_HeldSpotOperator):
    """Slide the point over the skin to the mouse, at the current frame.

    Auto Keying adds a keyframe; the point moves along the skin between keyframes
    """

    bl_label = "Slide on the Skin"

    place: FloatVectorProperty(
        name="Place",
        description="Where to, metres in the rest space of the canonical body (the body faces -Y, "
        "its left is +X, its soles at Z = 0)",
        precision=3,
        options={"SKIP_SAVE"},
    )
    along_path: BoolProperty(
        name="Along Path",
        description="Stay on the existing path, at the nearest place",
        options={"SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> None:
        import numpy as np

        from ...authoring.paths import spot_placing

        effect = active_spot(context)
        anchor = np.array(self.place, np.float64)
        if not self.properties.is_property_set("place"):
            anchor = spot_placing.place_of(effect)
        is_keyed = spot_placing.is_auto_keyed(context, effect, paths.POSITION)
        if self.along_path:
            share = spot_placing.share_nearest(paths.own_path(effect), anchor)
            spot_placing.place_along(effect, share, is_keyed)
        else:
            spot_placing.place_at(context.scene, effect, anchor, is_keyed)
        _stand(context, effect)

    def _begin(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        from ...authoring.paths import spot_placing

        paths.check_editable(effect)
        spot_placing.check_keyable(effect, paths.POSITION, "position")
        body = effect.hfx.body
        if body is None:
            raise InputError("The point has no body; choose one first.")
        self._picker = skin_picking.Picker(body, context.evaluated_depsgraph_get())
        # Dragging replaces the path for display: the former path stays here.
        self._own = paths.own_path(effect)
        self._before: dict[str, Any] = {
            "path": list(effect[paths.PATH]),
            "position": effect.hfx.path_position,
            "location": effect.location.copy(),
        }
        self.place = spot_placing.place_of(effect).tolist()
        seen = self._window_place(context, spot_placing.place_of(effect))
        if seen is not None:
            # From here the mouse moves a virtual pointer that starts on the point: the offset
            # between mouse and point stays, also with the precise speed.
            self._at = seen

    def _follow(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        anchor = self._under_mouse(context)
        if anchor is not None:
            self.place = anchor.tolist()
            self._show(context, effect)

    def _under_mouse(self, context: bpy.types.Context) -> F64 | None:
        """Canonical skin point (3,) under the mouse; outside of the body, a point of its edge."""
        import numpy as np

        origin, ray = framing.ray_at(self._region, *self._at)
        hit = self._picker.hit(origin, ray)
        if hit is not None:
            return hit
        here = _on_body(context, active_spot(context), np.array(self.place, np.float64))
        # Outside of the outline, the nearest skin to the pointer in the plane of the last position.
        beside = origin + ray * max((here - origin).dot(ray), 0.0)
        return self._picker.nearest(beside, float("inf"))

    def _show(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        """Move the effect to :attr:`place`, or the nearest place of its path, for display; draw the
        point's former path."""
        import numpy as np

        from ...authoring.paths import spot_placing

        anchor = np.array(self.place, np.float64)
        if self.along_path:
            effect[paths.PATH] = self._own.ravel().tolist()
            effect.hfx.path_position = spot_placing.share_nearest(self._own, anchor)
        else:
            effect[paths.PATH] = anchor.tolist()
        _stand(context, effect)
        # ID properties that are set from Python do not mark the object as changed.
        effect.update_tag()
        if len(self._own) > 1:
            path_overlay.show_pending(effect.hfx.body, anchor[None], self._own)

    def _take_back(self, effect: bpy.types.Object) -> None:
        effect[paths.PATH] = self._before["path"]
        effect.hfx.path_position = self._before["position"]
        effect.location = self._before["location"]
        effect.update_tag()

    def _key(
        self, context: bpy.types.Context, effect: bpy.types.Object, event: bpy.types.Event
    ) -> bool:
        if event.type != "G" or event.value != "PRESS" or len(self._own) < 2:
            return False
        self.along_path = not self.along_path
        self._show(context, effect)
        return True

    def _words(self, context: bpy.types.Context) -> tuple[str, str]:
        from ...authoring.paths import spot_placing

        effect = active_spot(context)
        x, y, z = (100.0 * metres for metres in self.place)
        where = f"Along Path: {effect.hfx.path_position:.3f}" if self.along_path else "On the Skin"
        keyed = ""
        if spot_placing.is_auto_keyed(context, effect, paths.POSITION):
            keyed = f"   Keyed at frame {context.scene.frame_current}"
        elif paths.motion_of(effect) is not None:
            keyed = "   Not keyed: press I afterwards, or switch Auto Keying on"
        suffix = ""
        if len(self._own) > 1:
            suffix = "     G: " + ("freely on the skin" if self.along_path else "along its path")
        return f"{where}   X {x:.1f} cm  Y {y:.1f} cm  Z {z:.1f} cm{keyed}", suffix


class HFX_OT_resize_spot(_HeldSpotOperator):
    """Change the radius of the point's disc with the mouse; Auto Keying adds a keyframe"""

    bl_label = "Resize Disc"

    radius: FloatProperty(
        name="Radius",
        description="Radius of the disc",
        subtype="DISTANCE",
        unit="LENGTH",
        min=0.0,
        options={"SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> None:
        from ...authoring.paths import spot_placing

        effect = active_spot(context)
        spot_placing.check_keyable(effect, "hfx.radius", "radius")
        if self.properties.is_property_set("radius"):
            effect.hfx.radius = self.radius
        if spot_placing.is_auto_keyed(context, effect, "hfx.radius"):
            effect.keyframe_insert("hfx.radius")
        effect.update_tag()

    def _begin(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        from ...authoring.paths import spot_placing

        spot_placing.check_keyable(effect, "hfx.radius", "radius")
        self._before = effect.hfx.radius
        least = _LEAST_RADIUS_M / metres_of(context.scene)
        # A radius of 0 could not be scaled by the mouse.
        self._unit = max(self._before, least)
        middle = self._window_place(context, spot_placing.place_of(effect))
        self._middle = self._at if middle is None else middle
        # At least a pixel, as the radius is scaled by a ratio of distances.
        self._first = max((self._at - self._middle).length, 1.0)
        self.radius = self._before

    def _follow(self, context: bpy.types.Context, effect: bpy.types.Object) -> None:
        self.radius = self._unit * (self._at - self._middle).length / self._first
        effect.hfx.radius = self.radius
        effect.update_tag()

    def _take_back(self, effect: bpy.types.Object) -> None:
        effect.hfx.radius = self._before
        effect.update_tag()

    def _words(self, context: bpy.types.Context) -> tuple[str, str]:
        return f"Radius: {100.0 * self.radius * metres_of(context.scene):.2f} cm", ""


class HFX_OT_key_spot(PathOperator):
    """Insert a keyframe of the point's position; the point moves along the skin between
    keyframes"""

    bl_label = "Insert Place Key"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return {"PASS_THROUGH"} if _is_for_blender(context, event) else self.execute(context)

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.paths import spot_placing

        effect = active_spot(context)
        spot_placing.key_here(context.scene, effect)
        return f"Inserted a keyframe of '{effect.name}' at frame {context.scene.frame_current}"


def _stand(context: bpy.types.Context, effect: bpy.types.Object) -> None:
    """Move the effect's object to its point on the posed body; no effect for a child object, and
    without a body or position."""
    from ...authoring.paths import spot_placing

    anchor = spot_placing.place_of(effect)
    if anchor is not None and effect.hfx.body is not None and effect.parent is None:
        effect.location = _on_body(context, effect, anchor)


_classes = (HFX_OT_slide_spot, HFX_OT_resize_spot, HFX_OT_key_spot)
_keys = KeyBindings(
    "Object Mode",
    *((each.bl_idname, key, {}, {}) for each, key in zip(_classes, "GSI", strict=True)),
)
register, unregister = _keys.register, _keys.unregister
