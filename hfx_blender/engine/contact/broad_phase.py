# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase of contact: clusters of skin that a volume can reach; ``broad_phase.c``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..arrays import F64, I64, U8, Bool
from ..native.cluster_bounds import Outline
from ..native.declarations import structure
from ..native.library import f64, loaded
from ..native.skin import PosedBones, UsedBones
from .compiled_target import PlacedTarget

NOT: Final = 0
COVERED: Final = 1
BY_VERTEX: Final = 2
WHOLE: Final = 3
"""Kind of test for the cells of a pair."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Cluster-row pairs, ascending, with the kind of test for each.

    Where a pair is followed, the one before it is the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    how: U8  # (p,) NOT, COVERED, BY_VERTEX or WHOLE
    steps: I64  # (p,) in how many straight steps it is followed from the row before; 0: not
    found: Any = None  # ``hfx_pairs`` where the library has filled them in

    @property
    def pointers(self) -> Any:
        """``hfx_pairs``."""
        if self.found is not None:
            return self.found
        arrays = self.clusters, self.rows, self.how, self.steps
        return structure("hfx_pairs")(len(self.clusters), *arrays)


class SurfacePlaces:
    """Places of skin that no bones move, in the body's own space; ``hfx_surface_places``.

    Parameters
    ----------
    places : (m, P, 3) float64
        Of the skin, at some rows.
    own : (m, cells, 3) float64 or None
        Of the cells' vertices, where these are others.
    at : (n,) int64
        Which of these the rows of the volume are.
    starts : (clusters + 1,) int64
        Each cluster's first place.
    """

    def __init__(self, places: F64, own: F64 | None, at: I64, starts: I64) -> None:
        counts = places.shape[1], 0 if own is None else own.shape[1]
        self.pointers = structure("hfx_surface_places")(places, own, at, starts, *counts)


@dataclass(frozen=True, eq=False)
class Reached:
    """Result of the broad phase: cluster-row pairs for the narrow phase."""

    pairs: Pairs
    clusters: I64  # each of them once
    wide: I64  # those whose skin is sampled or tracked
    by_vertex: I64  # those whose vertices suffice
    most_steps: int  # of any pair
    bones: PosedBones | None  # to shape space; only bones that move any of these clusters
    surface: SurfacePlaces | None  # where there are none


class CompiledBroadPhase:
    """Broad phase of one volume and one body: clusters that can be reached, row by row.

    Parameters
    ----------
    target : PlacedTarget
    outline : Outline or None
        Of the body's clusters, where bones move them.
    rows : (m,) int64
        Of the block, ascending; those of the target are among them.
    boxes : tuple
        The clusters' world boxes at these; see :meth:`..native.cluster_bounds.Outline.bounds`.
    follows, reported : (n,) bool
        See :func:`.contacts.begin`.
    edge_m : float
        How far off the edge of a contact may be.
    is_split : bool
        Whether cells have samples.
    is_always : bool
        Whether all that may pass is followed, however slowly.

    Attributes
    ----------
    at : (n,) int64
        Which of the boxes' rows those of the target are.
    """

    def __init__(
        self,
        target: PlacedTarget,
        outline: Outline | None,
        rows: I64,
        boxes: tuple[F64, F64, F64, F64],
        follows: Bool,
        reported: Bool,
        edge_m: float,
        is_split: bool,
        is_always: bool,
    ) -> None:
        count, clusters = target.count, boxes[0].shape[1]
        if count and not (len(rows) and target.rows[-1] <= rows[-1]):
            raise IndexError(f"row {target.rows[-1]} has no boxes")
        self._flags = np.empty(count * clusters, np.uint8)
        self.at, self._near = np.empty(count, np.int64), np.empty(clusters, np.int64)
        self._target = target
        self._pointers = structure("hfx_broad")(
            *(outline and outline.pointers, clusters, target.rows, rows, *boxes),
            *(follows, reported, edge_m, is_split, is_always, self.at, self._flags, self._near),
        )

    def overlaps(self) -> I64:
        """Clusters whose boxes the volume's meets anywhere, ascending; to be called first."""
        met = np.empty(len(self._near), np.int64)
        count = loaded().hfx_overlaps(self._pointers, self._target.pointers, met)
        return met[:count]

    @property
    def near_count(self) -> int:
        """Number of clusters that may be met at any row, or between."""
        count: int = self._pointers.near_count
        return count

    def reach(self, posed: F64, used: UsedBones, own: Outline | None, groups: Any) -> Reached:
        """Finish the broad phase; to be called once.

        Parameters
        ----------
        posed : (T, B, 3, 4) float64
            Rest space to posed armature space, at each row of the block.
        used : UsedBones
            Of all clusters.
        own : Outline or None
            Of the clusters' own vertices where the skin has others.
        groups : array of ``hfx_groups`` or None
            See :meth:`..skin.cell_coverage.BodySkin.cell_groups`, for the clusters that are met;
            None where nothing falls off or amplitudes must be exact.
        """
        count, posed = self._target.count, f64(posed)
        if count and not self._target.rows[-1] < len(posed):
            raise IndexError(f"row {self._target.rows[-1]} of a pose of {len(posed)}")
        bones = PosedBones(count, used, posed.shape[1])
        where = structure("hfx_posed")(posed, posed.shape[1], used.ids, own and own.pointers)
        is_used = np.empty(len(used.ids), np.uint8)
        return self._reached(bones, None, (where, bones.pointers, is_used, None), groups)

    def reach_surface(self, surface: SurfacePlaces) -> Reached:
        """Finish the broad phase of a body that no bones move; to be called once."""
        return self._reached(None, surface, (None, None, None, surface.pointers), None)

    def _reached(
        self,
        bones: PosedBones | None,
        surface: SurfacePlaces | None,
        body: tuple[Any, ...],
        groups: Any,
    ) -> Reached:
        near, count = self.near_count, self._target.count
        clusters, rows, steps = np.empty((3, near * count), np.int64)
        how = np.empty(near * count, np.uint8)
        pairs = Pairs(clusters, rows, how, steps).pointers
        lists, counts = np.empty((3, near), np.int64), np.empty(4, np.int64)
        where, posed, is_used, places = body
        loaded().hfx_reach(
            *(self._pointers, self._target.pointers, where, posed, is_used, places, groups),
            *(pairs, lists, counts),
        )
        *numbers, most_steps = counts.tolist()
        every, wide, by_vertex = (each[:some] for each, some in zip(lists, numbers, strict=True))
        total = pairs.count
        known = Pairs(clusters[:total], rows[:total], how[:total], steps[:total], pairs)
        return Reached(known, every, wide, by_vertex, most_steps, bones, surface)
