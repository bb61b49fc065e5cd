# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes as Blender objects: wireframe display, and size of their unit shape."""

from __future__ import annotations

from math import cos, pi, sin
from typing import TYPE_CHECKING

import bpy

from ..blender.stored_values import limited, limited_vector
from ..engine.modality import neutral_temperature_c

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..engine.volume.shape import Shape

_SEGMENTS = 32

SHAPE_LABELS = {
    "CUBOID": "Box",
    "SPHERE": "Sphere",
    "CYLINDER": "Cylinder",
    "CAPSULE": "Capsule",
    "MESH": "Mesh",
}
"""Labels by identifier."""

_Point = tuple[float, float, float]
_Edge = tuple[int, int]


def analytic_shape(hfx: bpy.types.PropertyGroup) -> Shape:
    """Unit shape of a volume that is no mesh; a capsule has its ratio of height and radius."""
    from ..engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere

    if hfx.shape == "CUBOID":
        return Cuboid()
    if hfx.shape == "SPHERE":
        return Sphere()
    if hfx.shape == "CYLINDER":
        return Cylinder()
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
    red, green, blue = PALETTES[palette][COLD if is_cold else hfx.modality]
    return red, green, blue, 1.0


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
    if effect.type != "MESH" or hfx.kind != "VOLUME" or hfx.shape == "MESH":
        return
    if effect.data.users > 1 or effect.data.library is not None:
        # Linked duplicates and library overrides share the mesh, but have their own size.
        effect.data = effect.data.copy()
    points, edges = _wires(hfx)
    effect.data.clear_geometry()
    effect.data.from_pydata(points, edges, [])
    effect.data.update()


def _wires(hfx: bpy.types.PropertyGroup) -> tuple[list[_Point], list[_Edge]]:
    """Points and edges of a volume's wires, local space: a box, or rings of 32 segments."""
    if hfx.shape == "CUBOID":
        x, y, z = (edge / 2 for edge in hfx.size)
        points = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
        edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
        return points, edges
    r, half = hfx.radius, hfx.height / 2
    if hfx.shape == "SPHERE":
        loops = [_ring(r, axes) for axes in ("xy", "yz", "zx")]
    elif hfx.shape == "CYLINDER":
        loops = [_ring(r, "xy", z) for z in (-half, half)]
        for x, y in ((r, 0.0), (0.0, r), (-r, 0.0), (0.0, -r)):
            loops.append([(x, y, -half), (x, y, half)])
    else:
        half = max(half - r, 0.0)  # of the capsule's cylinder
        loops = [_ring(r, "xy", z) for z in (-half, half)]
        # Two closed outlines of half circles: the first and last angle of each half stand twice, at
        # both ends of the cylinder's sides.
        halves = [(k, half) for k in range(_SEGMENTS // 2 + 1)]
        halves += [(k - 1, -half) for k in range(_SEGMENTS // 2 + 1, _SEGMENTS + 2)]
        turns = [(2 * pi * k / _SEGMENTS, end) for k, end in halves]
        outline = [(r * cos(angle), r * sin(angle) + end) for angle, end in turns]
        loops.append([(across, 0.0, along) for across, along in outline])
        loops.append([(0.0, across, along) for across, along in outline])
    points: list[_Point] = []
    edges: list[_Edge] = []
    for loop in loops:
        count = len(loop) if len(loop) > 2 else 1  # two points are a single edge
        first = len(points)
        edges += [(first + k, first + (k + 1) % len(loop)) for k in range(count)]
        points += loop
    return points, edges


def _ring(radius: float, axes: str, height: float = 0.0) -> list[_Point]:
    """Circle of 32 points in the plane of two ``axes`` such as "xy", at ``height`` on the third."""
    points = []
    for k in range(_SEGMENTS):
        point = dict.fromkeys("xyz", height)
        point[axes[0]] = radius * cos(2 * pi * k / _SEGMENTS)
        point[axes[1]] = radius * sin(2 * pi * k / _SEGMENTS)
        points.append((point["x"], point["y"], point["z"]))
    return points
