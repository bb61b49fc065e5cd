# SPDX-License-Identifier: GPL-3.0-or-later
"""Places on the canonical skin mapped to a posed body, and back by a ray."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import bpy
from mathutils import Vector
from mathutils.bvhtree import BVHTree

if TYPE_CHECKING:
    from ...engine.arrays import F64, I64
    from ...engine.body.surface_locator import SurfaceLocator


SKIN_MODEL = "hfx-pressure-1"
"""Model that samples all of the skin evenly."""


@lru_cache(maxsize=1)
def _skin() -> tuple[I64, SurfaceLocator]:
    """Triangles of the canonical body (F, 3), and the search among them."""
    import numpy as np

    from ...engine.body.model import load_model
    from ...engine.body.surface_locator import SurfaceLocator

    model = load_model(SKIN_MODEL)
    triangles = model.triangles.astype(np.int64)
    return triangles, SurfaceLocator(model.vertices[triangles].astype(np.float64))


@dataclass(frozen=True, eq=False)
class Anchors:
    """n places on the skin as triangles of its model and weights of their corners."""

    corners: I64  # (n, 3)
    weights: F64  # (n, 3) sum 1

    @classmethod
    def of(cls, places: F64) -> Anchors:
        """Anchor places (n, 3), rest space of the canonical body."""
        triangles, locator = _skin()
        found = locator.nearest(places)
        return cls(triangles[found.triangle], found.weights)

    def on(self, body: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[F64, F64]:
        """World places and unit normals, (n, 3) each, Blender's units."""
        import numpy as np

        ids, places = np.unique(self.corners, return_inverse=True)
        places = places.reshape(-1, 3)
        points, normals = posed(body, depsgraph, ids)
        found = np.einsum("ij,ijk->ik", self.weights, points[places])
        outward = np.einsum("ij,ijk->ik", self.weights, normals[places])
        return found, outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)


def posed(body: bpy.types.Object, depsgraph: bpy.types.Depsgraph, vertices: I64) -> tuple[F64, F64]:
    """Positions and normals of some vertices of the skin's model on a body, posed by its bones.

    Blender's units, world space, (n, 3) each.

    Raises
    ------
    InputError
        The body models do not fit this body.
    """
    import numpy as np

    from ...avatars import stored_fits
    from ...engine.body.model import load_model

    model = stored_fits.model_of(body, SKIN_MODEL)
    armature = body.evaluated_get(depsgraph)
    flat = np.zeros(len(armature.pose.bones) * 16, np.float32)
    armature.pose.bones.foreach_get("matrix_channel", flat)  # column-major
    place = {bone.name: k for k, bone in enumerate(body.pose.bones)}
    mine = np.array([place.get(name, -1) for name in model.bone_names])
    own = flat.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    matrices = np.concatenate([own, np.eye(4)[None]])[mine]  # a bone that is missing rests
    weights = model.weights
    counts = np.diff(weights.offsets)[vertices]
    starts = np.cumsum(counts) - counts
    within = np.arange(counts.sum()) - np.repeat(starts, counts)
    entries = np.repeat(weights.offsets[vertices], counts) + within
    shares = weights.values[entries].astype(np.float64)
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
    """Ray picker of places on the skin, for one pose of one body.

    Raises
    ------
    InputError
        The body models do not fit this body.
    """

    def __init__(self, body: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
        import numpy as np

        from ...engine.body.model import load_model

        model = load_model(SKIN_MODEL)
        self._rest = model.vertices.astype(np.float64)
        self._triangles = model.triangles.astype(np.int64)
        self._posed, _ = posed(body, depsgraph, np.arange(len(model)))
        self._tree = BVHTree.FromPolygons(self._posed.tolist(), model.triangles.tolist())

    def hit(self, origin: Vector, direction: Vector) -> F64 | None:
        """Canonical place (3,) where a ray of the world first meets the skin."""
        import numpy as np

        place, _, triangle, _ = self._tree.ray_cast(origin, direction)
        return None if place is None else self._canonical(np.array(place), triangle)

    def nearest(self, point: Vector, reach: float) -> F64 | None:
        """The canonical place (3,) nearest to a point of the world, if it is within reach."""
        import numpy as np

        place, _, triangle, distance = self._tree.find_nearest(point)
        if place is None or distance > reach:
            return None
        return self._canonical(np.array(place), triangle)

    def _canonical(self, place: F64, triangle: int) -> F64:
        from ...engine.body.surface_locator import barycentric

        corners = self._triangles[triangle]
        (weights,) = barycentric(place[None], self._posed[corners][None])
        found: F64 = weights @ self._rest[corners]
        return found
