# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact tests of points in shape space against a volume at some rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from ..volume.mesh import MeshVolume
from ..volume.parting import parted
from ..volume.shape import Falloff, FalloffKind, Shape
from ..volume.sweep import passage, passage_along
from ..ways import Ways

_NEXT: Final = np.array([1, 2, 0])
_LAST: Final = np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class Target:
    """Volume at some rows, for tests of points in its shape space."""

    shapes: tuple[Shape, ...]
    which: I64  # (n,) the shape of each row
    falloff: Falloff
    to_shape: F64  # (n, 3, 3) world to shape space, the linear part
    to_world: F64  # (n, 3, 3) the body's own space to the world, the linear part
    to_metres: F64  # (n, 3, 3) shape space to the world, the linear part
    amplitude: float  # change of weight within a unit that need not be sampled

    @cached_property
    def places(self) -> list[tuple[Shape, slice | I64]]:
        """Shapes that occur, each with its rows."""
        if len(self.shapes) == 1:
            return [(self.shapes[0], slice(None))]
        found = np.unique(self.which).tolist()
        return [(self.shapes[k], np.flatnonzero(self.which == k)) for k in found]

    @cached_property
    def is_convex(self) -> bool:
        return all(shape.is_convex for shape in self.shapes)

    def slopes_of(self, rows: I64) -> F64:
        """Largest change of weight for a distance of 1 in shape space, at some rows (k,)."""
        slopes = np.zeros(len(rows))
        which = self.which[rows]
        for k in np.unique(which).tolist():  # a mesh needs a search: only for shapes that occur
            slopes[which == k] = steepest(self.falloff) * self.shapes[k].steepest_rise
        return slopes

    @cached_property
    def stretches(self) -> F64:
        """Upper bound of the stretch from the world into shape space, (n,)."""
        gram = self.to_shape @ self.to_shape.transpose(0, 2, 1)
        stretches: F64 = np.sqrt(np.abs(gram).sum(axis=2).max(axis=1))
        return stretches

    def weights(self, points: F64, rows: I64) -> F64:
        """Contact weight of points (3, N), each at one of the rows (N,); 0 outside.

        Rows do not matter, and may be missing, where there is one shape.
        """
        if len(self.shapes) == 1:
            return _weights(self.shapes[0], points, self.falloff)
        weights = np.zeros(points.shape[1])
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            weights[mine] = _weights(self.shapes[k], points[:, mine], self.falloff)
        return weights

    def clearances(self, points: F64, rows: I64) -> F64:
        """See :meth:`Shape.clearance`, (N,)."""
        if len(self.shapes) == 1:
            return self._clearance(self.shapes[0], points)
        found = np.zeros(points.shape[1])
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            found[mine] = self._clearance(self.shapes[k], points[:, mine])
        return found

    def _clearance(self, shape: Shape, points: F64) -> F64:
        clear = shape.clearance(points)
        if isinstance(shape, MeshVolume) and not self.falloff.is_flat:
            # The slope of the strength depends on the mesh: inside samples are needed.
            np.maximum(clear, 0.0, out=clear)
        return clear

    def passages(self, ways: Ways, rows: I64) -> tuple[F64, F64]:
        """See :func:`passage_along`, (N,) each."""
        if len(self.shapes) == 1:
            return passage_along(self.shapes[0], ways)
        first = np.full(len(rows), np.inf)
        last = -first
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            first[mine], last[mine] = passage_along(self.shapes[k], ways.taken(mine))
        return first, last

    def comes_near(self, ways: Ways, reaches: F64, rows: I64) -> Bool:
        """Balls of radii ``reaches`` (N,) that may meet the volume on their paths, or be in it.

        Every convex shape here holds the unit ball, so that within a factor 1 + r of it is all
        that is nearer than r.
        """
        meets = np.zeros(len(rows), np.bool_)
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            shape, some, reach = self.shapes[k], ways.taken(mine), reaches[mine]
            if isinstance(shape, MeshVolume):
                meets[mine] = shape.comes_near(some, reach) | shape.contains(some.before)
            else:
                meets[mine] = _meets_ball(shape, some, reach)
        return meets

    def outwards(self, along: F64, across: F64, rows: I64) -> F64:
        """Normals of triangles with these two edges (3, N), each at one of the rows (N,).

        They are as long in the world as the square root of twice the triangle's area; both
        edges and they are in shape space.
        """
        cross = along.take(_NEXT, axis=0) * across.take(_LAST, axis=0)
        cross -= along.take(_LAST, axis=0) * across.take(_NEXT, axis=0)
        to_world, forth = (turn.take(rows, axis=2) for turn in self._turns)
        with np.errstate(all="ignore"):
            world = np.einsum("ijn,jn->in", to_world, cross)
            size = np.sqrt(np.sqrt(np.einsum("in,in->n", world, world)))
            outwards: F64 = np.einsum("ijn,jn->in", forth, cross) / size
        outwards[:, ~np.isfinite(outwards).all(axis=0)] = 0.0
        return outwards

    def parted(self, corners: Sequence[F64], rows: I64, margins: F64) -> Bool:
        """See :func:`parted`; each hull is at one of the rows (N,)."""
        if len(self.shapes) == 1:
            return parted(self.shapes[0], corners, margins)
        found = np.zeros(len(margins), np.bool_)
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            hulls = [corner[:, mine] for corner in corners]
            found[mine] = parted(self.shapes[k], hulls, margins[mine])
        return found

    @cached_property
    def _turns(self) -> tuple[F64, F64]:
        """Linear maps of cross products between shape space and the world, forth and back."""
        matrices = self.to_shape
        with np.errstate(all="ignore"):
            # A matrix A turns cross products by det(A) times its inverse transposed.
            handedness = np.sign(np.linalg.det(self.to_world))  # -1 where it is mirrored
            sign = (handedness / np.linalg.det(matrices))[:, None, None]
            to_world = matrices.transpose(0, 2, 1) * sign
            forth = matrices @ to_world
        return (
            np.ascontiguousarray(to_world.transpose(1, 2, 0)),
            np.ascontiguousarray(forth.transpose(1, 2, 0)),
        )


def _meets_ball(shape: Shape, ways: Ways, reaches: F64) -> Bool:
    """Test balls against a convex shape."""
    meets = np.zeros(len(reaches), np.bool_)
    for start, end in pairwise(ways.path() / (1.0 + reaches)):
        meets |= np.isfinite(passage(shape, start, end)[0])
    return meets


def _weights(shape: Shape, points: F64, falloff: Falloff) -> F64:
    if not falloff.is_flat and not isinstance(shape, MeshVolume):
        return falloff.weight(shape.rise(points))  # 0 outside by itself, and for NaN
    inside = shape.contains(points)
    if falloff.is_flat:
        return inside.astype(np.float64)
    values = np.zeros(points.shape[1])
    values[inside] = falloff.weight(shape.rise(points[:, inside]))
    return values


def steepest(falloff: Falloff) -> float:
    """Largest change of weight for a change of rise."""
    if falloff.is_flat:
        return 0.0
    return (1.5 if falloff.kind is FalloffKind.SMOOTH else 1.0) / falloff.share
