# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D viewport while an area is painted: only the perceptual model, as large as the viewport,
with a brush that keeps its size on the skin. All is as before afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from idprop.types import IDPropertyGroup
from mathutils import Vector

from ...authoring.areas import painting
from ...blender import compat
from .. import framing

_HIDDEN = "hfx_hidden_to_paint"
"""ID property of the mesh that is painted on: the objects that are hidden meanwhile. Being in the
file, it survives saving, and an undo of the beginning shows all of it again by itself. A full copy
of the scene refers to its own objects.
"""

_OPACITY = 0.45
"""Opacity of Weight Paint's colours: full blue, which means unpainted, would hide the shape."""

_LEAST_PIXELS, _MOST_PIXELS = 4.0, 500.0

_before: dict[int, tuple[list[dict[str, object]], float]] = {}
"""Views and opacity before painting, by the viewport's pointer; for as long as Blender runs."""


def hide_others(context: bpy.types.Context, canvas: bpy.types.Object) -> None:
    """Hide everything else that can be seen."""
    others = [obj for obj in context.view_layer.objects if obj != canvas and obj.visible_get()]
    for obj in others:
        obj.hide_set(True)
    canvas[_HIDDEN] = {str(number): obj for number, obj in enumerate(others)}


def hidden_by(canvas: bpy.types.Object) -> set[str]:
    """Full names of the objects that are hidden while a mesh is painted on."""
    # Earlier versions kept names, or marked the avatar's meshes.
    marked = {obj.name_full for obj in bpy.data.objects if obj.get(_HIDDEN) is True}
    kept = canvas.get(_HIDDEN, ())
    if isinstance(kept, IDPropertyGroup):
        kept = [obj.name_full for obj in kept.values() if obj is not None]
    return marked.union(kept)


def layers_of(canvas: bpy.types.Object) -> list[bpy.types.ViewLayer]:
    """View layers with a mesh that is painted on: several if the scene was copied meanwhile."""
    layers = [layer for scene in bpy.data.scenes for layer in scene.view_layers]
    return [layer for layer in layers if canvas.name in layer.objects]


def show(layers: Iterable[bpy.types.ViewLayer], hidden: set[str]) -> None:
    """Show objects that were hidden to paint, by their full names."""
    for obj in [each for each in bpy.data.objects if each.name_full in hidden]:
        for layer in layers:
            with suppress(RuntimeError):  # it is not in this one
                obj.hide_set(False, view_layer=layer)


def enter(context: bpy.types.Context, canvas: bpy.types.Object) -> None:
    """Frame the mesh that is painted on."""
    area = framing.viewport(context)
    if area is None:
        return
    overlay = area.spaces.active.overlay
    _before[area.as_pointer()] = framing.state(area), overlay.weight_paint_mode_opacity
    overlay.weight_paint_mode_opacity = _OPACITY
    framing.frame(context, [canvas])


def leave() -> None:
    """Restore the view before painting, however painting ended."""
    for screen in bpy.data.screens:  # of other workspaces, too
        for area in screen.areas:
            view = _before.pop(area.as_pointer(), None)
            if view is not None and area.type == "VIEW_3D":
                framing.restore(area, view[0])
                area.spaces.active.overlay.weight_paint_mode_opacity = view[1]
    forget()


def forget() -> None:
    """Drop the views before painting: they are of another file."""
    _before.clear()


class SceneBrush:
    """Brush whose size on the skin stays when the view changes.

    Weight Paint's brushes have sizes in pixels only. Whoever changes these chooses another size
    on the skin.

    Parameters
    ----------
    radius : float
        On the skin, Blender's units.
    least : float
        Smallest radius that reaches a vertex wherever the brush is, at the median spacing.
    """

    def __init__(self, radius: float, least: float) -> None:
        self.radius, self.least = radius, least
        self._pixels = 0

    def fit(
        self, context: bpy.types.Context, canvas: bpy.types.Object, event: bpy.types.Event
    ) -> None:
        """Set the brush's pixels for the present view under the mouse."""
        scale = _pixels_per_unit(context, canvas, event)
        if scale is None:
            return
        pixels = compat.brush_radius(context)
        if self._pixels and abs(pixels - self._pixels) > 1:  # the user's choice
            self.radius = pixels / scale
        radius = max(self.radius, self.least)
        wanted = round(min(max(radius * scale, _LEAST_PIXELS), _MOST_PIXELS))
        if wanted != pixels:
            compat.set_brush_radius(context, wanted)
        self._pixels = compat.brush_radius(context)


def brush_for(canvas: bpy.types.Object, effect: bpy.types.Object) -> SceneBrush:
    """Brush for a mesh that is painted on, from the spacing of its vertices."""
    spacing = painting.spacing(canvas, effect)
    return SceneBrush(painting.brush_radius(canvas, effect), spacing)


def _pixels_per_unit(
    context: bpy.types.Context, canvas: bpy.types.Object, event: bpy.types.Event
) -> float | None:
    """Pixels in the 3D viewport of one of Blender's units at the middle of a mesh."""
    area = framing.viewport(context)
    if area is None:
        return None
    region = framing.region_at(area, event.mouse_x, event.mouse_y)
    view = region.data
    corners = [canvas.matrix_world @ Vector(corner) for corner in canvas.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    if view.is_perspective:  # where the user looks, or a limb in close-up would have a thin brush
        middle = view.view_location
    across = view.view_rotation @ Vector((1.0, 0.0, 0.0))
    length = max(max(canvas.dimensions), 1e-6) * 0.01
    ends = [
        location_3d_to_region_2d(region, view, place)
        for place in (middle, middle + across * length)
    ]
    if None in ends:
        return None
    return float((ends[1] - ends[0]).length) / length
