# SPDX-License-Identifier: GPL-3.0-or-later
"""Separating planes: everything beyond a plane beside a volume is surely outside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..arrays import F64, Bool
from .analytic import Capsule, Cylinder, Sphere
from .shape import Shape

_ROUNDING: Final = 1e-12


def parted(shape: Shape, corners: Sequence[F64], margins: F64) -> Bool:
    """Test hulls of corners for a plane that surely separates them from a volume, with margin.

    The plane is the one through the place of the volume that is nearest to the middle of the
    corners: for hulls that are flat beside the volume's curvature hardly any is missed. Of a mesh
    the box counts.

    Parameters
    ----------
    corners : sequence of (3, N) float64
        The corners of N hulls; shape space.
    margins : (N,) float64
        How far what is meant may be outside of its hull; shape space.

    Returns
    -------
    (N,) bool
        False for what is not a number.
    """
    middle = corners[0].copy()
    for corner in corners[1:]:
        middle += corner
    middle /= len(corners)
    with np.errstate(all="ignore"):
        away = _away(shape, middle)
        nearest = np.einsum("in,in->n", away, corners[0])
        for corner in corners[1:]:
            np.minimum(nearest, np.einsum("in,in->n", away, corner), out=nearest)
        limits = _farthest(shape, away)
        limits += margins * np.sqrt(np.einsum("in,in->n", away, away))
        beyond: Bool = nearest - limits > _ROUNDING * (np.abs(nearest) + limits)
    return beyond


def _away(shape: Shape, points: F64) -> F64:
    """Vectors from the volume's nearest place to each point, (3, N), of any length; 0 inside."""
    if isinstance(shape, Sphere):
        return points
    if isinstance(shape, Capsule):
        away = points.copy()
        away[2] -= np.clip(points[2], -shape.half_segment, shape.half_segment)
        return away
    low, high = shape.bounds
    if isinstance(shape, Cylinder):
        around = np.sqrt(np.einsum("in,in->n", points[:2], points[:2]))
        away = points * np.maximum(1.0 - 1.0 / around, 0.0)
        away[2] = points[2] - np.clip(points[2], low[2], high[2])
        return away
    return points - np.clip(points, low[:, None], high[:, None])


def _farthest(shape: Shape, directions: F64) -> F64:
    """Support of the volume in directions (3, N), (N,)."""
    if isinstance(shape, Sphere):
        return np.asarray(np.sqrt(np.einsum("in,in->n", directions, directions)))
    if isinstance(shape, Capsule):
        length = np.sqrt(np.einsum("in,in->n", directions, directions))
        return np.asarray(length + shape.half_segment * np.abs(directions[2]))
    if isinstance(shape, Cylinder):
        around = np.sqrt(np.einsum("in,in->n", directions[:2], directions[:2]))
        return np.asarray(around + np.abs(directions[2]))
    low, high = shape.bounds
    most = np.maximum(directions * low[:, None], directions * high[:, None])
    return np.asarray(most.sum(axis=0))
