# SPDX-License-Identifier: GPL-3.0-or-later
"""Narrow phase: how much of each cell of skin is inside a volume.

Only units of skin that the boundary may cut are sampled: one whose vertex is farther from the
boundary than its skin reaches is wholly on one side.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from .coverage import SkinPatch
from .volume.analytic import Cuboid
from .volume.shape import Falloff, FalloffKind, Shape
from .volume.sweep import clearance, passage

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

WHOLE: Final = 1.0 - 1e-9
"""A sum of shares that is rounding away from 1."""

_AT_ONCE: Final = 1 << 18
"""Samples whose places are held at one time."""


@dataclass(frozen=True, eq=False)
class Target:
    """A volume at some rows, as points of its shape space are tested against it."""

    shapes: tuple[Shape, ...]
    which: I64  # (n,) the shape of each row
    falloff: Falloff
    to_shape: F64  # (n, 3, 3) world to shape space, the linear part
    handedness: F64  # (n,) -1 where the body's own space is mirrored in the world
    amplitude: float  # change of weight within a unit that need not be sampled

    @cached_property
    def is_convex(self) -> bool:
        return all(shape.is_convex for shape in self.shapes)

    @cached_property
    def stretches(self) -> F64:
        """No less than what the world is stretched by into shape space, (n,)."""
        gram = self.to_shape @ self.to_shape.transpose(0, 2, 1)
        stretches: F64 = np.sqrt(np.abs(gram).sum(axis=2).max(axis=1))
        return stretches

    def at(self, rows: I64) -> Target:
        """The same at some of its rows."""
        return Target(
            self.shapes,
            self.which[rows],
            self.falloff,
            self.to_shape[rows],
            self.handedness[rows],
            self.amplitude,
        )

    def weights(self, points: F64, rows: I64) -> F64:
        """Contact weight of points (3, N), each at one of the rows (N,); 0 outside."""
        if len(self.shapes) == 1:
            return _weights(self.shapes[0], points, self.falloff)
        weights = np.zeros(points.shape[1])
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            weights[mine] = _weights(self.shapes[k], points[:, mine], self.falloff)
        return weights

    def weights_of(self, points: F64) -> F64:
        """The same for points (3, n, V) of all its rows, (n, V)."""
        rows = np.repeat(np.arange(points.shape[1]), points.shape[2])
        return self.weights(points.reshape(3, -1), rows).reshape(points.shape[1:])

    def clearances(self, points: F64, rows: I64) -> F64:
        """See :func:`clearance`, (N,)."""
        if len(self.shapes) == 1:
            return clearance(self.shapes[0], points)
        found = np.zeros(points.shape[1])
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            found[mine] = clearance(self.shapes[k], points[:, mine])
        return found

    def passages(self, starts: F64, ends: F64, rows: I64) -> tuple[F64, F64]:
        """See :func:`passage`, (N,) each."""
        if len(self.shapes) == 1:
            return passage(self.shapes[0], starts, ends)
        first = np.full(starts.shape[1], np.inf)
        last = -first
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            first[mine], last[mine] = passage(self.shapes[k], starts[:, mine], ends[:, mine])
        return first, last

    def passages_of_hull(self, starts: F64, ends: F64, size: F64, rows: I64) -> tuple[F64, F64]:
        """As :meth:`passages`, of convex hulls that are larger by factors ``size`` (N,)."""
        first = np.full(starts.shape[1], np.inf)
        last = -first
        which = self.which[rows]
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            shape = self.shapes[k]
            one, other = starts[:, mine], ends[:, mine]
            if not shape.is_convex:
                low, high = shape.bounds
                middle, half = 0.5 * (low + high)[:, None], 0.5 * (high - low)
                shape, half = Cuboid(), half[:, None] + (size[mine] - 1.0)
                one, other = (one - middle) / half, (other - middle) / half
            else:
                one, other = one / size[mine], other / size[mine]
            first[mine], last[mine] = passage(shape, one, other)
        return first, last

    def outwards(self, along: F64, across: F64, rows: I64) -> F64:
        """Normals of triangles with these two edges (3, N), each at one of the rows (N,).

        They are as long in the world as the square root of twice the triangle's area; both
        edges and they are in shape space.
        """
        cross = np.stack(
            [
                along[1] * across[2] - along[2] * across[1],
                along[2] * across[0] - along[0] * across[2],
                along[0] * across[1] - along[1] * across[0],
            ]
        )
        to_world, forth = self._turns
        with np.errstate(all="ignore"):
            world = np.einsum("ijn,jn->in", to_world[:, :, rows], cross)
            size = np.sqrt(np.sqrt(np.einsum("in,in->n", world, world)))
            outwards: F64 = np.einsum("ijn,jn->in", forth[:, :, rows], cross) / size
        outwards[:, ~np.isfinite(outwards).all(axis=0)] = 0.0
        return outwards

    @cached_property
    def _turns(self) -> tuple[F64, F64]:
        """Of cross products in shape space: to their vectors in the world, and these back."""
        matrices = self.to_shape
        with np.errstate(all="ignore"):
            # A matrix A turns cross products by det(A) times its inverse transposed.
            sign = (self.handedness / np.linalg.det(matrices))[:, None, None]
            to_world = matrices.transpose(0, 2, 1) * sign
            forth = matrices @ to_world
        return (
            np.ascontiguousarray(to_world.transpose(1, 2, 0)),
            np.ascontiguousarray(forth.transpose(1, 2, 0)),
        )


def _weights(shape: Shape, points: F64, falloff: Falloff) -> F64:
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


@dataclass(frozen=True, eq=False)
class Details:
    """More about each contact, in shape space.

    The *place* of a contact is the vertex where that is inside, else the deepest sample of its
    skin; of a contact that is over when the sample is taken, the deepest halfway through.
    """

    places: F64  # (3, total)
    since: F64  # (total,) when it began, a share of the time since the sample before; else NaN
    entries: F64  # (3, total) where skin entered first
    ways: F64  # (3, total) how it moved then, for a whole time between samples

    @classmethod
    def none_yet(cls, *shape: int) -> Details:
        return cls(
            np.zeros((3, *shape)),
            np.full(shape, np.nan),
            np.zeros((3, *shape)),
            np.zeros((3, *shape)),
        )


@dataclass(frozen=True, eq=False)
class Inside:
    """Samples of skin that are inside, for what is asked for on demand."""

    rows: I64  # (N,)
    cells: I64  # (N,) places in the patch's cells
    points: F64  # (3, N) shape space

    def of_row(self, row: int) -> tuple[I64, F64]:
        """Cells and points of one row."""
        mine = np.flatnonzero(self.rows == row)
        return self.cells[mine], self.points[:, mine]


def cells_covered(
    patch: SkinPatch,
    points: F64,
    gaps: F64,
    target: Target,
    inside: list[Inside] | None = None,
) -> F64:
    """Contact weights of a patch's cells, (n, C): the share of each that is inside.

    Parameters
    ----------
    points : (3, n, V) float64
        The patch's vertices, shape space.
    gaps : (n, units) float64
        How far a vertex's neighbours can be from it, shape space.
    target : Target
        Its ``n`` rows.
    inside : list of Inside, optional
        Takes the samples that are inside.
    """
    _, count, total = points.shape
    units = patch.units
    flat, flat_rows = points.reshape(3, -1), np.repeat(np.arange(count), total)
    clear = target.clearances(flat, flat_rows).reshape(count, -1)
    middle = np.ascontiguousarray(points[:, :, :units]).reshape(3, -1)
    at_vertex = target.weights(middle, np.repeat(np.arange(count), units)).reshape(count, -1)
    reach = gaps * patch.reaches
    near = (np.abs(clear[:, :units]) <= reach) & (patch.steps > 0)
    if not target.falloff.is_flat:
        varies = (patch.steps > 0) & (steepest(target.falloff) * reach > target.amplitude)
        near |= varies & (at_vertex > 0.0) & (-clear[:, :units] < target.falloff.share + reach)
    shares = at_vertex * patch.unit_shares
    row, unit = np.nonzero(near)
    if len(row):
        shares[row, unit] = at_vertex[row, unit] * patch.vertex_shares[unit]
        flat_shares = shares.ravel()
        row, quad = patch.quads_of(row, unit)
        is_in, is_cut = _sides(patch, points, clear, row, quad, target)
        whole = np.flatnonzero(is_in)
        np.add.at(
            flat_shares, row[whole] * units + patch.unit_of[quad[whole]], patch.wholes[quad[whole]]
        )
        cut = np.flatnonzero(is_cut)
        for samples in sampled(patch, points, row[cut], quad[cut], target):
            weights = target.weights(samples.points, samples.rows)
            flat_shares += np.bincount(
                samples.rows * units + samples.units,
                weights * samples.shares,
                minlength=len(flat_shares),
            )
            if inside is not None:
                kept = np.flatnonzero(weights > 0.0)
                cell = patch.cells_of(samples.units[kept])
                inside.append(Inside(samples.rows[kept], cell, samples.points[:, kept]))
    if inside is not None:
        row, unit = np.nonzero(at_vertex > 0.0)
        cell = patch.cells_of(unit)
        inside.append(Inside(row, cell, points[:, row, unit]))
    if len(patch.cells) < patch.units:
        shares = np.add.reduceat(shares, patch.cell_starts, axis=1)
    shares[shares > WHOLE] = 1.0
    return shares


def beyond(points: F64, target: Target, margins: F64) -> npt.NDArray[np.uint8]:
    """For each point one bit for every face of the volume's box that it is beyond, (n V,).

    Points are (3, n, V), ``margins`` (n,) what bulges may stand out by, shape space.
    """
    faces = np.zeros(points.shape[1:], np.uint8)
    for k in np.unique(target.which) if len(target.shapes) > 1 else (0,):
        mine = slice(None) if len(target.shapes) == 1 else target.which == k
        low, high = target.shapes[k].bounds
        margin = margins[mine, None]
        for axis in range(3):
            place = points[axis, mine]
            faces[mine] |= (place < low[axis] - margin).view(np.uint8) << np.uint8(2 * axis)
            faces[mine] |= (place > high[axis] + margin).view(np.uint8) << np.uint8(2 * axis + 1)
    return faces.ravel()


def _sides(
    patch: SkinPatch, points: F64, clear: F64, row: I64, quad: I64, target: Target
) -> tuple[Bool, Bool]:
    """Which quads, each at a row, are wholly inside, and which may be cut by the boundary."""
    corners = patch.corners(row, quad)
    faces = beyond(points, target, patch.bulge_m * target.stretches)
    is_cut = (faces[corners[0]] & faces[corners[1]] & faces[corners[2]]) == 0
    if not (target.is_convex and target.falloff.is_flat):
        return np.zeros(len(row), np.bool_), is_cut
    deepest = clear.ravel()
    is_in = np.maximum(np.maximum(deepest[corners[0]], deepest[corners[1]]), deepest[corners[2]])
    wholly = is_in <= -patch.heights_m[quad] * target.stretches[row]
    return wholly, is_cut & ~wholly


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of some quads, each at a row."""

    rows: I64  # (N,)
    units: I64  # (N,)
    points: F64  # (3, N) shape space
    shares: F64  # (N,) of the cell's area


