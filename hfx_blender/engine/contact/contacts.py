# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of bodies with volumes: vertices whose skin is inside, and the share of it.

Broad phase: boxes of vertex clusters against boxes of volumes, in the world. Narrow phase:
only the clusters that a volume can reach are posed, straight into the volume's shape space,
and looked at together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..active_rows import FARTHEST
from ..counters import Counters
from ..kinematics.motion import largest_stretch
from ..native import skin as native_skin
from ..scene import EffectBlock, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..skin.skinned_model import SkinnedModel
from ..volume.placement import inverse_placement
from ..volume.shape import Falloff
from . import compiled_contacts
from .accumulator import Found
from .broad_phase import Placed
from .broad_phase import ReachableBounds as ReachableBounds
from .contact_details import Details

if TYPE_CHECKING:
    from ..native.threads import Threads

F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of a body with a volume over some times; equal successive sets are stored once."""

    rows: I64  # (n,) rows of the block at which anything is inside, ascending
    sets: I64  # (n,) which vertex set each has, from 0, rising by 0 or 1
    offsets: I64  # (m + 1,) set j has the vertices slice(offsets[j], offsets[j + 1])
    vertices: I32  # (total,) ascending within a set
    weights: Weights  # (total,) in (0, 1]
    details: Details | None  # where asked for; each row has its own set then


def bounds_of(skin: BodySkin, pose: PoseBlock, rows: I64) -> ReachableBounds:
    """World boxes of a model's skin, cluster by cluster, at ``rows`` of the block."""
    to_world = pose.to_world[rows]
    surface, margins_m = skin.surface, skin.skin.margins_m
    if isinstance(surface, SkinnedModel) and native_skin.is_there():
        assert pose.bones is not None
        found = surface.outline.bounds(pose.bones, rows, to_world, margins_m)
        return ReachableBounds(rows, *found)
    low, high = surface.cluster_bounds(pose, rows, to_world)
    if margins_m is not None:
        bulge = largest_stretch(to_world)[:, None, None] * margins_m[:, None]
        low, high = low - bulge, high + bulge
    return ReachableBounds.around(rows, low, high)


def box_of(skin: BodySkin, pose: PoseBlock, rows: I64) -> tuple[F64, F64]:
    """World boxes (n, 3), lowest and highest corners, of all of a model's skin at ``rows``."""
    to_world = pose.to_world[rows]
    low, high = skin.surface.box(pose, rows, to_world)
    if skin.skin.margins_m is not None:
        bulge = largest_stretch(to_world)[:, None] * skin.skin.margins_m.max(initial=0.0)
        low, high = low - bulge, high + bulge
    return low, high


def begin(
    effect: EffectBlock,
    falloff: Falloff,
    rows: I64,
    skin: BodySkin,
    pose: PoseBlock,
    bounds: ReachableBounds,
    counters: Counters,
    *,
    follows: Bool | None = None,
    heard: Bool | None = None,
    own_sets: bool = False,
    with_details: bool = False,
    with_impact: bool = False,
    threads: Threads | None = None,
    title: str = "a volume",
) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume at some rows of a block.

    Parameters
    ----------
    rows : (n,) int64
        Rows at which the volume is active, a subset of ``bounds.rows``.
    follows : (n,) bool, optional
        Whether the row before in ``rows`` is the sample before, so that what passed in between
        is felt too.
    heard : (n,) bool, optional
        Rows that are reported; the others are only there to be followed from.
    own_sets : bool
        Do not share vertex sets between rows.
    with_details : bool
        Also tell where each contact is.
    with_impact : bool
        And how it began, however slowly.
    threads : Threads, optional
        Threads for the compiled part, which looks at skin while this one goes on.
    title : str
        The volume, as warnings name it.

    Returns
    -------
    callable
        Waits for it and gives the :class:`Contacts`. What is on the boundary is inside; what
        falloff weakens to nothing is left out.
    """
    assert effect.matrices is not None
    heard = np.ones(len(rows), np.bool_) if heard is None else heard
    follows = np.zeros(len(rows), np.bool_) if follows is None else follows
    if not (with_details or with_impact) and compiled_contacts.is_possible(effect, skin):
        found = compiled_contacts.begin(
            effect, falloff, rows, skin, pose, bounds, counters, follows, heard, own_sets, threads
        )
        if found is not None:
            return partial(_told_by, found, rows)
    contacts = _found_in_numpy(
        *(effect, falloff, rows, skin, pose, bounds, counters, follows, heard, own_sets),
        *(with_details, with_impact, title),
    )
    return lambda: contacts


def _told_by(found: Callable[[], compiled_contacts.Found], rows: I64) -> Contacts:
    at, sets, offsets, vertices, weights = found()
    return Contacts(rows[at], sets, offsets, vertices, weights, None)


def _found_in_numpy(
    effect: EffectBlock,
    falloff: Falloff,
    rows: I64,
    skin: BodySkin,
    pose: PoseBlock,
    bounds: ReachableBounds,
    counters: Counters,
    follows: Bool,
    heard: Bool,
    own_sets: bool,
    with_details: bool,
    with_impact: bool,
    title: str,
) -> Contacts:
    assert effect.matrices is not None
    inverses, usable = inverse_placement(effect.matrices[rows])
    usable = usable & (np.abs(effect.matrices[rows]) <= FARTHEST).all(axis=(1, 2))
    if not usable.all():
        counters.warn(
            f"{title} is flattened, endless or not a number: it is not felt",
            int(np.count_nonzero(~usable & heard)),
        )
        follows = follows.copy()
        follows[1:] &= usable[:-1]
        rows, inverses = rows[usable], inverses[usable]
        heard, follows = heard[usable], follows[usable]
    placed = Placed.of(effect, falloff, rows, inverses, skin, pose, bounds)
    reached, simple = placed.reached(falloff)
    reached &= heard[:, None]
    counters.volume_tests += int(np.count_nonzero(heard))
    counters.clusters_tested += int(np.count_nonzero(heard)) * reached.shape[1]
    followed = placed.followed(follows, simple, always=with_impact)
    needed = reached | followed
    needed[:-1] |= followed[1:]
    found = Found.none_yet(placed, needed, counters, with_details or with_impact)
    if len(found.columns):
        by_vertex = simple if skin.skin.is_split else np.ones_like(simple)
        found.look_at_vertices(needed & by_vertex, simple)
        found.look_at_skin(needed & ~by_vertex, followed)
        if found.details is not None:
            found.place_all(needed)
    found.weights[~heard] = 0.0
    return _gathered(rows, found.columns, found.weights, found.details, own_sets)


def _gathered(
    rows: I64,
    columns: I32,
    weights: Weights,
    details: Details | None,
    own_sets: bool,
) -> Contacts:
    felt = weights.any(axis=1)
    rows, weights = rows[felt], weights[felt]
    is_new = np.ones(len(rows), np.bool_)
    if not own_sets:
        is_new[1:] = (weights[1:] != weights[:-1]).any(axis=1)
    owners, felt_columns = np.nonzero(weights[is_new])
    if details is not None:
        details = details.of(np.flatnonzero(felt)[owners], felt_columns)
    return Contacts(
        rows,
        np.cumsum(is_new) - 1,
        np.searchsorted(owners, np.arange(np.count_nonzero(is_new) + 1)),
        columns[felt_columns],
        weights[is_new][owners, felt_columns],
        details,
    )
