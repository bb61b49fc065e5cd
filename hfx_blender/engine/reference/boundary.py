# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest boundary points of volumes from points inside, measured in the world.

A convex volume is the intersection of the supporting half spaces. The distance from a point inside
to the plane with normal w is ``H(w) - w . x``, H the volume's support function (Schneider, "Convex
Bodies: The Brunn-Minkowski Theory", section 1.7); the depth is the minimum over all w. Under a
placing matrix A, a plane's normal w becomes ``A^-T w``, so the world distance is ``(H(w) - w . x) /
|A^-T w|`` with H and x in shape space.
"""

from typing import Final

import numpy as np

from ..arrays import F64
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.mesh import MeshVolume
from ..volume.shape import Shape
from .pose import moved
from .shapes import contains, nearest_on_triangles

_STARTS: Final = 256  # directions of the first search
_KEPT: Final = 4  # best directions, refined separately
_ROUNDS: Final = 16  # each halves the step, so that the last squared step is below rounding


def nearest(shape: Shape, points: F64, to_world: F64) -> tuple[F64, F64, F64]:
    """Nearest boundary points, and outward unit normals there, (3, N) each in world space, and
    distances (N,), metres, 0 for points outside.

    ``points`` (3, N) are inside the volume, in shape space; ``to_world`` (4, 4) is the placing
    matrix. Of several equally near boundary points the result is any.
    """
    world, inside = moved(to_world, points), contains(shape, points)
    if isinstance(shape, MeshVolume):
        corners = moved(to_world, shape.corners.reshape(-1, 3).T).T.reshape(-1, 3, 3)
        places, squared = nearest_on_triangles(corners, world)
        depths = np.sqrt(squared)
        normals = (places - world) / np.where(depths > 0.0, depths, 1.0)
    else:
        directions = _nearest_plane(shape, points, to_world)
        normals = np.linalg.inv(to_world[:3, :3]).T @ directions
        normals /= np.linalg.norm(normals, axis=0)
        depths = np.maximum(_distances(shape, points, to_world, directions), 0.0)
        places = world + normals * depths
    return places, normals, np.where(inside, depths, 0.0)


def support(shape: Shape, directions: F64) -> F64:
    """Support function (...) of a convex shape in shape space: largest ``w . x`` over points x, for
    directions w (3, ...). Meshes have none."""
    x, y, z = np.abs(directions)
    if isinstance(shape, Cuboid):
        return np.asarray(x + y + z)
    if isinstance(shape, Cylinder):
        return np.asarray(np.hypot(x, y) + z)
    assert isinstance(shape, Sphere | Capsule)
    half = shape.half_segment if isinstance(shape, Capsule) else 0.0
    return np.asarray(np.sqrt(x * x + y * y + z * z) + half * z)


def _distances(shape: Shape, points: F64, to_world: F64, directions: F64) -> F64:
    """World distances (N, ...) of points (3, N) to the supporting planes of normals (3, N, ...),
    shape space; negative beyond a plane."""
    stretched = np.tensordot(np.linalg.inv(to_world[:3, :3]).T, directions, 1)
    extra_axes = directions.ndim - points.ndim
    projections = (directions * points.reshape(*points.shape, *[1] * extra_axes)).sum(axis=0)
    distances: F64 = (support(shape, directions) - projections) / np.sqrt(
        np.square(stretched).sum(axis=0)
    )
    return distances


def _nearest_plane(shape: Shape, points: F64, to_world: F64) -> F64:
    """Normals (3, N) of the supporting planes nearest to points (3, N) in world distance H; in
    shape space, not of unit length in the world. H has kinks at flat faces, where the minimum may
    lie: along the axes of a cuboid and of caps. H is smooth elsewhere, so a search from many
    directions finds the minimum: around the side of a cylinder or capsule, and over the sphere."""
    count, candidates = points.shape[1], []
    if isinstance(shape, Cuboid | Cylinder):
        faces = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
        faces = faces if isinstance(shape, Cuboid) else faces[:, [2, 5]]
        candidates.append(np.repeat(faces[:, None], count, axis=1))
    if isinstance(shape, Cylinder | Capsule):
        angles = 2.0 * np.pi * np.arange(_STARTS) / _STARTS
        round_z = np.stack([np.cos(angles), np.sin(angles), np.zeros(_STARTS)])
        candidates.append(_searched(shape, points, to_world, round_z, is_flat=True))
    if isinstance(shape, Sphere | Capsule):
        candidates.append(_searched(shape, points, to_world, _directions(), is_flat=False))
    normals = np.concatenate(candidates, axis=2)
    best = _distances(shape, points, to_world, normals).argmin(axis=1)
    nearest_normals: F64 = normals[:, np.arange(count), best]
    return nearest_normals


def _directions() -> F64:
    """256 unit directions (3, S), evenly spread over the sphere on a spiral (Vogel, 1979)."""
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_STARTS)
    height = 1.0 - (2.0 * np.arange(_STARTS) + 1.0) / _STARTS
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height])


def _searched(shape: Shape, points: F64, to_world: F64, starts: F64, *, is_flat: bool) -> F64:
    """Four local minima (3, N, 4) of the distance, unit normals in shape space, by shrinking steps
    from the best of the starting directions (3, S). Starts are even in shape space and even in the
    world, where the shape may be a needle. ``is_flat``: only directions normal to the axis."""
    # Normals map to the world by the inverse transpose, so world directions map back by this.
    in_world = to_world[:3, :3].T @ starts
    # In the plane normal to the axis the world metric is 2 x 2: its singular vectors map directions
    # between both spaces.
    if is_flat:  # as seen along the axis
        in_world = np.linalg.svd(np.linalg.inv(to_world[:3, :3])[:2].T, full_matrices=False)
        in_world = np.linalg.inv(np.diag(in_world[1]) @ in_world[2]) @ starts[:2]
        in_world = np.concatenate([in_world, np.zeros((1, _STARTS))])
    starts = np.concatenate([starts, in_world / np.linalg.norm(in_world, axis=0)], axis=1)
    candidates = np.repeat(starts[:, None], points.shape[1], axis=1)
    # Only the best starts are refined: away from faces, which are tested separately, H is
    # smooth.
    order = np.argsort(_distances(shape, points, to_world, candidates), axis=1)[:, :_KEPT]
    best = starts[:, order]  # (3, N, K)
    step = 4.0 / np.sqrt(_STARTS)
    for _ in range(_ROUNDS):
        step *= 0.5
        for _ in range(2):
            best = _moved_to_least(shape, points, to_world, best, step, is_flat)
    return best


def _moved_to_least(
    shape: Shape, points: F64, to_world: F64, directions: F64, step: float, is_flat: bool
) -> F64:
    """Unit normals (3, N, K), shape space: of each normal and its neighbours at ``step``, the one
    whose supporting plane is nearest to the point (:func:`_distances`). Neighbours are two along
    the equator if ``is_flat``, else four."""
    axis = np.zeros_like(directions)
    axis[2] = 1.0
    if not is_flat:
        steep = np.abs(directions[2]) > 0.9
        axis[0, steep], axis[2, steep] = 1.0, 0.0
    tangent = np.cross(axis, directions, axis=0)
    tangent /= np.linalg.norm(tangent, axis=0)
    offsets = [tangent] if is_flat else [tangent, np.cross(directions, tangent, axis=0)]
    candidates = [
        directions,
        *(directions + sign * step * offset for offset in offsets for sign in (1.0, -1.0)),
    ]
    # Back to the sphere after each step in the tangent plane.
    candidates = [d / np.linalg.norm(d, axis=0) for d in candidates]
    distances = np.stack([_distances(shape, points, to_world, d) for d in candidates])
    best = distances.argmin(axis=0)
    least: F64 = np.take_along_axis(np.stack(candidates), best[None, None], 0)[0]
    return least
