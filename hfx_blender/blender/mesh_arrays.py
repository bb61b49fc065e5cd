# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between Blender's meshes and arrays."""

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Vector


def values(
    items: bpy.types.bpy_prop_collection,
    name: str,
    width: int = 1,
    kind: npt.DTypeLike = np.float32,
) -> npt.NDArray[Any]:
    """Property of all items of a collection: (n,), or (n, width) for a vector property."""
    array = np.zeros(len(items) * width, kind)
    items.foreach_get(name, array)
    return array if width == 1 else array.reshape(-1, width)


def positions(mesh: bpy.types.Mesh) -> npt.NDArray[np.float32]:
    """Vertices (V, 3) of a mesh, local space; in Edit Mode as before it began."""
    # Faster than ``MeshVertex.co`` once evaluated; an empty or edited mesh lacks the attribute.
    if (attribute := mesh.attributes.get("position")) is None:
        return values(mesh.vertices, "co", 3)
    return values(attribute.data, "vector", 3)


def points(mesh: bpy.types.Mesh) -> npt.NDArray[np.float64]:
    """Vertices (V, 3) of a mesh in double precision, local space."""
    return positions(mesh).astype(np.float64)


def world_box(obj: bpy.types.Object) -> npt.NDArray[np.float64]:
    """Lowest and highest corner (2, 3) of an object's bounding box, world axes."""
    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def triangles(mesh: bpy.types.Mesh, name: str = "vertices") -> npt.NDArray[np.int32]:
    """Vertex indices, or another property such as "loops", of a mesh's triangles, (F, 3)."""
    mesh.calc_loop_triangles()
    return values(mesh.loop_triangles, name, 3, np.int32)


def mesh_of(
    name: str, vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.int32]
) -> bpy.types.Mesh:
    """New mesh of vertices (N, 3) and faces (F, 3 or 4); -1 as last corner marks a triangle."""
    mesh = bpy.data.meshes.new(name)
    is_corner = faces >= 0
    corners = is_corner.sum(axis=1)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(int(corners.sum()))
    mesh.loops.foreach_set("vertex_index", faces[is_corner].astype(np.int32))
    mesh.polygons.add(len(faces))
    # Blender derives the size of a face from the start of the next face.
    mesh.polygons.foreach_set("loop_start", (np.cumsum(corners) - corners).astype(np.int32))
    mesh.update(calc_edges=True)
    return mesh
