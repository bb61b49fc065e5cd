# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes as Blender objects: wireframe display, and size of their unit shape."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import TYPE_CHECKING

import bpy

from ..blender.events import is_painting
from ..blender.stored_values import limited, limited_vector
from ..engine.modality import neutral_temperature_c

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..engine.volume.shape import Shape

_SEGMENTS = 32

_Point = tuple[float, float, float]


def analytic_shape(hfx: bpy.types.PropertyGroup) -> Shape:
    """Unit shape of a volume that is no mesh; a capsule has its ratio of height and radius."""
    from ..engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere

    plain: dict[str, type[Shape]] = {"CUBOID": Cuboid, "SPHERE": Sphere, "CYLINDER": Cylinder}
    if hfx.shape in plain:
        return plain[hfx.shape]()
    # A capsule's unit shape keeps the ratio of cylinder and caps.
    radius, height = limited(hfx, "radius"), limited(hfx, "height")
    return Capsule(max(height / 2 - radius, 0.0) / max(radius, 1e-30))


def effect_colour(
    hfx: bpy.types.PropertyGroup, palette: str = "WARM_COLD"
) -> tuple[float, float, float, float]:
    """Colour (RGBA) of an effect in a palette: that of its modality, or of cold for a temperature
    below neutral."""
    from ..engine.colouring import COLD, PALETTES

    neutral_c = neutral_temperature_c(hfx.temperature_reference == "CONTACT")
    is_cold = hfx.modality == "temperature" and hfx.temperature < neutral_c
    return (*PALETTES[palette][COLD if is_cold else hfx.modality], 1.0)


def shape_scale(hfx: bpy.types.PropertyGroup) -> npt.NDArray[np.float64]:
    """Scale (3,) along x, y, z of the unit shape, Blender units. Half the edges of a cuboid;
    radius, radius, half the height of a cylinder; three times the radius of a sphere or capsule; 1
    for a mesh."""
    import numpy as np

    if hfx.shape == "CUBOID":
        return np.array(limited_vector(hfx, "size")) / 2
    if hfx.shape == "MESH":
        return np.ones(3)
    radius = limited(hfx, "radius")
    if hfx.shape == "CYLINDER":
        return np.array([radius, radius, limited(hfx, "height") / 2])
    return np.full(3, radius)


def refresh_display(effect: bpy.types.Object) -> None:
    """Update a volume's colour and wireframe after an edit of shape or size. Surfaces are
    unchanged, as their display belongs to the user."""
    hfx = effect.hfx
    if hfx.kind == "SURFACE":
        return  # an object of the user's scene
    effect.color = effect_colour(hfx)
    if effect.type != "MESH" or not wire_box(effect):
        return
    if effect.data.users > 1 or effect.data.library is not None:
        # Linked duplicates and library overrides share the mesh, but have their own size.
        effect.data = effect.data.copy()
    points, edges = _wires(hfx)
    effect.data.clear_geometry()
    effect.data.from_pydata(points, edges, [])
    effect.data.update()


def restore_wire(effect: bpy.types.Object) -> None:
    """Redraw the wire of a volume in Object Mode if edits of its mesh changed it. A linked mesh
    stays, and one with faces, as of a joined model."""
    if effect.mode != "OBJECT" or not has_edited_wire(effect, wire_box(effect)):
        return
    stays = effect.data.library is not None or len(effect.data.polygons) > 0
    # Blender's transform of origins writes to as many vertices as the mesh had at its start.
    if not (stays or is_painting("TRANSFORM_OT_")):
        refresh_display(effect)


def has_edited_wire(effect: bpy.types.Object, box: Sequence[float]) -> bool:
    """Test for a mesh whose bounding box differs from ``box`` (6,), see :func:`wire_box`, by more
    than 0.1 %; False for an empty ``box``."""

    def is_other(*found: float) -> bool:
        return any(abs(a - b) > 1e-3 * abs(b) for a, b in zip(found, box, strict=False))

    if effect.type != "MESH" or not is_other(*effect.bound_box[0], *effect.bound_box[6]):
        return False
    # The slow test: modifiers change Blender's box, and that of a hidden object may be outdated.
    from ..blender.mesh_arrays import positions

    points = positions(effect.data)
    return not len(points) or is_other(*points.min(axis=0), *points.max(axis=0))


def wire_box(effect: bpy.types.Object) -> list[float]:
    """Bounding box (6,) of a volume's wire by its properties, local space: lowest and highest
    corner. Empty for effects without a wire of their own."""
    hfx = effect.hfx
    if hfx.kind != "VOLUME" or hfx.shape == "MESH":
        return []
    corner = shape_scale(hfx)
    if hfx.shape == "CAPSULE":
        corner[2] = max(corner[2], limited(hfx, "height") / 2)
    return [*(-corner).tolist(), *corner.tolist()]


def _wires(hfx: bpy.types.PropertyGroup) -> tuple[list[_Point], list[tuple[int, int]]]:
    """Points and edges of a volume's wires, local space: a box, or rings of 32 segments."""
    if hfx.shape == "CUBOID":
        x, y, z = (edge / 2 for edge in limited_vector(hfx, "size"))
        points = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
        edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
        return points, edges
    r, half = limited(hfx, "radius"), limited(hfx, "height") / 2
    if hfx.shape == "SPHERE":
        ring = _ring(r)
        loops = [ring, [(z, x, y) for x, y, z in ring], [(y, z, x) for x, y, z in ring]]
    elif hfx.shape == "CYLINDER":
        loops = [_ring(r, z) for z in (-half, half)]
        loops += [[(x, y, -half), (x, y, half)] for x, y, _ in _ring(r)[:: _SEGMENTS // 4]]
    else:
        half = max(half - r, 0.0)  # of the capsule's cylinder
        loops = [_ring(r, z) for z in (-half, half)]
        # Two closed outlines of half circles, from and to both ends of the cylinder's sides. The
        # lower half is the upper one turned by half a circle.
        upper = [(x, 0.0, y + half) for x, y, _ in [*_ring(r)[: _SEGMENTS // 2], (-r, 0.0, 0.0)]]
        outline = upper + [(-x, 0.0, -z) for x, _, z in upper]
        loops += [outline, [(y, x, z) for x, y, z in outline]]
    points: list[_Point] = []
    edges: list[tuple[int, int]] = []
    for loop in loops:
        count = len(loop) if len(loop) > 2 else 1  # two points are a single edge
        first = len(points)
        edges += [(first + k, first + (k + 1) % len(loop)) for k in range(count)]
        points += loop
    return points, edges


def _ring(radius: float, height: float = 0.0) -> list[_Point]:
    """Circle of 32 points around the z axis at ``height``."""
    turns = (2 * pi * k / _SEGMENTS for k in range(_SEGMENTS))
    return [(radius * cos(turn), radius * sin(turn), height) for turn in turns]
