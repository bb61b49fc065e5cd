# SPDX-License-Identifier: GPL-3.0-or-later
"""View of the 3D viewport on what was just added or is painted, and the view before it; room for
clips in the timeline.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import bpy

from .. import compat
from ..blender_events import call_soon
from ..playback import timeline_clips

_VIEW = ("view_location", "view_rotation", "view_distance", "view_perspective")
_BESIDE = 9  # pixels from an edge, farther than its width
_DRAWN_S = 0.05

_joining: partial[None] | None = None


def viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """3D viewport in which the user works: that of the context, or the window's largest."""
    area = context.area
    if area is not None and area.type == "VIEW_3D":
        return area
    if context.screen is None:
        return None
    found = [each for each in context.screen.areas if each.type == "VIEW_3D"]
    return max(found, key=lambda each: each.width * each.height, default=None)


def frame(context: bpy.types.Context, objects: Iterable[bpy.types.Object]) -> None:
    """Show objects as large as the viewport, from where it looks already."""
    area = None if bpy.app.background else viewport(context)
    if area is None:
        return
    region = next(each for each in area.regions if each.type == "WINDOW")
    before = list(context.selected_objects)
    for obj in before:
        obj.select_set(False)
    framed = [obj for obj in objects if obj.name in context.view_layer.objects]
    for obj in framed:
        obj.select_set(True)
    context.view_layer.update()
    with context.temp_override(area=area, region=region):
        bpy.ops.view3d.view_selected()
    for obj in framed:
        obj.select_set(False)
    for obj in before:
        obj.select_set(True)


def execute_with_room(operator: bpy.types.Operator, context: bpy.types.Context) -> set[str]:
    """Execute an operator that a person called, and make room for the clips that it adds."""
    done: set[str] = operator.execute(context)
    make_room_for_clips(context)
    return done


def make_room_for_clips(context: bpy.types.Context) -> None:
    """Make a timeline that is too low for clips to be read higher, where no NLA editor has them."""
    global _joining
    is_busy = _joining is not None and bpy.app.timers.is_registered(_joining)
    if bpy.app.background or is_busy or not compat.CAN_JOIN_AREAS:
        return
    areas = context.screen.areas
    timelines = [area for area in areas if area.ui_type == "TIMELINE"]
    if not timelines or any(area.type == "NLA_EDITOR" for area in areas):
        return
    area = max(timelines, key=lambda each: each.height)
    region = next(each for each in area.regions if each.type == "WINDOW")
    missing = timeline_clips.wanted_height(context) - region.height
    above = [
        each
        for each in areas
        if (each.x, each.width) == (area.x, area.width)
        and 0 < each.y - area.y - area.height < _BESIDE
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
    """Join the areas on both sides of an edge, once Blender knows how large they are."""
    with bpy.context.temp_override(window=window):
        bpy.ops.screen.area_join(source_xy=(x, y - _BESIDE), target_xy=(x, y + _BESIDE))


def state(area: bpy.types.Area) -> dict[str, object]:
    """View of a 3D viewport, to be restored."""
    view = area.spaces.active.region_3d
    found = {name: getattr(view, name) for name in _VIEW}
    return {name: v.copy() if hasattr(v, "copy") else v for name, v in found.items()}


def restore(area: bpy.types.Area, before: dict[str, object]) -> None:
    """Show the view that :func:`state` took."""
    for name, value in before.items():
        setattr(area.spaces.active.region_3d, name, value)
