# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces as plain data: triangles, surface coordinates, vertices."""

from __future__ import annotations

import bpy
import numpy as np

from ...authoring.surfaces import surface_uv, surfaces
from ...blender import mesh_arrays
from ...engine.arrays import F64
from ...engine.scene import HapticSurface
from ...errors import InputError

_OF_A_UV_UNIT = ("MATERIAL", "IMAGE")


def describe(effect: bpy.types.Object, evaluated: bpy.types.Object, unit_m: float) -> HapticSurface:
    """Triangles, surface coordinates in metres and texture of a surface. Raises InputError in Edit
    Mode, without faces or a required UV map, or if the maps cannot be made. Coordinates come from
    the UV map with the mean or the user's own scale; without any map, from a projection."""
    if effect.mode == "EDIT":
        raise InputError(f"Surface '{effect.name}' is being edited; leave Edit Mode first.")
    settings, mesh = effect.hfx.surface, evaluated.data
    texture = surfaces.texture_of(effect)
    world = np.array(evaluated.matrix_world, np.float64)
    if len(mesh.uv_layers) or settings.source in _OF_A_UV_UNIT:
        charts = surface_uv.charts_of(mesh, settings.uv_map, effect.name, world)
        tile_m = [length * unit_m for length in charts.tile]
        if settings.use_own_scale:
            tile_m = [length / 1000.0 for length in settings.uv_mm]
        coordinates = charts.uv * tile_m
    else:
        coordinates = surface_uv.projected(mesh, effect.name, world) * unit_m
    return HapticSurface(mesh_arrays.triangles(mesh), coordinates, texture)


class SurfaceVertices:
    """Cache of surface vertices; the identical array is returned while nothing deforms."""

    def __init__(self) -> None:
        self._known: dict[str, F64] = {}

    def of(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> F64:
        """Vertices (V, 3) of an evaluated mesh in object space; the cached array itself if
        unchanged. Raises InputError if the number of vertices differs from the last reading."""
        points = mesh_arrays.points(evaluated.data)
        cached = self._known.get(effect.name)
        if cached is not None and len(cached) != len(points):
            raise InputError(
                f"Surface '{effect.name}' has {len(points)} vertices at one time and "
                f"{len(cached)} at another; a surface may move and deform, but not change its "
                "faces."
            )
        if cached is None or not np.array_equal(cached, points):
            self._known[effect.name] = cached = points
        return cached

    def last_of(self, effect: bpy.types.Object) -> F64 | None:
        """Last vertices (V, 3) of a surface; None before the first reading."""
        return self._known.get(effect.name)


def joined(rows: list[F64 | None]) -> F64 | None:
    """Stack vertices (V, 3) of T times: (T, V, 3), or (1, V, 3) if all entries are the first array
    itself or None. None entries become the first array; None without any array."""
    first = next((row for row in rows if row is not None), None)
    if first is None:
        return None
    if all(row is None or row is first for row in rows):
        return first[None]
    return np.stack([first if row is None else row for row in rows])
