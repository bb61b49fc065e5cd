# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the path of a point on the skin with the mouse, on the posed avatar."""

import math
import time
from contextlib import suppress
from typing import ClassVar

import bpy

from ...authoring.paths import paths, skin_picking
from ...blender.translation import translated
from ...errors import InputError
from .. import framing
from ..shared import IS_EDITABLE, HfxOperator, ModalTimer
from . import path_overlay
from .path_operators import ON_SPOT, active_spot

MODES = (
    ("PLACE", "Place", "Click the place of the point"),
    ("STRAIGHT", "Straight", "Click places; the shortest paths on the skin join them"),
    ("CURVE", "Curve", "Click places; a smooth curve goes through them"),
    ("FREEHAND", "Freehand", "Draw while the left button is held"),
    (
        "RECORD",
        "Record",
        "Move the point while the left button is held: path and speed are recorded as keyframes",
    ),
)
_HELD = ("FREEHAND", "RECORD")
_CLOSEST_M = 0.001
_HINTS = {
    "PLACE": "Click on the body: place the point     Esc: cancel",
    "STRAIGHT": "Click on the body: next place     Backspace: take back     Enter: finish     "
    "Esc: cancel",
    "FREEHAND": "Hold the left button and draw on the body     Esc: cancel",
    "RECORD": "Hold the left button and move over the body to record the motion     Esc: cancel",
}


class HfxPathPoint(bpy.types.PropertyGroup):
    """Point of a path during drawing."""

    place: bpy.props.FloatVectorProperty(
        name="Place", description="Metres, rest space of the canonical body", precision=4
    )
    time: bpy.props.FloatProperty(name="Time", description="Seconds since the first place")


