# SPDX-License-Identifier: GPL-3.0-or-later
"""Mapping between points on the canonical skin and a posed body, and ray picking."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import bpy
from mathutils import Vector
from mathutils.bvhtree import BVHTree

if TYPE_CHECKING:
    from ...engine.arrays import F64, I64
    from ...engine.volume.mesh_distance import SurfaceLocator


SKIN_MODEL = "hfx-pressure-1"  # perceptual model with an even density on all skin


@lru_cache(maxsize=1)
def _skin() -> tuple[I64, SurfaceLocator]:
    """Triangles (F, 3) of the canonical body, and a locator of nearest points on them; cached."""
    import numpy as np

    from ...engine.body.model import load_model
    from ...engine.volume.mesh_distance import SurfaceLocator

    model = load_model(SKIN_MODEL)
    triangles = model.triangles.astype(np.int64)
    return triangles, SurfaceLocator(model.vertices[triangles].astype(np.float64))


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points on the skin as corners and barycentric weights of triangles."""

    corners: I64  # (n, 3)
    weights: F64  # (n, 3) sum 1

    @classmethod
    def of(cls, places: F64) -> Anchors:
        """Nearest points of the canonical skin in rest to ``places`` (n, 3), metres, as anchors."""
        triangles, locator = _skin()
        feet = locator.nearest(places)
        return cls(triangles[feet.triangle], feet.weights)

    def posed_on(self, body: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[F64, F64]:
        """World positions and unit normals on a posed body, (n, 3) each, Blender units; InputError
        for an outdated fit."""
        import numpy as np

        # Neighbouring anchors share corners: each vertex is posed once.
        ids, numbers = np.unique(self.corners, return_inverse=True)
        numbers = numbers.reshape(-1, 3)
        vertices, normals = posed_vertices(body, depsgraph, ids)
        points = np.einsum("ij,ijk->ik", self.weights, vertices[numbers])
        outward = np.einsum("ij,ijk->ik", self.weights, normals[numbers])
        return points, outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)


def posed_vertices(
    body: bpy.types.Object, depsgraph: bpy.types.Depsgraph, vertices: I64
) -> tuple[F64, F64]:
    """Positions and normals of skin vertices on a body posed by bones, (n, 3) each.

    World space, Blender units. Normals are not normalised. Preserve Volume and further modifiers
    are ignored.

    Raises InputError: the stored fit is outdated.
    """
    import numpy as np

    from ...avatars import stored_fits
    from ...engine.body.model import load_model

    model = stored_fits.model_of(body, SKIN_MODEL)
    armature = body.evaluated_get(depsgraph)
    flat = np.zeros(len(armature.pose.bones) * 16, np.float32)
    armature.pose.bones.foreach_get("matrix_channel", flat)  # column-major
    bone_indices = {bone.name: k for k, bone in enumerate(body.pose.bones)}
    model_bones = np.array([bone_indices.get(name, -1) for name in model.bone_names])
    bone_matrices = flat.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    # Bones of the model that the armature lacks have index -1: the identity, appended last.
    matrices = np.concatenate([bone_matrices, np.eye(4)[None]])[model_bones]
    weights = model.weights
    # Flat list of all (vertex, bone) weights of the given vertices, summed per vertex by reduceat.
    counts = np.diff(weights.offsets)[vertices]
    starts = np.cumsum(counts) - counts
    offsets = np.arange(counts.sum()) - np.repeat(starts, counts)
    entries = np.repeat(weights.offsets[vertices], counts) + offsets
    shares = weights.values[entries].astype(np.float64)
    # Linear blend skinning: the weighted sum of bone matrices moves a vertex.
    skin = np.add.reduceat(shares[:, None, None] * matrices[weights.bones[entries]], starts)
    skin = np.array(armature.matrix_world, np.float64) @ skin
    points = model.vertices[vertices].astype(np.float64)
    normals = load_model(SKIN_MODEL).normals[vertices].astype(np.float64)
    if stored_fits.is_fitted(body):
        normals = model.normals[vertices].astype(np.float64)
    return (
        np.einsum("nij,nj->ni", skin[:, :3, :3], points) + skin[:, :3, 3],
        np.einsum("nij,nj->ni", skin[:, :3, :3], normals),
    )


class Picker:
    """Ray picking on the skin in a pose of a body; InputError if the stored fit is outdated."""

    def __init__(self, body: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
        import numpy as np

        from ...engine.body.model import load_model

        model = load_model(SKIN_MODEL)
        self._rest = model.vertices.astype(np.float64)
        self._triangles = model.triangles.astype(np.int64)
        self._posed, _ = posed_vertices(body, depsgraph, np.arange(len(model)))
        self._tree = BVHTree.FromPolygons(self._posed.tolist(), model.triangles.tolist())

    def hit(self, origin: Vector, direction: Vector) -> F64 | None:
        """Canonical point (3,) of a world ray's first hit on the skin; None without a hit."""
        import numpy as np

        position, _, triangle, _ = self._tree.ray_cast(origin, direction)
        return None if position is None else self._canonical(np.array(position), triangle)

    def nearest(self, point: Vector, reach: float) -> F64 | None:
        """Canonical point (3,) nearest to a world point; None beyond ``reach`` in Blender units."""
        import numpy as np

        position, _, triangle, distance = self._tree.find_nearest(point)
        if position is None or distance > reach:
            return None
        return self._canonical(np.array(position), triangle)

    def _canonical(self, place: F64, triangle: int) -> F64:
        """Point (3,) of the rest body with the barycentric weights of a world point ``place`` (3,)
        in a posed triangle."""
        from ...engine.volume.mesh_distance import barycentric

        corners = self._triangles[triangle]
        (weights,) = barycentric(place[None], self._posed[corners][None])
        canonical: F64 = weights @ self._rest[corners]
        return canonical
