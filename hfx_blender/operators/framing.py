# SPDX-License-Identifier: GPL-3.0-or-later
"""Views of the 3D viewport: framing of objects, saved and restored views; height of timelines."""

from collections.abc import Iterable
from functools import partial
from math import tau
from typing import Any

import bpy
from bpy_extras import view3d_utils
from mathutils import Vector

from ..blender import compat
from ..blender.events import call_soon
from ..playback.timeline import timeline_clips

_VIEW = ("view_location", "view_rotation", "view_distance", "view_perspective")
_BESIDE = 9  # distance from an edge, pixels
_DRAWN_S = 0.05
_TURNED = 1e-3  # smallest turn of a view by a user, radians

_joining: partial[None] | None = None


def viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """3D viewport of the context, or else the largest of the window; None without any."""
    area = context.area
    if area is not None and area.type == "VIEW_3D":
        return area
    if context.screen is None:
        return None
    viewports = [a for a in context.screen.areas if a.type == "VIEW_3D"]
    return max(viewports, key=lambda a: a.width * a.height, default=None)


def region_at(area: bpy.types.Area, x: float, y: float) -> bpy.types.Region:
    """Region of a 3D viewport at a window pixel; ``data`` of the region is the view.

    Outside of all regions: the last region of quad view, the user perspective.
    """
    candidates = views(area)
    return next((region for region in candidates if holds(region, x, y)), candidates[-1])


def holds(region: bpy.types.Region, x: float, y: float) -> bool:
    """Test a pixel of the window for being in a region."""
    return 0 <= x - region.x < region.width and 0 <= y - region.y < region.height


def ray_at(region: bpy.types.Region, x: float, y: float) -> tuple[Vector, Vector]:
    """World-space origin and direction of the ray through a pixel of the window, in a region of a
    3D viewport. An operator started in the sidebar has another region in its context."""
    at = (x - region.x, y - region.y)
    origin = view3d_utils.region_2d_to_origin_3d(region, region.data, at)
    return origin, view3d_utils.region_2d_to_vector_3d(region, region.data, at)


def views(area: bpy.types.Area) -> list[bpy.types.Region]:
    """Content regions of an editor: four in quad view."""
    return [region for region in area.regions if region.type == "WINDOW"]


def frame(context: bpy.types.Context, objects: Iterable[bpy.types.Object]) -> None:
    """Zoom the view to objects, keeping direction and selection; no effect without a viewport."""
    area = None if bpy.app.background else viewport(context)
    if area is None:
        return
    # Blender frames selected objects only: the selection is replaced, then restored.
    before = list(context.selected_objects)
    for obj in before:
        obj.select_set(False)
    framed = [obj for obj in objects if obj.name in context.view_layer.objects]
    for obj in framed:
        obj.select_set(True)
    context.view_layer.update()
    with context.temp_override(area=area, region=views(area)[-1]):
        bpy.ops.view3d.view_selected(use_all_regions=True)
    if context.preferences.system.use_region_overlap:
        _fit_beside_sidebar(area, views(area)[-1], framed)
    for obj in framed:
        obj.select_set(False)
    for obj in before:
        obj.select_set(True)


def _fit_beside_sidebar(
    area: bpy.types.Area, region: bpy.types.Region, objects: Iterable[bpy.types.Object]
) -> None:
    """Zoom a view of objects out, at most 1.5 times, if the sidebar covers them."""
    # The view is not moved: it would no longer turn about the objects.
    sidebar, view = next(r for r in area.regions if r.type == "UI"), region.data
    middle = region.width / 2.0
    free = (sidebar.x - region.x if sidebar.width > 1 else region.width) - middle
    view.update()
    corners = (obj.matrix_world @ Vector(corner) for obj in objects for corner in obj.bound_box)
    seen = (view3d_utils.location_3d_to_region_2d(region, view, place) for place in corners)
    half = max((place.x - middle for place in seen if place is not None), default=0.0)
    if half > free > 0.0:
        view.view_distance *= min(half / free, 1.5)


def show_locally(context: bpy.types.Context, objects: Iterable[bpy.types.Object]) -> None:
    """Add objects to the local view of the viewport, if enabled."""
    area = viewport(context)
    if area is not None and area.spaces.active.local_view is not None:
        for obj in objects:
            obj.local_view_set(area.spaces.active, True)


def execute_with_room(operator: bpy.types.Operator, context: bpy.types.Context) -> set[str]:
    """Execute an operator, then :func:`make_room_for_clips`; returns the operator's result."""
    done: set[str] = operator.execute(context)
    make_room_for_clips(context)
    return done


def make_room_for_clips(context: bpy.types.Context) -> None:
    """Enlarge the tallest timeline if too low for its clips, by splitting the area above.

    No effect before Blender 4.3, with an open NLA editor, without an area of three times the
    missing height above, in background mode, and before the end of an earlier call."""
    global _joining
    is_busy = _joining is not None and bpy.app.timers.is_registered(_joining)
    if bpy.app.background or is_busy or not compat.CAN_JOIN_AREAS:
        return
    areas = context.screen.areas
    timelines = [area for area in areas if area.ui_type == "TIMELINE"]
    if not timelines or any(area.type == "NLA_EDITOR" for area in areas):
        return
    area = max(timelines, key=lambda timeline: timeline.height)
    region = views(area)[0]
    missing = timeline_clips.wanted_height(context) - region.height
    above = [
        other_area
        for other_area in areas
        if (other_area.x, other_area.width) == (area.x, area.width)
        and 0 < other_area.y - area.y - area.height < _BESIDE
    ]
    if missing <= 0.0 or not above or above[0].height < 3.0 * missing:
        return
    # Edges cannot be moved while the mouse is over an area: a part of the area above is joined.
    with context.temp_override(area=above[0]):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=missing / above[0].height)
    edge = area.x + area.width // 2, area.y + area.height
    _joining = partial(_join, context.window, *edge)
    call_soon(_joining, _DRAWN_S)


def _join(window: bpy.types.Window, x: int, y: int) -> None:
    """Join the areas above and below an edge at a window pixel; run by a timer, after Blender has
    updated the sizes."""
    with bpy.context.temp_override(window=window):
        bpy.ops.screen.area_join(source_xy=(x, y - _BESIDE), target_xy=(x, y + _BESIDE))


def state(area: bpy.types.Area) -> list[dict[str, Any]]:
    """Location, rotation, distance and projection of each view of a 3D viewport, as copies."""
    saved = [{name: getattr(view.data, name) for name in _VIEW} for view in views(area)]
    # Vectors and quaternions are references into Blender's memory, which change with the view.
    return [{n: v.copy() if hasattr(v, "copy") else v for n, v in view.items()} for view in saved]


def restore(area: bpy.types.Area, before: list[dict[str, Any]]) -> None:
    """Restore the views of :func:`state` that were not turned since; only the last if quad view was
    left since."""
    for region, values in zip(reversed(views(area)), reversed(before), strict=False):
        turn = region.data.view_rotation.rotation_difference(values["view_rotation"]).angle
        if abs(turn - round(turn / tau) * tau) > _TURNED:
            continue
        for name, value in values.items():
            setattr(region.data, name, value)
