# SPDX-License-Identifier: GPL-3.0-or-later
"""Upper bounds of the size of cells of skin in a pose: the mean distance from their vertex.

Bones stretch skin and pull it apart where they bend. Known for whole clusters from the bones
alone, so that no skin is posed to find out that its vertices tell enough of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..arrays import F64, I64
from ..kinematics.motion import largest_stretch
from ..native.cell_groups import CellGroups
from ..scene import PoseBlock
from .skin_table import SkinTable
from .skinned_model import SkinnedModel

_DISC: Final = 2.0 / 3.0
"""Mean distance of a disc's points from its middle, over its radius."""

_LEAST_M: Final = 1e-12
_LEAST_WEIGHT: Final = 0.01  # bones that move less of a cell do not matter


@dataclass(frozen=True, eq=False)
class _Groups:
    """Groups of a cluster's cells at rest; each value is that of the largest cell of the group.

    A *pair* is a group and a bone that moves some of it, group by group.
    """

    counts: I64  # (G,) pairs of each group
    distances: F64  # (G,) how far skin is from the cell's vertex, on average
    boxes: F64  # (G, 2, 3) middle and half edges of the box of the cells' vertices
    bones: I64  # (P,)
    shares: F64  # (P,) mean weights of the cells' vertices
    changes: F64  # (P,) how far weights of skin are from those of the cell's vertex, on average

    @classmethod
    def of(
        cls,
        groups: I64,
        bones: I64,
        weights: F64,
        places: F64,
        changes: F64,
        distances: F64,
    ) -> _Groups:
        """Build groups from the group of each cell, weights (C, B) and places (C, 3) of its vertex,
        and its values."""
        order = np.argsort(groups, kind="stable")
        firsts = np.flatnonzero(np.diff(groups[order], prepend=-1))
        low = np.minimum.reduceat(places[order], firsts, axis=0)
        high = np.maximum.reduceat(places[order], firsts, axis=0)
        sizes = np.diff(firsts, append=len(order))
        shares = np.add.reduceat(weights[order], firsts, axis=0) / sizes[:, None]
        largest = np.maximum.reduceat(changes[order], firsts, axis=0)
        group, bone = np.nonzero(np.maximum(shares, largest) > _LEAST_WEIGHT)
        shares /= np.where(shares > _LEAST_WEIGHT, shares, 0.0).sum(axis=1)[:, None]
        return cls(
            np.bincount(group, minlength=len(firsts)),
            np.maximum.reduceat(distances[order], firsts),
            np.stack([0.5 * (low + high), 0.5 * (high - low)], axis=1),
            bones[bone],
            np.where(shares > _LEAST_WEIGHT, shares, 0.0)[group, bone],
            largest[group, bone],
        )


