# SPDX-License-Identifier: GPL-3.0-or-later
"""An operator that follows the mouse to change a point on the skin, until the mouse is let go."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import bpy
from bpy.props import BoolProperty
from bpy_extras import view3d_utils
from mathutils import Vector

from ...authoring.paths import skin_picking
from ...errors import HfxError
from .. import framing
from ..shared import IN_OBJECT_MODE
from . import path_overlay
from .paths import PathOperator, active_spot

if TYPE_CHECKING:
    from ...engine.arrays import F64


_PRECISE = 0.1
_NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
_SHORTCUTS = {"G", "S", "I"}


def is_for_blender(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Test a key for Blender's own operator: something beside the point is selected."""
    effect = active_spot(context)
    others = any(other != effect for other in context.selected_objects)
    return event.type in _SHORTCUTS and (others or not effect.select_get())


def on_body(context: bpy.types.Context, effect: bpy.types.Object, place: F64) -> Vector:
    """Position of a canonical place on the effect's body now, world space."""
    anchors = skin_picking.Anchors.of(place[None])
    return Vector(anchors.on(effect.hfx.body, context.evaluated_depsgraph_get())[0][0].tolist())


class HeldSpotOperator(PathOperator):
    """Base of the operators that follow the mouse; subclasses define the change."""

    bl_options: ClassVar = {"REGISTER", "UNDO", "BLOCKING"}

    release_confirm: BoolProperty(options={"HIDDEN", "SKIP_SAVE"})

    requires = (*PathOperator.requires, IN_OBJECT_MODE)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        effect = active_spot(context)
        if is_for_blender(context, event):
            return {"PASS_THROUGH"}
        if context.area is None or context.area.type != "VIEW_3D":
            return self.execute(context)
        self._region = framing.region_at(context.area, event.mouse_x, event.mouse_y)
        try:
            self._at = Vector((event.mouse_x, event.mouse_y))
            self._seen = self._at.copy()
            self._begin(context, effect)
        except HfxError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
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
            self._take_back(effect)
            self._end(context)
            return self.execute(context)
        if self._key(context, effect, event):
            self._tell(context)
            context.area.tag_redraw()
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"} if event.type in _NAVIGATION else {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends it, with a file that is loaded for instance."""
        effect = active_spot(context)
        if effect is not None:
            self._take_back(effect)
        self._end(context)

    def _end(self, context: bpy.types.Context) -> None:
        import numpy as np

        path_overlay.show_pending(None, np.zeros((0, 3)))
        context.workspace.status_text_set(None)
        context.window.cursor_modal_restore()
        if context.area is not None:
            context.area.header_text_set(None)
            context.area.tag_redraw()

    def _tell(self, context: bpy.types.Context) -> None:
        heading, more = self._words(context)
        confirm = "Let go" if self.release_confirm else "Click or Enter"
        keys = f"{confirm}: confirm     Esc or right click: cancel     Shift: precise{more}"
        context.area.header_text_set(heading)
        context.workspace.status_text_set(keys)

    def _window_place(self, context: bpy.types.Context, place: F64) -> Vector | None:
        """Place of a canonical point in the window's pixels; None if it is behind the viewer."""
        region = self._region
        world = on_body(context, active_spot(context), place)
        seen = view3d_utils.location_3d_to_region_2d(region, region.data, world)
        return None if seen is None else seen + Vector((region.x, region.y))

    # What each does

    def _begin(self, context: bpy.types.Context, effect: bpy.types.Object) -> None: ...

    def _follow(self, context: bpy.types.Context, effect: bpy.types.Object) -> None: ...

    def _take_back(self, effect: bpy.types.Object) -> None: ...

    def _key(
        self, _context: bpy.types.Context, _effect: bpy.types.Object, _event: bpy.types.Event
    ) -> bool:
        return False

    def _words(self, context: bpy.types.Context) -> tuple[str, str]:
        """Texts of the header and of the other keys."""
        raise NotImplementedError
