# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies against volumes: which vertices are inside, and how strongly.

Broad phase: boxes of vertex clusters against boxes of volumes, in the world. Narrow phase:
only the clusters that a volume can reach are posed, straight into the volume's shape space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .body.posing import PosableModel
from .counters import Counters
from .scene import EffectBlock, PoseBlock
from .volume.placement import inverse_placement, world_bounds
from .volume.shape import Falloff, Shape

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Vertices inside one volume over some times; a vertex set that stays is held once."""

    rows: I64  # (n,) rows of the block at which anything is inside, ascending
    sets: I64  # (n,) which vertex set each has, from 0, rising by 0 or 1
    offsets: I64  # (m + 1,) set j has the vertices slice(offsets[j], offsets[j + 1])
    vertices: I32  # (total,) ascending within a set
    weights: npt.NDArray[np.floating[Any]]  # (total,) in (0, 1]
    points: F64 | None  # (3, total) shape space, where asked for; each row has its own set then


@dataclass(frozen=True, eq=False)
class ReachableBounds:
    """World boxes of a posed model's clusters over some rows of a block."""

    rows: I64  # (n,) rows whose pose is known, ascending
    low: F64  # (n, C, 3)
    high: F64  # (n, C, 3)


def bounds_of(model: PosableModel, pose: PoseBlock, rows: I64) -> ReachableBounds:
    """World boxes of a model's clusters at ``rows`` of the block."""
    low, high = model.cluster_bounds(pose, rows, pose.to_world[rows])
    return ReachableBounds(rows, low, high)


def find(
    effect: EffectBlock,
    falloff: Falloff,
    rows: I64,
    model: PosableModel,
    pose: PoseBlock,
    bounds: ReachableBounds,
    counters: Counters,
    *,
    with_points: bool = False,
) -> Contacts:
    """Vertices of a body inside a volume at some rows of a block.

    Parameters
    ----------
    rows : (n,) int64
        Rows at which the volume is active, a subset of ``bounds.rows``.
    with_points : bool
        Also tell where in shape space each vertex is.

    Returns
    -------
    Contacts
        Vertices on the boundary are inside; those that falloff weakens to nothing are left out.
    """
    assert effect.matrices is not None
    inverses, usable = inverse_placement(effect.matrices[rows])
    if not usable.all():
        counters.warn(
            "a volume is flattened, endless or not a number: it is not felt",
            int(np.count_nonzero(~usable)),
        )
        rows, inverses = rows[usable], inverses[usable]
    which = np.zeros(len(rows), np.int64)
    if effect.shape_index is not None:
        which = effect.shape_index[rows].astype(np.int64)
    reached = np.zeros((len(rows), len(model.clusters)), np.bool_)
    enclosed = np.zeros_like(reached)
    for k in np.unique(which):
        mine = np.flatnonzero(which == k)
        shape = effect.shapes[k]
        box = world_bounds(shape, effect.matrices[rows[mine]])
        at = np.searchsorted(bounds.rows, rows[mine])
        low, high = bounds.low[at], bounds.high[at]
        reached[mine] = ((low <= box[:, None, 1]) & (high >= box[:, None, 0])).all(axis=2)
        if shape.is_convex and falloff.is_flat and not with_points:
            within = ((low >= box[:, None, 0]) & (high <= box[:, None, 1])).all(axis=2)
            enclosed[mine] = _enclosed(shape, inverses[mine], low, high, within)
    counters.volume_tests += len(rows)
    counters.clusters_tested += reached.size

    touched = np.flatnonzero(reached.any(axis=0))
    columns = np.sort(
        np.concatenate([np.zeros(0, np.int32), *(model.clusters[c] for c in touched)])
    )
    # Nothing but 0 and 1 without falloff, in half the memory.
    precision = np.float32 if falloff.is_flat else np.float64
    weights = np.zeros((len(rows), len(columns)), precision)
    points = np.zeros((3, *weights.shape)) if with_points else None
    for cluster in touched:
        place = np.searchsorted(columns, model.clusters[cluster])
        weights[np.ix_(enclosed[:, cluster], place)] = 1.0
        mine = np.flatnonzero(reached[:, cluster] & ~enclosed[:, cluster])
        if not len(mine):
            continue
        to_shape = inverses[mine] @ pose.to_world[rows[mine]]
        local = model.cluster_points(int(cluster), pose, rows[mine], to_shape)
        counters.vertices_posed += local[0].size
        weights[np.ix_(mine, place)] = _weights(effect.shapes, which[mine], local, falloff)
        if points is not None:
            points[:, mine[:, None], place] = local
    felt = weights.any(axis=1)
    rows, weights = rows[felt], weights[felt]
    is_new = np.ones(len(rows), np.bool_)
    if points is None:
        is_new[1:] = (weights[1:] != weights[:-1]).any(axis=1)
    owners, felt_columns = np.nonzero(weights[is_new])
    return Contacts(
        rows,
        np.cumsum(is_new) - 1,
        np.searchsorted(owners, np.arange(np.count_nonzero(is_new) + 1)),
        columns[felt_columns],
        weights[is_new][owners, felt_columns],
        None if points is None else points[:, felt][:, owners, felt_columns],
    )


def _enclosed(shape: Shape, inverses: F64, low: F64, high: F64, candidates: Bool) -> Bool:
    """Which cluster boxes, world space (n, C, 3), lie wholly inside a convex shape, (n, C)."""
    row, cluster = np.nonzero(candidates)
    ends = np.stack([low[row, cluster], high[row, cluster]])  # (2, K, 3)
    picks = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    corners = np.stack([ends[picks[:, axis], :, axis] for axis in range(3)], axis=-1)  # (8, K, 3)
    local = (
        np.einsum("kij,ckj->ick", inverses[row, :3, :3], corners) + inverses[row, :3, 3].T[:, None]
    )
    inside = np.zeros_like(candidates)
    inside[row, cluster] = shape.contains(local.reshape(3, -1)).reshape(8, -1).all(axis=0)
    return inside


def _weights(shapes: tuple[Shape, ...], which: I64, points: F64, falloff: Falloff) -> F64:
    """Contact weight of points (3, n, k), one shape for each row; 0 outside."""
    weights = np.zeros(points.shape[1:])
    for k in np.unique(which):
        mine = which == k
        flat = points[:, mine].reshape(3, -1)
        inside = shapes[k].contains(flat)
        if falloff.is_flat:
            values = inside.astype(np.float64)
        else:
            values = np.zeros(flat.shape[1])
            values[inside] = falloff.weight(shapes[k].rise(flat[:, inside]))
        weights[mine] = values.reshape(-1, points.shape[2])
    return weights
