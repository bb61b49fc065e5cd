# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact inside test for closed triangle meshes: voxels, and columns for undecided voxels.

A ray leads from the point along the column axis; the signs of its crossings add up to the winding
number. The usual failures of rays (hits of edges and vertices, triangles along the ray) do not
occur:

* Whether a triangle spans the ray is decided edge by edge, in the plane across the ray, by the
  half-open rule of polygon filling. Triangles that share an edge compute the same number, so
  that crossings of a closed mesh cancel under any rounding.
* The height of a crossing is interpolated between the two edges that span the point, and so stays
  between them also for slivers and for triangles along the ray.

The result is therefore exact for a point within rounding of the given one.
"""

from typing import Any, Final

import numpy as np

from ..arrays import F64, I32, I64, Bool, ramp
from ..native.library import library, loaded, structure

CELLS: Final = 2**18  # more cells miss the cache, fewer leave more points to columns
CELLS_PER_AXIS: Final = (4, 256)
_SNAP: Final = 2.0**40  # grid steps in a cell; slopes between vertices on the grid are finite
PAIRS_AT_ONCE: Final = 2**19

MARGIN: Final = 1e-6
"""Margin of triangle bounds in cells, far above rounding, so that no cell misses a triangle."""

_STEEP: Final = 1e-6  # least cosine at which a triangle's plane bounds its heights

_OUTSIDE: Final = -1
_INSIDE: Final = -2


def _spans(corners: F64) -> F64:
    """Triangles (F, 3, 3) prepared for crossing tests, (16, F), as ``hfx_grid`` has them.

    Corners are sorted by y. Rows: y of the low, middle and high corner; x of the low and the middle
    corner, slopes in x per y of the edges low-high, low-middle and middle-high; the same in z;
    orientation of the sorted corners, +1 or -1; two zeros.
    """
    order = np.argsort(corners[:, :, 1], axis=1, kind="stable")
    even = (order[:, 1] - order[:, 0]) % 3 == 1
    low, middle, high = np.moveaxis(np.take_along_axis(corners, order[:, :, None], 1), 1, 0)
    starts, ends = np.stack([low, low, middle]), np.stack([high, middle, high])
    climb = ends[..., 1] - starts[..., 1]
    slopes = (ends - starts) / np.where(climb > 0.0, climb, np.inf)[..., None]
    along_x, along_z = ((low[:, k], middle[:, k], *slopes[..., k]) for k in (0, 2))
    signs, zeros = np.where(even, 1.0, -1.0), np.zeros(len(corners))
    heights = low[:, 1], middle[:, 1], high[:, 1]
    return np.stack([*heights, *along_x, *along_z, signs, zeros, zeros])


def _cross(spans: F64, triangles: I64, points: F64) -> tuple[I64, F64, F64]:
    """Intersect vertical lines (along z) through points (3, n) with triangles (n,), pair by pair.
    ``spans``: all triangles as of :func:`_spans`.
    Returns the ascending indices (m,) of the pairs that cross, the z (m,) of each crossing, and the
    change (m,) of the winding number, +1 or -1."""
    y_low, y_middle, y_high = spans[:3]
    y = points[1]
    pairs = np.flatnonzero((y_low[triangles] <= y) & (y < y_high[triangles]))
    triangles, x, y = triangles[pairs], points[0, pairs], y[pairs]
    # The long edge spans every y of the triangle, and so does a short edge above or below the
    # middle.
    upper = y >= y_middle[triangles]
    rises = y - y_low[triangles]
    rises = np.stack([rises, np.where(upper, y - y_middle[triangles], rises)])
    long_x, short_x = _on_edges(spans[3:8], triangles, upper, rises)
    left = x < short_x
    # The point is between the edges if it is left of exactly one. Both comparisons use the
    # same rounded edge positions as the neighbours across these edges.
    hit = np.flatnonzero(left != (x < long_x))
    triangles = triangles[hit]
    long_z, short_z = _on_edges(spans[8:13], triangles, upper[hit], rises[:, hit])
    share = (x[hit] - long_x[hit]) / (short_x[hit] - long_x[hit])
    signs = np.where(left[hit], spans[13, triangles], -spans[13, triangles])
    return pairs[hit], long_z + share * (short_z - long_z), signs


def _on_edges(rows: F64, triangles: I64, upper: Bool, rises: F64) -> tuple[F64, F64]:
    """x, or z, of the long edge and a short edge of triangles at given heights y, (n,) each.

    ``triangles`` (n,) index the columns of ``rows`` (5, F): x or z of the low and middle corner,
    slopes per y of the long, the lower and the upper edge. ``upper`` (n,) selects the upper short
    edge; ``rises`` (2, n) are heights above the lower ends of the long and the short edge.
    """
    low, middle, slope_long, slope_lower, slope_upper = (row[triangles] for row in rows)
    on_long = low + rises[0] * slope_long
    on_short = np.where(upper, middle, low) + rises[1] * np.where(upper, slope_upper, slope_lower)
    return on_long, on_short


class InsideGrid:
    """Voxel grid for inside tests by winding number.

    Each voxel is inside, outside or mixed. Consecutive mixed voxels of a column form a *run*, with
    a list of its triangles and the winding number above its upper end. ``vertices`` (V, 3) have
    some extent along each axis; ``triangles`` (F, 3) are closed: each edge is used equally often in
    both directions. ``compiled`` is ``hfx_grid`` of the compiled test, or None without the library.
    """

    def __init__(self, vertices: F64, triangles: I32) -> None:
        low, extent = vertices.min(axis=0), np.ptp(vertices, axis=0)
        # Columns along the shortest axis have the fewest voxels and triangles.
        shortest = int(np.argmin(extent))
        self._axes = [(shortest + 1) % 3, (shortest + 2) % 3, shortest]
        self._low, self._high = low, vertices.max(axis=0)
        share = extent / extent.max()
        edge = np.cbrt(np.prod(share) / CELLS)
        self._counts = np.clip(np.rint(share / edge), *CELLS_PER_AXIS).astype(np.int64)
        self._counts = self._counts[self._axes]
        self._scale = (self._counts / extent[self._axes])[:, None]

        placed = np.rint(self._to_cells(vertices.T) * _SNAP) / _SNAP
        corners = placed.T[triangles]
        self._spans = _spans(corners)
        self._fill(*covered_columns(corners, self._counts))
        self.compiled: Any = None
        if library() is not None:
            columns = np.repeat(self._columns, np.diff(self.run_offsets))
            bounds = bounds_in_columns(corners, self._listed, columns, self._counts, MARGIN)
            self.compiled = structure("hfx_grid")(
                *(np.stack([self._low, self._high]), np.array(self._axes), self._scale[:, 0]),
                *(self._counts, self.voxels.astype(np.int64), self.run_offsets, self._beyond),
                *(self._listed, bounds, self._spans.T),
            )

    def _to_cells(self, points: F64) -> F64:
        """Points (3, N) in cells of the grid, axes reordered with the column axis last."""
        return np.asarray((points - self._low[:, None])[self._axes] * self._scale)

    def _fill(self, triangles: I64, columns: I64, first: I64, last: I64) -> None:
        """Classify the voxels, and list the triangles of each run. ``triangles`` touch the voxels
        ``first`` to ``last`` of ``columns``, (n,) each."""
        shape = (int(self._counts[0] * self._counts[1]), int(self._counts[2]))
        size = shape[0] * (shape[1] + 1)  # one more on top, for sums that end there
        # Coverage by +1 at the start and -1 after the end of each interval, then a running sum.
        starts, ends = columns * (shape[1] + 1) + first, columns * (shape[1] + 1) + last + 1
        cover = np.bincount(starts, minlength=size) - np.bincount(ends, minlength=size)
        mixed = np.cumsum(cover).reshape(shape[0], -1) > 0

        # Runs are numbered by their lowest voxels, column after column.
        begins = mixed.copy()
        begins[:, 1:] &= ~mixed[:, :-1]
        runs = np.cumsum(begins).reshape(begins.shape) - 1
        run_of_pair = runs.ravel()[starts]
        order = np.argsort(run_of_pair, kind="stable")
        self._listed = triangles[order]
        sizes = np.bincount(run_of_pair)
        self.run_offsets = np.concatenate([[0], np.cumsum(sizes)])

        # The winding number of a voxel is that of the crossings above it in its column, as seen on
        # the line through the column's centre.
        middle = np.stack([columns // self._counts[1], columns % self._counts[1], first]) + 0.5
        pairs, heights, signs = _cross(self._spans, triangles, middle)
        level = np.clip(heights.astype(np.int64), first[pairs], last[pairs])
        cells = columns[pairs] * (shape[1] + 1) + level
        crossings = np.bincount(cells, signs, minlength=size).reshape(shape[0], -1)
        winding = np.cumsum(crossings[:, ::-1], axis=1)[:, ::-1]
        tops = np.flatnonzero((mixed[:, :-1] & ~mixed[:, 1:]).ravel())
        self._beyond = winding[:, 1:].ravel()[tops].astype(np.int64)
        self._columns = tops // shape[1]

        codes = np.where(mixed, runs, np.where(winding == 0, _OUTSIDE, _INSIDE))
        self.voxels = np.ascontiguousarray(codes[:, :-1], np.int32).ravel()

    def contains(self, points: F64) -> Bool:
        """Test points (3, N), in the mesh's space, for being inside, (N,) bool; NaN is outside."""
        if self.compiled is not None:
            inside = np.empty(points.shape[1], np.bool_)
            loaded().hfx_mesh_inside(self.compiled, points, points.shape[1], inside)
            return inside
        inside = np.zeros(points.shape[1], np.bool_)
        near = (points >= self._low[:, None]) & (points <= self._high[:, None])
        candidates = np.flatnonzero(near[0] & near[1] & near[2])
        placed = self._to_cells(points.take(candidates, axis=1))
        # Points on the upper bounds belong to the last cells.
        cells = np.minimum(placed.astype(np.int64), self._counts[:, None] - 1)
        codes = self.voxels[(cells[0] * self._counts[1] + cells[1]) * self._counts[2] + cells[2]]
        mixed = np.flatnonzero(codes >= 0)
        decided = codes == _INSIDE
        decided[mixed] = self._in_columns(placed.take(mixed, axis=1), codes[mixed])
        inside[candidates] = decided
        return inside

    def _in_columns(self, placed: F64, runs: I32) -> Bool:
        """Inside test (n,) of points (3, n), in cells, in mixed voxels of ``runs`` (n,)."""
        starts = self.run_offsets[runs]
        counts = self.run_offsets[runs + 1] - starts
        # Winding number above the run; triangles of the run above the point add theirs.
        winding = self._beyond[runs]
        # Bounds the memory, however many triangles meet in one column.
        parts = np.cumsum(counts) // PAIRS_AT_ONCE
        for part in np.unique(parts):
            chosen = np.flatnonzero(parts == part)
            steps, owners = ramp(counts[chosen])
            owners = chosen[owners]
            triangles = self._listed[starts[owners] + steps]
            pairs, heights, signs = _cross(self._spans, triangles, placed.take(owners, axis=1))
            owners = owners[pairs]
            above = heights >= placed[2, owners]
            winding = winding + np.bincount(
                owners[above], signs[above], minlength=len(winding)
            ).astype(np.int64)
        return np.asarray(winding != 0)


