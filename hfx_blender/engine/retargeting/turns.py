# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations and affine transforms of limbs; extents and tips of their skin."""

import numpy as np

from ..arrays import F64


def apply(matrix: F64, points: F64) -> F64:
    """Points (N, 3) or (3,) transformed by a (4, 4) matrix."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def unit(vectors: F64) -> F64:
    """Vectors (..., 3) scaled to length 1; those shorter than 1e-14 are only divided by 1e-14."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-14))


def similarity(source: F64, target: F64) -> F64:
    """Least-squares similarity transform (4, 4) from source to target points, (N, 3) each (Umeyama
    1991); NaN if a target point is not finite."""
    centre, goal = source.mean(axis=0), target.mean(axis=0)
    if not np.isfinite(target).all():
        return np.full((4, 4), np.nan)
    u, spread, v = np.linalg.svd((target - goal).T @ (source - centre))
    # A rotation, never a reflection.
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = np.trace(np.diag(spread) @ sign) / np.sum((source - centre) ** 2)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u @ sign @ v)
    matrix[:3, 3] = goal - matrix[:3, :3] @ centre
    return matrix


def affine(turn: F64, linear: F64, start: F64, new_start: F64) -> tuple[F64, F64]:
    """``turn`` unchanged, and the matrix (4, 4) of ``linear`` (3, 3) with the shift that maps
    ``start`` to ``new_start``."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = new_start - linear @ start
    return turn, matrix


def axes_of(main: F64, towards: F64) -> F64:
    """Right-handed unit axes as columns (3, 3): along ``main``, the part of ``towards`` normal to
    it, and their cross product."""
    x = main / np.linalg.norm(main)
    y = towards - (towards @ x) * x
    y = y / np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def least_turn(source: F64, target: F64) -> F64:
    """Smallest rotation (3, 3) from a unit vector to another; half a turn about any normal axis if
    opposite."""
    axis = np.cross(source, target)
    sine, cosine = np.linalg.norm(axis), source @ target
    if sine < 1e-12:
        if cosine > 0.0:
            return np.eye(3)
        axis = np.cross(source, np.eye(3)[np.argmin(np.abs(source))])
        return about(axis / np.linalg.norm(axis), np.pi)
    return about(axis / sine, float(np.arctan2(sine, cosine)))


def about(axis: F64, angle: float) -> F64:
    """Rotation (3, 3) about a unit axis by an angle, radians."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def twist_about(turn: F64, axis: F64) -> float:
    """Twist angle (radians) of a rotation about a unit axis, after removal of the swing."""
    from scipy.spatial.transform import Rotation

    swing = least_turn(axis, turn @ axis)
    return float(Rotation.from_matrix(swing.T @ turn).as_rotvec() @ axis)


def extent_of(points: F64) -> tuple[F64, F64]:
    """Lowest and highest corner (3,) of the bounding box of points (N, 3)."""
    return points.min(axis=0), points.max(axis=0)


def tip_of(points: F64, start: F64) -> F64:
    """Tip (3,) of a limb: mean of the points (N, 3) at 93 % or more of the largest distance from
    ``start``."""
    far = np.linalg.norm(points - start, axis=1)
    return np.asarray(points[far >= 0.93 * far.max()].mean(axis=0))