class CellSizes:
    """Upper bounds of the sizes of a skin's cells on a body that bones move, cluster by cluster.

    With weights u of a place x of skin and v of its cell's vertex at y, and any matrix R,
    sum u M x - sum v M y = sum u L (x - y) + sum (u - v) (M - R) y: the first part is at most
    what bones stretch times the way at rest, the second how differently bones move the vertex
    times how far the weights differ.

    Parameters
    ----------
    table : SkinTable
        The skin, none of which needs to be filled in.
    surface : SkinnedModel
        Binds the surface of the skin, in its outlines.
    vertices : SkinnedModel, optional
        Binds the model's own vertices, in the clusters of the skin, where its surface is that
        of a finer model.
    """

    def __init__(
        self, table: SkinTable, surface: SkinnedModel, vertices: SkinnedModel | None
    ) -> None:
        self._table, self._surface, self._vertices = table, surface, vertices
        self._known: dict[int, _Groups] = {}
        self._native = CellGroups(len(surface.clusters))

    def means(self, clusters: I64, pose: PoseBlock, rows: I64, to_target: F64) -> F64:
        """Upper bounds of the mean distance of any cell's skin from its vertex.

        Parameters
        ----------
        clusters : (k,) int64
        rows : (n,) int64
            Of the pose.
        to_target : (n, 4, 4) float64
            From the body's own space.

        Returns
        -------
        (n, k) float64
            Target space.
        """
        known = [self._of(cluster) for cluster in clusters.tolist()]
        counts = np.concatenate([each.counts for each in known])
        group = np.repeat(np.arange(len(counts)), counts)
        firsts = np.cumsum(counts) - counts
        bones, slots = np.unique(
            np.concatenate([each.bones for each in known]), return_inverse=True
        )
        matrices = self._surface.bone_matrices(pose, rows, to_target, bones)
        stretches = largest_stretch(matrices.reshape(-1, 3, 4)).reshape(len(rows), -1)
        means = np.maximum.reduceat(stretches[:, slots], firsts, axis=1)
        means *= np.concatenate([each.distances for each in known])
        bent = np.flatnonzero(np.repeat(counts > 1, counts))
        if len(bent):
            changes, shares = (
                np.concatenate(each)[bent]
                for each in zip(*((k.changes, k.shares) for k in known), strict=True)
            )
            boxes = np.concatenate([each.boxes for each in known])[group[bent]]
            middles, halves = boxes.transpose(1, 2, 0)
            firsts = np.flatnonzero(np.diff(group[bent], prepend=-1))
            sizes = counts[counts > 1]
            moved = np.ascontiguousarray(matrices.transpose(2, 3, 0, 1)).take(slots[bent], axis=3)
            ways = np.einsum("ijnp,jp->inp", moved[:, :3], middles) + moved[:, 3]
            ways = np.abs(_apart(ways, shares, firsts, sizes))
            if halves.any():
                spread = np.abs(_apart(moved[:, :3], shares, firsts, sizes))
                ways += np.einsum("ijnp,jp->inp", spread, halves)
            moves = np.sqrt(np.einsum("inp,inp->np", ways, ways)) * changes
            means[:, counts > 1] += np.add.reduceat(moves, firsts, axis=1)
        groups = [len(each.counts) for each in known]
        largest: F64 = np.maximum.reduceat(means, np.cumsum(groups) - groups, axis=1)
        return largest

    def pointers(self, clusters: I64) -> Any:
        """Native table of all clusters, with these filled in."""
        new = self._native.lacking(clusters)
        if len(new):
            surface = self._surface.native_clusters(new)
            own = None if self._vertices is None else self._vertices.native_clusters(new)
            self._native.add(new, self._table, self._table.mesh, surface, own)
        return self._native.table

    def _of(self, cluster: int) -> _Groups:
        if cluster not in self._known:
            self._known[cluster] = self._made(cluster)
        return self._known[cluster]

    def _made(self, cluster: int) -> _Groups:
        table, skin = self._table, self._table.surface
        ids, units = self._surface.clusters[cluster], int(table.unit_counts[cluster])
        areas = skin.areas_m2[ids[:units]].astype(np.float64)
        bones, weights, rest = _weights(self._surface, cluster)
        one, other = table.neighbours(cluster)
        gaps = np.sqrt(np.square(rest[one] - rest[other]).sum(axis=1))
        places = skin.vertices[ids].astype(np.float64)
        before = np.sqrt(np.square(places[one] - places[other]).sum(axis=1))
        # A fitted body is larger or smaller than the model that is fitted.
        grown = _summed(gaps, one, units) / np.maximum(_summed(before, one, units), _LEAST_M)
        radii = np.sqrt(areas / np.pi) * grown
        slopes = np.abs(weights[one] - weights[other]) / np.maximum(gaps, _LEAST_M)[:, None]
        changes = np.zeros((units, len(bones)))
        firsts = np.flatnonzero(np.diff(one, prepend=-1))
        if len(firsts):
            changes[one[firsts]] = np.maximum.reduceat(slopes, firsts, axis=0)
        changes *= _DISC * radii[:, None]
        if self._vertices is None:
            # Cells that the same bones move alike: those at one joint, those of one bone.
            most = weights[:units].argmax(axis=1) * len(bones) + changes.argmax(axis=1)
            groups = np.unique(most, return_inverse=True)[1]
            return _Groups.of(groups, bones, weights[:units], rest[:units], changes, _DISC * radii)
        own_bones, own_weights, own_places = _weights(self._vertices, cluster)
        every = np.union1d(bones, own_bones)
        theirs, own = np.zeros((units, len(every))), np.zeros((len(own_places), len(every)))
        theirs[:, np.searchsorted(every, bones)] = weights[:units]
        own[:, np.searchsorted(every, own_bones)] = own_weights
        first = table.starts[cluster]
        owner = table.cell_of[first : first + units] - table.cell_starts[cluster]
        differences = np.abs(theirs - own[owner])
        differences[:, np.searchsorted(every, bones)] += changes
        # A mean is no more than the root of the mean square: half a disc's squared radius.
        away = np.square(rest[:units] - own_places[owner]).sum(axis=1)
        distances = np.sqrt(away + 0.5 * np.square(radii))
        shares = np.zeros((len(own), units))
        shares[owner, np.arange(units)] = areas / _summed(areas, owner, len(own))[owner]
        return _Groups.of(
            np.arange(len(own)), every, own, own_places, shares @ differences, shares @ distances
        )


def _weights(model: SkinnedModel, cluster: int) -> tuple[I64, F64, F64]:
    """Bones of a cluster (B,), its vertices' weights (V, B) and places at rest (V, 3)."""
    entry_bones, factors, firsts = model.cluster_entries(cluster)
    owner = np.repeat(np.arange(len(firsts)), np.diff(firsts, append=len(entry_bones)))
    bones, column = np.unique(entry_bones, return_inverse=True)
    weights = np.zeros((len(firsts), len(bones)))
    weights[owner, column] = factors[:, 3]
    return bones, weights, np.add.reduceat(factors[:, :3], firsts, axis=0)


def _apart(values: F64, shares: F64, firsts: I64, sizes: I64) -> F64:
    """Values (..., P) of pairs, less the mean of their group."""
    means = np.add.reduceat(values * shares, firsts, axis=-1)
    apart: F64 = values - np.repeat(means, sizes, axis=-1)
    return apart


def _summed(values: F64, owners: I64, count: int) -> F64:
    return np.asarray(np.bincount(owners, values, count), np.float64)
