# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes and their bones' vertex groups from arrays, in bulk."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import bmesh
import bpy
import numpy as np

from ..engine.arrays import F32, F64, I32
from ..engine.body.model import SkinWeights


def mesh_of(name: str, vertices: F32 | F64, faces: I32) -> bpy.types.Mesh:
    """Mesh of vertices (N, 3) and faces (F, 3 or 4), a missing last corner being -1."""
    mesh = bpy.data.meshes.new(name)
    is_corner = faces >= 0
    corners = is_corner.sum(axis=1)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(int(corners.sum()))
    mesh.loops.foreach_set("vertex_index", faces[is_corner].astype(np.int32))
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(corners) - corners).astype(np.int32))
    mesh.update(calc_edges=True)
    return mesh


def add_bone_groups(
    skin: bpy.types.Object, bone_names: Sequence[str], weights: SkinWeights
) -> list[bpy.types.VertexGroup]:
    """Add a vertex group for each bone to a mesh object that has none, with the bones' weights."""
    groups = [skin.vertex_groups.new(name=bone) for bone in bone_names]
    # Vertex by vertex, `VertexGroup.add` takes three times as long.
    edited = bmesh.new()
    edited.from_mesh(skin.data)
    layer = edited.verts.layers.deform.verify()
    entries = iter(zip(weights.bones.tolist(), weights.values.tolist(), strict=True))
    for vertex, count in zip(edited.verts, np.diff(weights.offsets).tolist(), strict=True):
        of_vertex = vertex[layer]
        for bone, value in islice(entries, count):
            of_vertex[bone] = value
    edited.to_mesh(skin.data)
    edited.free()
    return groups