def covered_columns(corners: F64, counts: I64) -> tuple[I64, I64, I64, I64]:
    """Voxels touched by triangles (F, 3, 3), in cells: never too few, seldom too many.

    Triangles are cut into rows of cells (y), then into columns (x); within a column the triangle's
    plane bounds its heights. ``counts`` (3,) are cells along each axis; parts beyond count at the
    border in x and z, and raise ValueError in y. Returns triangles, columns, first and last (n,): a
    triangle touches the voxels ``first`` to ``last`` of a column.
    """

    def cells(low: F64, high: F64, axis: int) -> tuple[I64, I64]:
        top = counts[axis] - 1
        return (
            np.clip(np.floor(low - MARGIN), 0, top).astype(np.int64),
            np.clip(np.floor(high + MARGIN), 0, top).astype(np.int64),
        )

    first, last = cells(corners[:, :, 1].min(axis=1), corners[:, :, 1].max(axis=1), 1)
    steps, triangles = ramp(last - first + 1)
    rows = first[triangles] + steps
    low, high = _clipped_box(corners, triangles, rows - MARGIN, rows + 1.0 + MARGIN)

    first, last = cells(low[0], high[0], 0)
    steps, strips = ramp(last - first + 1)
    across = first[strips] + steps
    triangles, rows = triangles[strips], rows[strips]

    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    # The plane of a steep triangle bounds no heights: there the clipped box decides alone.
    flat = np.abs(normals[:, 2]) > _STEEP * np.abs(normals).max(axis=1)
    tilt = -normals[:, :2] / np.where(flat, normals[:, 2], np.inf)[:, None]
    reach = np.where(flat, np.abs(tilt).sum(axis=1) * (0.5 + MARGIN) + MARGIN, np.inf)
    centre = np.stack([across, rows], axis=1) + 0.5 - corners[triangles, 0, :2]
    plane = corners[triangles, 0, 2] + np.sum(tilt[triangles] * centre, axis=1)
    bottom = np.maximum(low[1][strips], plane - reach[triangles])
    top = np.minimum(high[1][strips], plane + reach[triangles])
    met = bottom <= top + MARGIN
    first, last = cells(bottom[met], top[met], 2)
    columns = (across * counts[1] + rows)[met]
    return triangles[met], columns, np.minimum(first, last), np.maximum(first, last)


