# SPDX-License-Identifier: GPL-3.0-or-later
"""View of the 3D viewport on what was just added or is painted, and the view before it."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

_VIEW = ("view_location", "view_rotation", "view_distance", "view_perspective")


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


def state(area: bpy.types.Area) -> dict[str, object]:
    """View of a 3D viewport, to be restored."""
    view = area.spaces.active.region_3d
    found = {name: getattr(view, name) for name in _VIEW}
    return {name: v.copy() if hasattr(v, "copy") else v for name, v in found.items()}


def restore(area: bpy.types.Area, before: dict[str, object]) -> None:
    """Show the view that :func:`state` took."""
    for name, value in before.items():
        setattr(area.spaces.active.region_3d, name, value)
