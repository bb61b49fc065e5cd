# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest boundary points of volumes: places and normals from inside, distances from outside."""

from typing import Final

import numpy as np

from ..arrays import F64, inverse_3x3
from .analytic import Capsule, Cuboid, Cylinder, Sphere
from .mesh import MeshVolume
from .shape import Shape

_ASIDE: Final = np.array([[0.36], [0.48], [0.8]])  # a direction along no axis
_STEP: Final = 1e-3  # share of the depth for its central difference; the error is its square


def nearest_surface(shape: Shape, points: F64, to_world: F64) -> tuple[F64, F64]:
    """Nearest boundary points of inner points, and the outward unit normals there, (3, N) each.

    Depth falls fastest towards the nearest boundary point, by 1 m/m. Where several points are
    equally near, the result is any of these points. Points (3, N) are inside, or outside within
    rounding, in shape space; results are in the world, m.
    """
    depths = shape.depth_m(points, to_world)
    linear = to_world[:3, :3]
    back = inverse_3x3(linear[None])[0]
    world = linear @ points + to_world[:3, 3:]
    normals = boundary_normals(shape, points, to_world)
    deep = np.flatnonzero(depths > 1e-9 * np.abs(linear).max())
    # On a ridge several boundary points are equally near and the slope vanishes; slightly off the
    # ridge the nearest point is unique.
    for aside in (0.0, 4.0):
        if not len(deep):
            break
        steps = _STEP * depths[deep]
        base = points[:, deep] + back @ (_ASIDE * aside * steps)
        # Depths of different kinds of shapes have no common gradient, so it is measured.
        slopes = np.zeros((3, len(deep)))
        for axis in range(3):
            shift = back[:, axis : axis + 1] * steps
            ahead, behind = (shape.depth_m(base + sign * shift, to_world) for sign in (1.0, -1.0))
            # Central differences of depth along world axes.
            slopes[axis] = (ahead - behind) / (2.0 * steps)
        length = np.sqrt(np.einsum("in,in->n", slopes, slopes))
        is_sloped = length > 1e-6
        normals[:, deep[is_sloped]] = -slopes[:, is_sloped] / length[is_sloped]
        deep = deep[length < 0.99]
    return world + normals * depths, normals


def boundary_normals(shape: Shape, points: F64, to_world: F64) -> F64:
    """Outward unit normals, world space (3, N), at boundary points (3, N) in shape space. 0 where
    none exists, as in the centre of a sphere."""
    if isinstance(shape, Cuboid):
        normals = np.where(np.abs(points) == np.abs(points).max(axis=0), np.sign(points), 0.0)
    elif isinstance(shape, Sphere):
        normals = points.copy()
    elif isinstance(shape, Cylinder):
        is_cap = np.abs(points[2]) > np.sqrt(np.square(points[:2]).sum(axis=0))
        normals = np.where(is_cap, 0.0, points)
        normals[2] = np.where(is_cap, np.sign(points[2]), 0.0)
    elif isinstance(shape, Capsule):
        normals = points.copy()
        normals[2] -= np.clip(points[2], -shape.half_segment, shape.half_segment)
    else:
        normals = _by_neighbours(shape, points)
    world = inverse_3x3(to_world[None, :3, :3])[0].T @ normals
    length = np.sqrt(np.einsum("in,in->n", world, world))
    return np.asarray(world / np.where(length > 0.0, length, 1.0))


def _by_neighbours(shape: Shape, points: F64) -> F64:
    """Outward directions (3, N), shape space, from the inner part of a small ball at each point.
    Not normalised; 64 directions sample each ball."""
    low, high = shape.bounds
    radius = 1e-5 * float((high - low).max())
    # Golden-angle spiral: 64 evenly spread directions.
    golden = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(64)
    height = 1.0 - (2.0 * np.arange(64) + 1.0) / 64.0
    around = np.sqrt(1.0 - height * height)
    directions = np.stack([around * np.cos(golden), around * np.sin(golden), height])
    probes = points[:, :, None] + radius * directions[:, None]
    inside = shape.contains(probes.reshape(3, -1)).reshape(points.shape[1], -1)
    return np.asarray(-(inside[None] * directions[:, None]).sum(axis=2))


def distances_m(shape: Shape, points: F64, to_world: F64) -> F64:
    """Distances of points to a volume, (n, V) metres; 0 inside.

    Exact for meshes, for boxes without shear and for uniformly scaled round shapes. Otherwise the
    distance to the point that is nearest before stretching, which is never too small. Points (3, n,
    V) are in shape space, V for each of n placing matrices ``to_world`` (n, 4, 4).
    """
    linear = to_world[:, :3, :3]
    flat = points.reshape(3, -1)
    if isinstance(shape, MeshVolume):
        distances = np.stack(
            [shape.surface_distance_m(points[:, k], placing) for k, placing in enumerate(linear)]
        )
        return np.where(shape.contains(flat).reshape(distances.shape), 0.0, distances)
    offsets = (flat - _nearest(shape, flat)).reshape(points.shape)
    way = np.einsum("nij,jnv->inv", linear, offsets)
    return np.asarray(np.sqrt(np.square(way).sum(axis=0)))


def _nearest(shape: Shape, points: F64) -> F64:
    """Nearest point (3, N) of an analytic shape to each point, itself inside, in shape space."""
    if isinstance(shape, Sphere):
        return _onto_ball(points)
    if isinstance(shape, Cylinder):
        return np.vstack([_onto_ball(points[:2]), np.clip(points[2:], -1.0, 1.0)])
    if isinstance(shape, Capsule):
        on_axis = np.zeros_like(points)
        on_axis[2] = np.clip(points[2], -shape.half_segment, shape.half_segment)
        return on_axis + _onto_ball(points - on_axis)
    low, high = shape.bounds
    return np.clip(points, low[:, None], high[:, None])


def _onto_ball(points: F64) -> F64:
    """Nearest point of the unit ball to each point (n, N); the point itself inside."""
    length = np.sqrt(np.einsum("in,in->n", points, points))
    return points / np.maximum(length, 1.0)
