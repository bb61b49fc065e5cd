# SPDX-License-Identifier: GPL-3.0-or-later
"""Rasterizes the triangles of a mesh into voxels, column by column."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..indexing import ramp

MARGIN: Final = 1e-6
"""Margin in cells; far above rounding, so that no cell misses a triangle."""

_STEEP: Final = 1e-6  # below this cosine a triangle's plane says nothing about its heights


def covered_columns(corners: F64, counts: I64) -> tuple[I64, I64, I64, I64]:
    """Voxels that each triangle touches: never too few, seldom too many.

    Triangles are cut into rows of cells (y), then into columns (x); within a column the plane
    of the triangle bounds its heights.

    Returns
    -------
    triangles, columns, first, last : (n,) int64 each
        A triangle touches the voxels ``first`` to ``last`` of a column.
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
    """Bounds in x and z, (2, n) each, of triangles cut to below <= y <= above."""
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
            one, other = foot[:, axis] + entry * span, foot[:, axis] + leave * span
            np.minimum(low[row], np.minimum(one, other), where=passes, out=low[row])
            np.maximum(high[row], np.maximum(one, other), where=passes, out=high[row])
    return low, high
