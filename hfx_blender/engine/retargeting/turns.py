# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations and affine transforms of limbs, and the ends of a limb's skin."""

from __future__ import annotations

import numpy as np

from ..arrays import F64


def apply(matrix: F64, points: F64) -> F64:
    """Points (N, 3) or (3,) moved by a (4, 4) matrix."""
    moved: F64 = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def similarity(one: F64, other: F64) -> F64:
    """Turn, scale and shift that bring points onto others best (Umeyama 1991), (4, 4)."""
    centre, goal = one.mean(axis=0), other.mean(axis=0)
    if not np.isfinite(other).all():
        return np.full((4, 4), np.nan)
    u, spread, v = np.linalg.svd((other - goal).T @ (one - centre))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = np.trace(np.diag(spread) @ sign) / np.sum((one - centre) ** 2)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u @ sign @ v)
    matrix[:3, 3] = goal - matrix[:3, :3] @ centre
    return matrix


def affine(turn: F64, linear: F64, start: F64, new_start: F64) -> tuple[F64, F64]:
    """A turn, and the (4, 4) matrix of a linear map that takes one point to another."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = new_start - linear @ start
    return turn, matrix


def axes_of(main: F64, other: F64) -> F64:
    """Right-handed axes: along ``main``, towards ``other``, and across; as columns, (3, 3)."""
    x = main / np.linalg.norm(main)
    y = other - (other @ x) * x
    y = y / np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def least_turn(one: F64, other: F64) -> F64:
    """Smallest rotation that takes one unit vector to another, (3, 3)."""
    axis = np.cross(one, other)
    sine, cosine = np.linalg.norm(axis), one @ other
    if sine < 1e-12:
        if cosine > 0.0:
            return np.eye(3)
        axis = np.cross(one, np.eye(3)[np.argmin(np.abs(one))])
        return about(axis / np.linalg.norm(axis), np.pi)
    return about(axis / sine, float(np.arctan2(sine, cosine)))


def about(axis: F64, angle: float) -> F64:
    """The turn about a unit axis by an angle (radians), (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: F64 = (
        np.cos(angle) * np.eye(3)
        + np.sin(angle) * cross
        + (1.0 - np.cos(angle)) * np.outer(axis, axis)
    )
    return turn


def twist_about(turn: F64, axis: F64) -> float:
    """Angle of the part of a turn that goes about an axis, after its swing is taken off."""
    swing = least_turn(axis, turn @ axis)
    rest = swing.T @ turn
    sine = axis @ np.array(
        [rest[2, 1] - rest[1, 2], rest[0, 2] - rest[2, 0], rest[1, 0] - rest[0, 1]]
    )
    return float(np.arctan2(sine / 2, (np.trace(rest) - 1.0) / 2))


def extent_of(points: F64) -> tuple[F64, F64]:
    """Lower and upper corner of the box that holds some points."""
    return points.min(axis=0), points.max(axis=0)


def tip_of(points: F64, start: F64) -> F64:
    """End of a limb: the middle of the skin that is farthest from its last joint, (3,)."""
    far = np.linalg.norm(points - start, axis=1)
    tip: F64 = points[far >= 0.93 * far.max()].mean(axis=0)
    return tip
