# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces as the engine's plain data: their triangles and vertices."""

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
    """Constant description of a surface.

    Raises
    ------
    InputError
        It has no faces, no UV map that it needs, or its maps cannot be made.
    """
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
    """Vertices of surfaces; the same array again as long as nothing deforms."""

    def __init__(self) -> None:
        self._known: dict[str, F64] = {}

    def of(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> F64:
        """Vertices (V, 3) in the object's own space.

        Raises
        ------
        InputError
            There are not as many as at the beginning.
        """
        now = mesh_arrays.points(evaluated.data)
        before = self._known.get(effect.name)
        if before is not None and len(before) != len(now):
            raise InputError(
                f"Surface '{effect.name}' has {len(now)} vertices at one time and {len(before)} "
                "at another; a surface may move and deform, but not change its faces."
            )
        if before is None or not np.array_equal(before, now):
            self._known[effect.name] = before = now
        return before

    def last_of(self, effect: bpy.types.Object) -> F64 | None:
        """Vertices that were found last."""
        return self._known.get(effect.name)


def joined(rows: list[F64 | None]) -> F64 | None:
    """Join vertices of several times: (1, V, 3) without deformation, else (T, V, 3)."""
    first = next((row for row in rows if row is not None), None)
    if first is None:
        return None
    if all(row is None or row is first for row in rows):
        return first[None]
    return np.stack([first if row is None else row for row in rows])