class HFX_OT_draw_path(ModalTimer, HfxOperator):
    """Draw the path of a point on the skin, on the posed avatar"""

    bl_label = "Draw Path"
    bl_options: ClassVar = {"REGISTER", "UNDO", "BLOCKING"}

    mode: bpy.props.EnumProperty(
        name="Draw", description="Way of drawing the path", items=MODES, default="STRAIGHT"
    )
    closed: bpy.props.BoolProperty(name="Closed", description="The path returns to its start")
    stroke: bpy.props.CollectionProperty(
        name="Places",
        description="For scripts: [{'name': '', 'place': (x, y, z), 'time': 0.0}, ...]",
        type=HfxPathPoint,
        options={"HIDDEN", "SKIP_SAVE"},
    )
    frame: bpy.props.IntProperty(
        name="Frame", description="First frame of a recording", options={"SKIP_SAVE"}
    )

    requires = (ON_SPOT, IS_EDITABLE)

    def draw(self, _context: bpy.types.Context) -> None:
        if self.mode in ("STRAIGHT", "CURVE"):
            self.layout.prop(self, "mode")
        if self.mode not in ("PLACE", "RECORD"):
            self.layout.prop(self, "closed")

    def work(self, context: bpy.types.Context) -> str:
        effect = active_spot(context)
        if not len(self.stroke):
            raise InputError("Draw on the body: no place was given.")
        places = [tuple(point.place) for point in self.stroke]
        if self.mode == "RECORD":
            start = self.frame if self.properties.is_property_set("frame") else None
            frame = float(context.scene.frame_current if start is None else start)
            times = [point.time for point in self.stroke]
            paths.record(context.scene, effect, places, times, frame)
            message = f"{paths.length_m(effect):.2f} m in {times[-1] - times[0]:.2f} s"
        else:
            kinds = {"CURVE": "curve", "FREEHAND": "traced"}
            if self.mode == "PLACE":
                places = places[-1:]
            length = paths.draw(
                effect, places, kind=kinds.get(self.mode, "straight"), closed=self.closed
            )
            message = f"{length:.2f} m" if length > 0.0 else ""
        paths.move_to_path(effect, context.evaluated_depsgraph_get())
        return message

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if context.area is None or context.area.type != "VIEW_3D":
            raise InputError("Draw in a 3D viewport.")
        body = active_spot(context).hfx.body
        if body is None:
            raise InputError("The point has no body; choose one first.")
        self._picker = skin_picking.Picker(body, context.evaluated_depsgraph_get())
        self.stroke.clear()
        self.frame = context.scene.frame_current
        self._is_held = False
        self._began_s = 0.0
        # A hand at rest sends no mouse events; the timer records its rest.
        if self.mode == "RECORD":
            self._timer = context.window_manager.event_timer_add(1 / 60, window=context.window)
        context.workspace.status_text_set(translated(_HINTS.get(self.mode, _HINTS["STRAIGHT"])))
        context.window.cursor_modal_set("PAINT_CROSS")
        context.window_manager.modal_handler_add(self)
        path_overlay.show_pending(body)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # A right click cancels before the first place, and finishes afterwards.
        if event.type == "ESC" or (event.type == "RIGHTMOUSE" and not len(self.stroke)):
            self._end(context)
            return {"CANCELLED"}
        if self.mode in _HELD:
            return self._held(context, event)
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            if not self._over_region(context, event):
                return {"PASS_THROUGH"}
            self._add(context, event)
            if self.mode == "PLACE" and len(self.stroke):
                return self._finish(context)
            return {"RUNNING_MODAL"}
        if event.type == "BACK_SPACE" and event.value == "PRESS" and len(self.stroke):
            self.stroke.remove(len(self.stroke) - 1)
            self._show(context)
            return {"RUNNING_MODAL"}
        ends = {"RET", "NUMPAD_ENTER", "RIGHTMOUSE"}
        if event.type in ends and event.value == "PRESS" and len(self.stroke):
            return self._finish(context)
        return {"PASS_THROUGH"}  # the user may turn the view between clicks

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore the view after Blender has ended the operator, as opening a file does."""
        self._end(context)

    def _held(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "LEFTMOUSE":
            if event.value == "PRESS" and self._over_region(context, event):
                self._is_held, self._began_s = True, time.monotonic()
                self._add(context, event)
                return {"RUNNING_MODAL"}
            if event.value == "RELEASE" and self._is_held:
                self._add(context, event)
                return self._finish(context) if len(self.stroke) else {"RUNNING_MODAL"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "TIMER") and self._is_held:
            self._add(context, event)
            return {"RUNNING_MODAL"}
        return {"RUNNING_MODAL"} if self._is_held else {"PASS_THROUGH"}

    def _over_region(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Test for a mouse position on the viewport, outside of toolbar and sidebar."""
        at = event.mouse_x, event.mouse_y
        # Toolbar and sidebar lie over the viewport's region.
        regions = [region for region in context.area.regions if framing.holds(region, *at)]
        return {region.type for region in regions} == {"WINDOW"}

    def _add(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        """Append the point under the mouse with its time; outside of the body nothing, or the last
        point while recording. Freehand points closer than 1 mm are left out."""
        region = framing.region_at(context.area, event.mouse_x, event.mouse_y)
        hit = self._picker.hit(*framing.ray_at(region, event.mouse_x, event.mouse_y))
        if hit is None and self.mode == "RECORD" and len(self.stroke):
            hit = tuple(self.stroke[-1].place)  # a copy: adding a point moves the collection
        if hit is None:
            return
        # Dense points would slow down the path search, and add nothing.
        if self.mode == "FREEHAND" and len(self.stroke):
            if math.dist(hit, self.stroke[-1].place) < _CLOSEST_M:
                return
        if not len(self.stroke):
            self._began_s = time.monotonic()
        point = self.stroke.add()
        point.place = tuple(hit)
        point.time = time.monotonic() - self._began_s
        self._show(context)

    def _show(self, context: bpy.types.Context) -> None:
        import numpy as np

        places = np.array([point.place for point in self.stroke], np.float64).reshape(-1, 3)
        body = active_spot(context).hfx.body if active_spot(context) is not None else None
        path = None
        if self.mode in ("STRAIGHT", "CURVE") and len(places) > 1:
            with suppress(InputError):  # no path on the skin joins the points: straight segments
                path = paths.through(places, "curve" if self.mode == "CURVE" else "straight")[1]
        path_overlay.show_pending(body, places, path)
        context.area.tag_redraw()

    def _finish(self, context: bpy.types.Context) -> set[str]:
        self._end(context)
        return self.execute(context)

    def _end(self, context: bpy.types.Context) -> None:
        path_overlay.show_pending(None)
        self.stop_timer(context)
        context.workspace.status_text_set(None)
        context.window.cursor_modal_restore()
        if context.area is not None:
            context.area.tag_redraw()
