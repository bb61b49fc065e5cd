# SPDX-License-Identifier: GPL-3.0-or-later
"""Broad phase of one volume and one body: clusters of skin within reach; ``broad_phase.c``."""

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
"""Tests of a pair's cells: none, share of covered skin, vertices only, entirely inside."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Cluster-row pairs, ascending, with the kind of test for each.

    With ``steps`` above 0 a pair follows the pair of the same cluster at the row before.
    """

    clusters: I64  # (p,)
    rows: I64  # (p,)
    how: U8  # (p,) NOT, COVERED, BY_VERTEX or WHOLE
    steps: I64  # (p,) straight steps of tracking from the row before; 0: untracked
    filled: Any = None  # ``hfx_pairs`` filled by the library

    @property
    def pointers(self) -> Any:
        """Structure ``hfx_pairs`` of these arrays."""
        arrays = self.clusters, self.rows, self.how, self.steps
        return self.filled or structure("hfx_pairs")(len(self.clusters), *arrays)


class SurfacePlaces:
    """Positions of skin that no bones move, in body space; ``hfx_surface_places``.

    ``places`` (m, P, 3) are the skin's at m rows, ``own`` (m, cells, 3) the cells' vertices, None
    where they are places of the skin. ``at`` (n,) is the index among the m rows of each row of the
    volume, ``starts`` (clusters + 1,) the first place of each cluster.
    """

    def __init__(self, places: F64, own: F64 | None, at: I64, starts: I64) -> None:
        counts = places.shape[1], 0 if own is None else own.shape[1]
        self.pointers = structure("hfx_surface_places")(places, own, at, starts, *counts)


@dataclass(frozen=True, eq=False)
class Reached:
    """Result of the broad phase: cluster-row pairs for the narrow phase."""

    pairs: Pairs
    clusters: I64  # unique
    wide: I64  # clusters with sampled or tracked skin
    by_vertex: I64  # clusters for which vertices suffice
    most_steps: int  # of any pair
    bones: PosedBones | None  # to shape space; only bones of these clusters
    surface: SurfacePlaces | None  # without bones


class CompiledBroadPhase:
    """Broad phase of one volume and one body.

    Call :meth:`overlaps` first, then :meth:`reach` or :meth:`reach_surface` once. ``outline`` is
    that of the body's clusters, None for skin that no bones move. ``rows`` (m,) are the rows of the
    block with ``boxes`` (:meth:`..native.cluster_bounds.Outline.bounds`), ascending; they contain
    the target's rows, at the indices ``at`` (n,), valid after :meth:`overlaps`. ``follows`` and
    ``reported`` (n,) are of :class:`.contact_query.ContactQuery`, ``edge_m`` is the accepted error
    of a contact's edge. ``is_split``: cells have samples; ``is_always``: track all skin that may
    pass, however slow. Raises IndexError: a row of the target has no boxes.
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
        """Clusters whose world boxes meet the volume's box at any row, ascending."""
        met = np.empty(len(self._near), np.int64)
        count = loaded().hfx_overlaps(self._pointers, self._target.pointers, met)
        return met[:count]

    @property
    def near_count(self) -> int:
        """Number of clusters in reach at or between rows; set by :meth:`overlaps`."""
        count: int = self._pointers.near_count
        return count

    def reach(self, posed: F64, used: UsedBones, own: Outline | None, groups: Any) -> Reached:
        """Finish the broad phase of a body with bones; IndexError for a row beyond the pose.

        ``posed`` (T, B, 3, 4) is rest to posed armature space at each row of the block; ``used``
        are bones of all clusters; ``own`` is the outline of the cells' vertices, None where they
        are units of the skin; ``groups`` are bounds of cell sizes, see
        :meth:`..skin.cell_coverage.BodySkin.cell_groups`, None without falloff or where amplitudes
        must be exact.
        """
        count, posed = self._target.count, f64(posed)
        if count and not self._target.rows[-1] < len(posed):
            raise IndexError(f"row {self._target.rows[-1]} of a pose of {len(posed)}")
        bones = PosedBones(count, used, posed.shape[1])
        where = structure("hfx_posed")(posed, posed.shape[1], used.ids, own and own.pointers)
        is_used = np.empty(len(used.ids), np.uint8)
        return self._reached(bones, None, (where, bones.pointers, is_used, None), groups)

    def reach_surface(self, surface: SurfacePlaces) -> Reached:
        """Finish the broad phase of a body that no bones move, with its positions."""
        return self._reached(None, surface, (None, None, None, surface.pointers), None)

    def _reached(
        self,
        bones: PosedBones | None,
        surface: SurfacePlaces | None,
        body: tuple[Any, ...],
        groups: Any,
    ) -> Reached:
        """Run ``hfx_reach``, with room for every near cluster at every row; returns the used part.

        ``body``: pointers of pose, bones, bone mask and surface places, None where absent.
        """
        near, count = self.near_count, self._target.count
        # Room for every near cluster at every row; the library returns the used part.
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
        every, wide, by_vertex = (ids[:n] for ids, n in zip(lists, numbers, strict=True))
        total = pairs.count
        reached = Pairs(clusters[:total], rows[:total], how[:total], steps[:total], pairs)
        return Reached(reached, every, wide, by_vertex, most_steps, bones, surface)
