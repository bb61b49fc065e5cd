# SPDX-License-Identifier: GPL-3.0-or-later
"""Placements between two samples.

The origin of an object moves straight, its axes turn about it by the shortest way and stretch
evenly: what keys of location, rotation and scale do between two frames. A matrix is a rotation
after a symmetric stretch (polar decomposition; Shoemake and Duff, "Matrix animation and polar
decomposition", 1992). Skin moves straight in the body's own space, which moves as an object does.
"""

from __future__ import annotations

import numpy as np

from ..arrays import F64


def between(before: F64, after: F64, share: float) -> F64:
    """Placement (4, 4) at a share of the time between two."""
    turn, stretch = _polar(before[:3, :3])
    turn_after, stretch_after = _polar(after[:3, :3])
    matrix = (1.0 - share) * before + share * after
    axis, angle = _axis_angle(turn_after @ turn.T)
    stretch = (1.0 - share) * stretch + share * stretch_after
    matrix[:3, :3] = _rotation(axis, share * angle) @ turn @ stretch
    return matrix


def turns(before: F64, after: F64) -> bool:
    """Test that a placement turns to another one by more than rounding."""
    relative = _polar(after[:3, :3])[0] @ _polar(before[:3, :3])[0].T
    return bool((before[:3, :3] != after[:3, :3]).any() and _axis_angle(relative)[1] > 1e-9)


def _polar(linear: F64) -> tuple[F64, F64]:
    """Rotation and symmetric stretch, whose product a matrix is; mirroring is in the stretch."""
    u, sizes, vt = np.linalg.svd(linear)
    sign = 1.0 if np.linalg.det(u @ vt) > 0.0 else -1.0
    return sign * u @ vt, sign * vt.T @ np.diag(sizes) @ vt


def _axis_angle(turn: F64) -> tuple[F64, float]:
    skew = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (np.trace(turn) - 1.0)
    if sine < 1e-6:  # none, or half a turn: R + 1 is then twice the axis times itself
        both = turn + np.eye(3)
        skew = both[:, np.argmax(np.einsum("ij,ij->j", both, both))]
    axis: F64 = skew / np.linalg.norm(skew)
    return axis, float(np.arctan2(sine, cosine))


def _rotation(axis: F64, angle: float) -> F64:
    """Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: F64 = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return turn
