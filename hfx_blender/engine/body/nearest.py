# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on triangles."""

from __future__ import annotations

import numpy as np

from ..arrays import F64


def barycentric(points: F64, corners: F64) -> F64:
    """Weights of the corners at the place of a triangle that is nearest to a point.

    Parameters
    ----------
    points : (N, 3) float64
    corners : (N, 3, 3) float64
        One triangle for each point.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    inside = _plane_weights(points, a, b, c)
    # A triangle without area has no inside: only its edges count.
    is_flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0.0
    best = np.where((inside >= 0.0).all(axis=1) & ~is_flat, 0.0, np.inf)
    weights = inside.copy()
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, end] - corners[:, start]
        along = np.einsum("ij,ij->i", points - corners[:, start], edge)
        share = np.clip(along / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0.0, 1.0)
        place = corners[:, start] + share[:, None] * edge
        distance = np.linalg.norm(points - place, axis=1)
        nearer = distance < best
        best[nearer] = distance[nearer]
        weights[nearer] = 0.0
        weights[nearer, start] = 1.0 - share[nearer]
        weights[nearer, end] = share[nearer]
    return weights


def _plane_weights(points: F64, a: F64, b: F64, c: F64) -> F64:
    one, other, offset = b - a, c - a, points - a
    d00, d01, d11 = (
        np.einsum("ij,ij->i", x, y) for x, y in ((one, one), (one, other), (other, other))
    )
    d20, d21 = (np.einsum("ij,ij->i", offset, x) for x in (one, other))
    scale = np.maximum(d00 * d11 - d01 * d01, 1e-40)
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    return np.column_stack((1.0 - v - w, v, w))
