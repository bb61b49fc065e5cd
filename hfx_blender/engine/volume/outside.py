# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances from outside points to a volume."""

from __future__ import annotations

import numpy as np

from ..arrays import F64
from .analytic import Capsule, Cylinder, Sphere
from .mesh import MeshVolume
from .shape import Shape


def distances_m(shape: Shape, points: F64, to_world: F64) -> F64:
    """Distances to a volume of points outside it, (n, V) metres; 0 inside.

    Exact for meshes, boxes without shear, and round shapes that are scaled alike along all axes;
    else the distance to the place that is nearest before stretching, so never too small.

    Parameters
    ----------
    points : (3, n, V) float64
        Shape space.
    to_world : (n, 4, 4) float64
        Placing matrices.
    """
    linear = to_world[:, :3, :3]
    flat = points.reshape(3, -1)
    if isinstance(shape, MeshVolume):
        distances = np.stack(
            [shape.surface_distance_m(points[:, k], each) for k, each in enumerate(linear)]
        )
        return np.where(shape.contains(flat).reshape(distances.shape), 0.0, distances)
    offsets = (flat - _nearest(shape, flat)).reshape(points.shape)
    way = np.einsum("nij,jnv->inv", linear, offsets)
    return np.asarray(np.sqrt(np.square(way).sum(axis=0)))


def _nearest(shape: Shape, points: F64) -> F64:
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
    length = np.sqrt(np.einsum("in,in->n", points, points))
    return points / np.maximum(length, 1.0)