def sampled(
    patch: SkinPatch, points: F64, row: I64, quad: I64, target: Target
) -> Iterator[Samples]:
    """Where the skin of quads is at rows, (P,) each."""
    flat = points.reshape(3, -1)
    steps_of = patch.steps[patch.unit_of[quad]]
    for steps in np.unique(steps_of).tolist():
        at_once = max(1, _AT_ONCE // steps**2)
        mine = np.flatnonzero(steps_of == steps)
        # Places of the samples in each quad, (steps^2, 1).
        ticks = (np.arange(steps) + 0.5) / steps
        s, t = (each.reshape(-1, 1) for each in np.meshgrid(ticks, ticks, indexing="ij"))
        for begin in range(0, len(mine), at_once):
            part = mine[begin : begin + at_once]
            rows, quads = row[part], quad[part]
            units = patch.unit_of[quads]
            first = rows * points.shape[2]
            start = flat.take(first + units, axis=1)
            along = flat.take(first + patch.around[quads, 0], axis=1) - start
            across = flat.take(first + patch.around[quads, 1], axis=1) - start
            edge, other, inner, inner_2 = patch.places.take(quads, axis=1)
            one = s * (1.0 - t) * edge + s * t * inner
            two = (1.0 - s) * t * other + s * t * inner_2
            placed = start[:, None] + along[:, None] * one + across[:, None] * two
            curved = np.flatnonzero(patch.heights_m[quads])
            if len(curved):
                one, two = one[:, curved], two[:, curved]
                to_one, to_two, between = patch.bulges.take(quads[curved], axis=1)
                height = (1.0 - one - two) * (one * to_one + two * to_two) + one * two * between
                outwards = target.outwards(along[:, curved], across[:, curved], rows[curved])
                placed[:, :, curved] += outwards[:, None] * height
            area, by_s, by_t = patch.areas.take(quads, axis=1)
            yield Samples(
                np.tile(rows, steps * steps),
                np.tile(units, steps * steps),
                placed.reshape(3, -1),
                (area + s * by_s + t * by_t).ravel(),
            )
