# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances to triangles in the planes of the triangles, exact to rounding also for slivers."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.arrays import F64, Bool


def exact_distances(corners: F64, points: F64) -> F64:
    """Distances (N,) of points (3, N) to the nearest of triangles (F, 3, 3), all pairs compared."""
    frames, count = plane_frames(corners), len(corners)
    pairs = [
        to_triangles(np.repeat(point[:, None], count, axis=1), frames).min() for point in points.T
    ]
    return np.sqrt(np.array(pairs))


def plane_frames(corners: F64) -> F64:
    """Orthonormal frame of each triangle in its own plane, (15, F). The x axis runs along the
    longest edge and y towards the apex. Rows: origin (3), axes x, y and z (9), length of the
    longest edge, apex x, apex y. Frames are exact to rounding also for slivers."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.argmax(np.sum(edges**2, axis=2), axis=1)
    rows = np.arange(len(corners))
    origin, base = corners[rows, longest], edges[rows, longest]
    apex = corners[rows, (longest + 2) % 3] - origin
    length = np.sqrt(np.sum(base**2, axis=1))
    axis_x = base / np.where(length > 0.0, length, 1.0)[:, None]
    axis_y = apex
    # For a sliver the first difference is mostly rounding, which the second pass removes.
    for _ in range(2):
        axis_y = axis_y - np.sum(axis_y * axis_x, axis=1)[:, None] * axis_x
    width = np.sqrt(np.sum(axis_y**2, axis=1))
    # A triangle without width has no y axis of its own: any unit vector across x stands for it.
    across = np.cross(axis_x, np.eye(3)[np.argmin(np.abs(axis_x), axis=1)])
    across /= np.maximum(np.sqrt(np.sum(across**2, axis=1)), 1e-300)[:, None]
    thin = width <= 1e-15 * length
    axis_y = np.where(thin[:, None], across, axis_y / np.where(thin, 1.0, width)[:, None])
    apex_xy = [np.sum(apex * axis, axis=1)[:, None] for axis in (axis_x, axis_y)]
    parts = [origin, axis_x, axis_y, np.cross(axis_x, axis_y), length[:, None], *apex_xy]
    return np.ascontiguousarray(np.concatenate(parts, axis=1).T)


def to_triangles(points: F64, frames: F64) -> F64:
    """Squared distances (n,) of points (3, n) to triangles with frames (15, n), pair by pair."""
    offset = points - frames[:3]
    x, y, z = (np.einsum("ij,ij->j", offset, frames[k : k + 3]) for k in (3, 6, 9))
    length, apex_x, apex_y = frames[12:]

    # The angles at both ends of the longest edge are acute, so below it this edge is the nearest.
    overhang = x - np.clip(x, 0.0, length)
    to_base = overhang * overhang + y * y
    left, left_of = _to_side(x, y, apex_x, apex_y)
    right, right_of = _to_side(length - x, y, length - apex_x, apex_y)
    to_sides = np.where(left_of | right_of, np.minimum(left, right), 0.0)
    in_plane = np.where(y > 0.0, to_sides, to_base)
    squared: F64 = in_plane + z * z
    return squared


def _to_side(x: F64, y: F64, end_x: F64, end_y: F64) -> tuple[F64, Bool]:
    """Squared distance (n,) to the segment from 0 to (end_x, end_y > 0); True to its left."""
    square = end_x * end_x + end_y * end_y
    share = (x * end_x + y * end_y) / np.where(square > 0.0, square, 1.0)
    share = np.clip(share, 0.0, 1.0)
    return (x - share * end_x) ** 2 + (y - share * end_y) ** 2, x * end_y < y * end_x
