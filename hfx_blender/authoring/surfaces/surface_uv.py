# SPDX-License-Identifier: GPL-3.0-or-later
"""UV map of a mesh as the map of a haptic surface: size of a UV unit, areas."""

from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from ...blender import mesh_arrays
from ...blender.scene_info import metres_of
from ...engine.arrays import F64, I64
from ...errors import InputError

_OUTSIDE = 1e-4  # of a UV unit
_SMALLEST = 1e-12


@dataclass(frozen=True, eq=False)
class Charts:
    """Triangles of a mesh on a UV map and in the world."""

    name: str  # of the UV map
    uv: F64  # (F, 3, 2)
    tile: tuple[float, float]  # length of a UV unit along U and V in the world, Blender units
    slots: I64  # (F,) material slot of each triangle
    areas: F64  # (F,) in the world

    @property
    def used_slots(self) -> list[int]:
        """Material slots with faces, sorted by falling area."""
        totals = np.bincount(self.slots, self.areas)
        return [int(k) for k in np.argsort(-totals, kind="stable") if k in set(self.slots.tolist())]

    @property
    def leaves_unit_square(self) -> bool:
        """Test for UVs beyond 0..1 by more than 1e-4."""
        return bool((self.uv < -_OUTSIDE).any() or (self.uv > 1.0 + _OUTSIDE).any())

    @property
    def uv_area(self) -> float:
        """Sum of the triangles' areas, in UV units."""
        a, b = self.uv[:, 1] - self.uv[:, 0], self.uv[:, 2] - self.uv[:, 0]
        return float((0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum())


def charts_of(mesh: bpy.types.Mesh, uv_map: str, owner: str, world: npt.ArrayLike) -> Charts:
    """Charts of a mesh with a matrix (4, 4) to world; ``owner`` is the object's name for messages.
    An empty ``uv_map`` is the map active for rendering. Raises InputError: the object has no size,
    there is no such UV map, or the map has no area."""
    points, areas = _triangles(mesh, owner, world)
    layer = layer_of(mesh, uv_map, owner)
    loops = mesh_arrays.triangles(mesh, "loops")
    slots = mesh_arrays.values(mesh.loop_triangles, "material_index", kind=np.int32)
    uv = mesh_arrays.values(layer.uv, "vector", 2).astype(np.float64)[loops]
    if not np.isfinite(uv).all():
        raise InputError(f"UV map '{layer.name}' of '{owner}' has values that are not numbers.")
    tile = _tile(points, uv)
    if tile is None:
        raise InputError(f"UV map '{layer.name}' of '{owner}' has no area: unwrap the mesh first.")
    return Charts(layer.name, uv, tile, slots.astype(np.int64), areas)


def _triangles(mesh: bpy.types.Mesh, owner: str, world: npt.ArrayLike) -> tuple[F64, F64]:
    """World corners (F, 3, 3), without translation, and areas (F,) of triangles, Blender units;
    InputError without any area."""
    # Translation has no effect on sizes.
    linear = np.array(world, np.float64)[:3, :3]
    points = (mesh_arrays.points(mesh) @ linear.T)[mesh_arrays.triangles(mesh)]
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    if not (np.isfinite(points).all() and float(areas.sum()) > _SMALLEST):
        raise InputError(
            f"'{owner}' has no faces of any size (or its scale is 0): it has no surface."
        )
    return points, areas


def projected(mesh: bpy.types.Mesh, owner: str, world: npt.ArrayLike) -> F64:
    """Coordinates (F, 3, 2) without a UV map, projected along each face's main axis, Blender units.

    Adjacent faces with equal main axes continue without a seam.

    Raises InputError: the object has no size.
    """
    points, _ = _triangles(mesh, owner, world)
    # The two axes besides the main axis are the coordinates.
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    main_axis = np.abs(normals).argmax(axis=1)
    plane_axes = np.array([[1, 2], [0, 2], [0, 1]])[main_axis]
    return np.take_along_axis(points, plane_axes[:, None, :], axis=2)


def layer_of(mesh: bpy.types.Mesh, uv_map: str, owner: str) -> bpy.types.MeshUVLoopLayer:
    """UV map by name; "": the map active for rendering, else the first; InputError if missing."""
    layers = mesh.uv_layers
    if not len(layers):
        raise InputError(f"'{owner}' has no UV map. Unwrap it first (in Edit Mode: U).")
    if not uv_map:
        return next((layer for layer in layers if layer.active_render), layers[0])
    if uv_map not in layers:
        names = ", ".join(f"'{layer.name}'" for layer in layers)
        raise InputError(f"'{owner}' has no UV map '{uv_map}'; it has: {names}.")
    return layers[uv_map]


def _tile(points: F64, uv: F64) -> tuple[float, float] | None:
    """Mean length of a UV unit along U and V, weighted by UV area, of corners (F, 3, 3) and UVs (F,
    3, 2); None without an area."""
    uv_1, uv_2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = uv_1[:, 0] * uv_2[:, 1] - uv_1[:, 1] * uv_2[:, 0]
    is_valid = np.abs(determinant) > _SMALLEST
    if not is_valid.any():
        return None
    uv_1, uv_2, determinant = uv_1[is_valid], uv_2[is_valid], determinant[is_valid, None]
    edge_1, edge_2 = (points[is_valid, k] - points[is_valid, 0] for k in (1, 2))
    # Inverse of the 2 x 2 matrix of UV edges times the world edges: the derivative of the position
    # by u and v.
    along_u = (edge_1 * uv_2[:, 1:] - edge_2 * uv_1[:, 1:]) / determinant
    along_v = (edge_2 * uv_1[:, :1] - edge_1 * uv_2[:, :1]) / determinant
    weights = np.abs(determinant[:, 0])
    lengths = [
        float(np.average(np.linalg.norm(along, axis=1), weights=weights))
        for along in (along_u, along_v)
    ]
    return (lengths[0], lengths[1]) if min(lengths) > _SMALLEST else None


def make_tile(mesh: bpy.types.Mesh, charts: Charts, scale: float) -> None:
    """Replace the mesh of an object of ``scale`` by one face: a UV unit at its world size."""
    width, height = charts.tile[0] / scale, charts.tile[1] / scale
    mesh.clear_geometry()
    mesh.from_pydata(
        [(0.0, 0.0, 0.0), (width, 0.0, 0.0), (width, height, 0.0), (0.0, height, 0.0)],
        [],
        [(0, 1, 2, 3)],
    )
    layer = mesh.uv_layers.new(name=charts.name)
    layer.uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    mesh.update()


def update_mesh(obj: bpy.types.Object) -> None:
    """Store edits of Edit Mode in an object's mesh. Raises InputError: the object is no mesh."""
    if obj.type != "MESH":
        raise InputError(f"'{obj.name}' is a {obj.type.lower()}, not a mesh: it has no UV map.")
    if obj.mode == "EDIT":
        obj.update_from_editmode()


def tile_mm(obj: bpy.types.Object, uv_map: str = "") -> tuple[float, float]:
    """Width and height of a UV unit on a mesh object, millimetres; InputError without any."""
    update_mesh(obj)
    tile = charts_of(obj.data, uv_map, obj.name, obj.matrix_world).tile
    unit_mm = 1000.0 * metres_of(bpy.context.scene)
    return tile[0] * unit_mm, tile[1] * unit_mm
