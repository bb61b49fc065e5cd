# SPDX-License-Identifier: GPL-3.0-or-later
"""Crossings of paths with the surface of a mesh."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..native import mesh_crossing as native
from ..ways import Ways
from .mesh_distance import TriangleTree

_GRAZE: Final = 1e-9
"""Tolerance of a crossing beyond a triangle's edge, as a share: no path slips between two."""

_SLACK: Final = 1e-12  # of the largest coordinate: boxes are that much too small
_PAIRS_AT_ONCE: Final = 1 << 18


def crossings(tree: TriangleTree, middle: F64, ways: Ways) -> tuple[F64, F64]:
    """First and last time at which points in even motion cross the surface.

    Parameters
    ----------
    middle : (3,) float64
        What the tree is about, in the points' space.
    ways : Ways
        Of N points.

    Returns
    -------
    first, last : (N,) float64
        From 0 at the start to 1 at the end; infinite, and minus infinity, where nothing is
        crossed and where a place is not finite.
    """
    if tree.compiled is not None:
        return native.crossings(tree.compiled, _slack(tree), middle, ways)
    path = ways.path() - middle[:, None]
    usable = np.flatnonzero(np.isfinite(path).all(axis=(0, 1)))
    first = np.full(path.shape[2], np.inf)
    last = -first
    for k, (start, end) in enumerate(pairwise(path)):
        enter = np.full(path.shape[2], np.inf)
        leave = -enter
        _cross(tree, _slack(tree), start, end - start, usable, enter, leave)
        first = np.minimum(first, (k + enter) / ways.steps)
        last = np.maximum(last, (k + leave) / ways.steps)
    return first, last


def comes_near(tree: TriangleTree, middle: F64, ways: Ways, reaches: F64) -> Bool | None:
    """Points that may come within ``reaches`` (N,) of the surface; None without the
    compiled part."""
    if tree.compiled is None:
        return None
    return native.comes_near(tree.compiled, _slack(tree), middle, ways, reaches)


def _slack(tree: TriangleTree) -> float:
    low, high = tree.levels[0] if tree.compiled is None else tree.compiled.extent
    return _SLACK * float(max(np.abs(low).max(), np.abs(high).max()))


def _cross(
    tree: TriangleTree, slack: float, starts: F64, way: F64, asked: I64, first: F64, last: F64
) -> None:
    """Fill in ``first`` and ``last`` for some paths, by one pass over the tree, level by level."""
    owners, nodes = asked, np.zeros(len(asked), np.int64)
    for level, (low, high) in enumerate(tree.levels):
        if level:
            owners, nodes = np.repeat(owners, 2), np.repeat(nodes, 2) * 2
            nodes[1::2] += 1
        start, step = starts.take(owners, axis=1), way.take(owners, axis=1)
        one = (low[:, nodes] - slack - start) / step
        other = (high[:, nodes] + slack - start) / step
        # A step of 0 divides to +-inf outside the slab or on both sides within; 0 / 0 is
        # a point on a face, which fmin and fmax take as within.
        enter = np.fmin(one, other).max(axis=0, initial=0.0, where=~np.isnan(one))
        leave = np.fmax(one, other).min(axis=0, initial=1.0, where=~np.isnan(other))
        met = enter <= leave + _GRAZE
        owners, nodes = owners[met], nodes[met]
        if len(owners) > _PAIRS_AT_ONCE and len(asked) > 1:
            half = len(asked) // 2
            _cross(tree, slack, starts, way, asked[:half], first, last)
            _cross(tree, slack, starts, way, asked[half:], first, last)
            return
    corners = np.ascontiguousarray(tree.corners[tree.order[nodes]].transpose(1, 2, 0))
    at, hit = _hits(starts.take(owners, axis=1), way.take(owners, axis=1), corners)
    np.minimum.at(first, owners[hit], at[hit])
    np.maximum.at(last, owners[hit], at[hit])


def _hits(starts: F64, way: F64, corners: F64) -> tuple[F64, Bool]:
    """Intersections of paths (3, n) with triangles' planes: times (n,), and a mask of real hits.

    Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
    """
    corner = corners[0]
    one, other = corners[1] - corner, corners[2] - corner
    across = np.cross(way, other, axis=0)
    volume = np.einsum("ij,ij->j", one, across)
    offset = starts - corner
    u = np.einsum("ij,ij->j", offset, across) / volume
    turned = np.cross(offset, one, axis=0)
    v = np.einsum("ij,ij->j", way, turned) / volume
    at = np.einsum("ij,ij->j", other, turned) / volume
    within = (u >= -_GRAZE) & (v >= -_GRAZE) & (u + v <= 1.0 + _GRAZE)
    return at, within & (at >= -_GRAZE) & (at <= 1.0 + _GRAZE)