def _clipped_box(corners: F64, triangles: I64, below: F64, above: F64) -> tuple[F64, F64]:
    """Lowest and highest x and z, (2, n) each, of triangles (n,) clipped to below <= y <= above.
    Infinite, low above high, for a triangle outside."""
    low = np.full((2, len(triangles)), np.inf)
    high = np.full((2, len(triangles)), -np.inf)
    order = np.argsort(corners[:, :, 1], axis=1, kind="stable")
    ordered = np.take_along_axis(corners, order[:, :, None], 1)
    for start, end in ((0, 1), (1, 2), (0, 2)):
        foot, head = ordered[triangles, start], ordered[triangles, end]
        climb = head[:, 1] - foot[:, 1]
        safe = np.where(climb > 0.0, climb, 1.0)
        entry = np.where(climb > 0.0, np.clip((below - foot[:, 1]) / safe, 0.0, 1.0), 0.0)
        leave = np.where(climb > 0.0, np.clip((above - foot[:, 1]) / safe, 0.0, 1.0), 1.0)
        passes = (foot[:, 1] <= above) & (head[:, 1] >= below)
        for row, axis in enumerate((0, 2)):
            span = head[:, axis] - foot[:, axis]
            near, far = foot[:, axis] + entry * span, foot[:, axis] + leave * span
            np.minimum(low[row], np.minimum(near, far), where=passes, out=low[row])
            np.maximum(high[row], np.maximum(near, far), where=passes, out=high[row])
    return low, high


def bounds_in_columns(corners: F64, listed: I64, columns: I64, cells: I64, margin: float) -> I64:
    """Bounds of listed triangles within their columns, eight bounds packed into each int64, (n,).

    Opaque; read by the compiled inside test. ``corners`` (F, 3, 3) and ``margin``, the growth of
    the bounds, are in cells; ``listed`` and ``columns`` (n,) are triangle and column of each list
    entry; ``cells`` (3,) counts cells along each axis.
    """
    bounds = np.empty(len(listed), np.int64)
    loaded().hfx_mesh_bounds(
        *(corners, listed, columns, len(listed), int(cells[1]), int(cells[2]), margin, bounds)
    )
    return bounds
