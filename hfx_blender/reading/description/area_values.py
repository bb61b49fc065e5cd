# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas of spots, vector sensations and surfaces, and their values over time."""

import re
from collections.abc import Callable

import bpy
import numpy as np

from ...authoring.effects import effect_values
from ...authoring.paths import paths
from ...authoring.surfaces import surface_uv, surfaces
from ...blender import mesh_arrays
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.scene import ActuatorArea, HapticSurface, SpotArea
from ...errors import InputError

Value = Callable[[str], F64]  # function from a property path below ``hfx`` to values (T,)
_DRIVE = re.compile(r"hfx\.drive\[(\d+)\]\.value")

PLACE = ("path_position", "radius")


def is_drive(path: str) -> bool:
    """Test an RNA path for the strength of an actuator, ``hfx.drive[k].value``."""
    return _DRIVE.fullmatch(path) is not None


def place(hfx: bpy.types.PropertyGroup, unit_m: float) -> F64 | None:
    """Present position on the path (0..1) and radius in metres, (2,), clamped to hard limits; None
    unless a spot."""
    if hfx.kind != "SPOT":
        return None
    return np.array([limited(hfx, "path_position"), limited(hfx, "radius") * unit_m])


def drive(hfx: bpy.types.PropertyGroup) -> F64 | None:
    """Present strengths (A,) of the actuators, clamped to hard limits; None unless of kind
    ACTUATORS."""
    if hfx.kind != "ACTUATORS":
        return None
    return np.array([limited(item, "value") for item in hfx.drive], np.float64)


def places(hfx: bpy.types.PropertyGroup, unit_m: float, value: Value) -> F64 | None:
    """Position on the path (0..1) and radius in metres at T times, (T, 2), from ``value(name)`` in
    Blender units; None unless a spot."""
    if hfx.kind != "SPOT":
        return None
    along, radius = (value(name) for name in PLACE)
    return np.stack([along, radius * unit_m], axis=1)


def drives(hfx: bpy.types.PropertyGroup, value: Value) -> F64 | None:
    """Strengths (T, A) of A actuators from ``value("drive[k].value")``; None without any."""
    if hfx.kind != "ACTUATORS" or not len(hfx.drive):
        return None
    return np.stack([value(f"drive[{k}].value") for k in range(len(hfx.drive))], axis=1)


def spot_area(effect: bpy.types.Object, body_id: str) -> SpotArea:
    """Path and falloff of a spot; raises InputError without a position or for a damaged path."""
    path = paths.path_of(effect)
    if not len(path):
        raise InputError(f"Effect '{effect.name}' is nowhere on the skin. Place it, or delete it.")
    return SpotArea(body_id, path, effect_values.falloff(effect.hfx))


def actuator_area(effect: bpy.types.Object, body_id: str) -> ActuatorArea:
    """Device and actuators, in stored order, of a vector sensation; raises InputError without a
    device or actuator, and for an actuator listed twice."""
    names = tuple(item.name for item in effect.hfx.drive)
    if not effect.hfx.device or not names:
        raise InputError(f"Effect '{effect.name}' drives no actuators. Choose its device.")
    if len(set(names)) != len(names):
        raise InputError(f"Effect '{effect.name}' names an actuator twice.")
    return ActuatorArea(body_id, effect.hfx.device, names)


def signature(effect: bpy.types.Object) -> tuple[object, ...]:
    """Comparable value for the detection of changes: hash of a spot's path, or device id and names
    of the driven actuators of an actuator effect; () for other kinds."""
    hfx = effect.hfx
    if hfx.kind == "SPOT":
        return (hash(paths.path_of(effect).tobytes()),)
    return (hfx.device, *(item.name for item in hfx.drive)) if hfx.kind == "ACTUATORS" else ()


def surface_area(
    effect: bpy.types.Object, evaluated: bpy.types.Object, unit_m: float
) -> HapticSurface:
    """Triangles, surface coordinates in metres and texture of a surface. Raises InputError in Edit
    Mode, without faces or a required UV map, or if the maps cannot be made. Coordinates come from
    the UV map with the mean or the user's own scale; without any map, from a projection."""
    if effect.mode == "EDIT":
        raise InputError(f"Surface '{effect.name}' is being edited; leave Edit Mode first.")
    settings, mesh = effect.hfx.surface, evaluated.data
    texture = surfaces.texture_of(effect)
    world = np.array(evaluated.matrix_world, np.float64)
    if len(mesh.uv_layers) or settings.source in ("MATERIAL", "IMAGE"):
        charts = surface_uv.charts_of(mesh, settings.uv_map, effect.name, world)
        tile_m = [length * unit_m for length in charts.tile]
        if settings.use_own_scale:
            tile_m = [length / 1000.0 for length in settings.uv_mm]
        # Textures of the engine are in metres, a UV map has no unit: the mean size of a UV unit on
        # the mesh gives the scale.
        coordinates = charts.uv * tile_m
    else:
        tile_m = [0.0, 0.0]
        coordinates = surface_uv.projected(mesh, effect.name, world) * unit_m
    uv_m = float(tile_m[0]), float(tile_m[1])
    law = effect_values.contact_law(effect.hfx)
    return HapticSurface(mesh_arrays.triangles(mesh), coordinates, texture, uv_m=uv_m, law=law)


def points_inward(mesh: bpy.types.Mesh) -> bool:
    """Test for a closed mesh whose normals point to its inside: its signed volume is negative."""
    from ...engine.volume.mesh_topology import is_closed

    triangles = mesh_arrays.triangles(mesh)
    corners = mesh_arrays.points(mesh)[triangles]
    return is_closed(triangles) and bool(np.linalg.det(corners - corners[0, 0]).sum() < 0.0)


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
    # SurfaceVertices returns the identical array while nothing deforms: one copy serves all times.
    return stacked([first] if all(row is None or row is first for row in rows) else rows)


def stacked(rows: list[F64 | None]) -> F64 | None:
    """Stack arrays to (T, ...); None entries become copies of the first array. None without any."""
    first = next((row for row in rows if row is not None), None)
    return None if first is None else np.stack([first if row is None else row for row in rows])
