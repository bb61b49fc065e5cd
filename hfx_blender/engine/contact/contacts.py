# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of bodies with volumes: vertices whose skin is inside, and the share of it.

Broad phase: boxes of vertex clusters against boxes of volumes, in the world. Narrow phase:
only the clusters that a volume can reach are posed, straight into the volume's shape space,
and looked at together. Without the compiled library, contacts are computed as
:mod:`..reference` defines them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from ..active_rows import FARTHEST
from ..arrays import F64, I32, I64, Bool, Weights
from ..kinematics.motion import largest_stretch
from ..native import library
from ..scene import PoseBlock
from ..skin.cell_coverage import BodySkin
from ..skin.skinned_model import SkinnedModel
from ..volume.placing_matrix import inverse_placement
from . import compiled_contacts, reference_contacts
from .accumulator import ContactAccumulator
from .broad_phase import ReachableBounds, VolumeBroadPhase
from .contact_details import Details
from .contact_query import ContactQuery


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
    if isinstance(surface, SkinnedModel):
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


def begin(query: ContactQuery) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume at some rows of a block.

    Returns
    -------
    callable
        Waits for it and gives the :class:`Contacts`. What is on the boundary is inside; what
        falloff weakens to nothing is left out.
    """
    with_details = query.with_details or query.with_impact
    if not with_details and compiled_contacts.is_possible(query):
        found = compiled_contacts.begin(query)
        if found is not None:
            return partial(_of_compiled, found, query.rows)
    contacts = _found_in_numpy(query) if library.is_there() else _by_definition(query)
    return lambda: contacts


def _of_compiled(found: Callable[[], compiled_contacts.FoundContacts], rows: I64) -> Contacts:
    at, sets, offsets, vertices, weights = found()
    return Contacts(rows[at], sets, offsets, vertices, weights, None)


def _usable(query: ContactQuery) -> tuple[I64, F64, Bool, Bool]:
    """Rows of a query at which its volume is usable, inverse placing matrices there, follows and
    reported; the others are warned of."""
    rows, follows, reported = query.rows, query.follows, query.reported
    counters, matrices = query.counters, query.effect.matrices
    assert matrices is not None
    inverses, usable = inverse_placement(matrices[rows])
    usable = usable & (np.abs(matrices[rows]) <= FARTHEST).all(axis=(1, 2))
    if not usable.all():
        counters.warn(
            f"{query.title} is flattened, endless or not a number: it is not felt",
            int(np.count_nonzero(~usable & reported)),
        )
        follows = follows.copy()
        follows[1:] &= usable[:-1]
        rows, inverses = rows[usable], inverses[usable]
        reported, follows = reported[usable], follows[usable]
    return rows, inverses, follows, reported


def _by_definition(query: ContactQuery) -> Contacts:
    rows, _, follows, reported = _usable(query)
    found = list(reference_contacts.contacts_at(query, rows, follows, reported))
    columns = np.flatnonzero(sum((each.weights > 0.0 for _, each in found), np.False_))
    weights: Weights = np.zeros((len(rows), len(columns)), query.falloff.precision)
    details = None
    if query.with_details or query.with_impact:
        details = Details.empty(*weights.shape)
    for k, felt in found:
        weights[k] = felt.weights[columns]
        for each in () if details is None else fields(details):
            getattr(details, each.name)[..., k, :] = getattr(felt.details, each.name)[..., columns]
    return _gathered(rows, columns.astype(np.int32), weights, details, query.own_sets)


def _found_in_numpy(query: ContactQuery) -> Contacts:
    rows, inverses, follows, reported = _usable(query)
    skin, counters = query.skin, query.counters
    broad = VolumeBroadPhase.of(
        query.effect, query.falloff, rows, inverses, skin, query.pose, query.bounds
    )
    reached, simple = broad.reached(query.falloff)
    reached &= reported[:, None]
    counters.volume_tests += int(np.count_nonzero(reported))
    counters.clusters_tested += int(np.count_nonzero(reported)) * reached.shape[1]
    followed = broad.followed(follows, simple, always=query.with_impact)
    needed = reached | followed
    needed[:-1] |= followed[1:]
    with_details = query.with_details or query.with_impact
    found = ContactAccumulator.empty(broad, needed, counters, with_details)
    if len(found.columns):
        by_vertex = simple if skin.skin.is_split else np.ones_like(simple)
        found.look_at_vertices(needed & by_vertex, simple)
        found.look_at_skin(needed & ~by_vertex, followed)
        if found.details is not None:
            found.place_all(needed)
    found.weights[~reported] = 0.0
    return _gathered(rows, found.columns, found.weights, found.details, query.own_sets)


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
