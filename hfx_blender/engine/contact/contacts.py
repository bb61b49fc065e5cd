# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of bodies with volumes: vertices with skin inside, and the share of that skin.

The compiled library computes contacts (:mod:`.compiled_contacts`); without it the definition in
:mod:`..reference` is evaluated.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Final

import numpy as np

from ..active_rows import FARTHEST
from ..arrays import F64, I32, I64, Bool, Weights
from ..native import library
from ..reference.cells import EXACT, Fineness, Skin
from ..reference.contact import Body, Contact, Volume, contact
from ..reference.pose import moved, world_points
from ..volume.shape import inverse_placement, world_bounds
from . import compiled_contacts
from .contact_query import ContactQuery, Contacts, DetailArrays

_BULGE: Final = 0.1
"""Bound of the distance of skin from its triangle, as a share of the diagonal of the triangle's
box: three edges bulge by at most a quarter of its size, each by a ninth of that in the middle."""


def begin(query: ContactQuery) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume at some rows of a block.

    Returns a function that waits for the :class:`Contacts` and returns them. The boundary counts as
    inside; contacts with a weight of 0 are left out. Rows with an unusable placement are left out,
    with a warning.
    """
    if library.is_there():
        target = compiled_contacts.placed(query)
        if not target.is_usable.all():
            query = _usable(query, target.is_usable)
            target = compiled_contacts.placed(query)
        tests = int(np.count_nonzero(query.reported))
        query.counters.volume_tests += tests
        query.counters.clusters_tested += tests * query.bounds.low.shape[1]
        is_new = ~_copies(query)
        if is_new.all():
            return compiled_contacts.begin(query, target)
        distinct = _at(query, is_new)
        finish = compiled_contacts.begin(distinct, compiled_contacts.placed(distinct))
        sources = distinct.rows[np.cumsum(is_new) - 1]
        return lambda: _repeated(finish(), query.rows, sources)
    contacts = _by_definition(query)
    return lambda: contacts


def _copies(query: ContactQuery) -> Bool:
    """Mask (n,) of rows with the contacts of the row before, as body and volume stand still since
    two samples; none with contact details or separate sets."""
    rows, effect = query.rows, query.effect
    if query.asks_details or query.own_sets or not query.follows.any():
        return np.zeros(len(rows), np.bool_)
    is_copy = query.follows & query.pose.is_repeated[rows]
    for values in (effect.matrices, effect.shape_index):
        if values is not None:
            is_copy &= (values[rows] == values[rows - 1]).reshape(len(rows), -1).all(axis=1)
    # Skin may be passed up to the first of two equal samples; the second is the first copy.
    is_copy[1:] &= is_copy[:-1] & (query.reported[1:] == query.reported[:-1])
    return is_copy


def _repeated(hits: Contacts, rows: I64, sources: I64) -> Contacts:
    """Contacts at ``rows`` (n,), each with those of the row in ``sources`` (n,), from ``hits``."""
    is_touched = np.isin(sources, hits.rows)
    sets = hits.sets[np.searchsorted(hits.rows, sources[is_touched])]
    return replace(hits, rows=rows[is_touched], sets=sets)


def _at(query: ContactQuery, mask: Bool) -> ContactQuery:
    """Copy of a contact query with the rows of a mask (n,) only."""
    at = query.rows[mask], query.follows[mask], query.reported[mask]
    return replace(query, rows=at[0], follows=at[1], reported=at[2])


def _usable(query: ContactQuery, usable: Bool) -> ContactQuery:
    """Query restricted to the rows of the mask ``usable`` (n,); warns of lost samples. Rows after
    an unusable row do not follow. The query itself if all are usable."""
    if usable.all():
        return query
    lost, flattened = int(np.count_nonzero(~usable & query.reported)), query.counters.flattened
    flattened[query.name] = flattened.get(query.name, 0) + lost
    follows = query.follows.copy()
    # A contact in between needs a placement at both ends of the interval.
    follows[1:] &= usable[:-1]
    return _at(replace(query, follows=follows), usable)


def _by_definition(query: ContactQuery) -> Contacts:
    """Contacts of a query by :mod:`..reference`, without unusable rows (warned)."""
    matrices = query.effect.matrices
    assert matrices is not None
    usable = inverse_placement(matrices[query.rows])[1]
    usable = usable & (np.abs(matrices[query.rows]) <= FARTHEST).all(axis=(1, 2))
    query = _usable(query, usable)
    rows = query.rows
    by_row = list(_contacts_at(query, rows, query.follows, query.reported))
    columns = np.flatnonzero(sum((row.weights > 0.0 for _, row in by_row), np.False_))
    weights: Weights = np.zeros((len(rows), len(columns)), query.falloff.precision)
    details = DetailArrays.empty(*weights.shape) if query.asks_details else None
    for k, row in by_row:
        # Dense rows over the vertices touched at any row, as the compiled library has them.
        weights[k] = row.weights[columns]
        for field in () if details is None else fields(details):
            getattr(details, field.name)[k] = getattr(row.details, field.name)[..., columns].T
    return _gathered(rows, columns.astype(np.int32), weights, details, query.own_sets)


def _gathered(
    rows: I64, columns: I32, weights: Weights, details: DetailArrays | None, own_sets: bool
) -> Contacts:
    """Contacts from dense weights (n, C); equal successive rows share a set unless ``own_sets``."""
    is_touched = weights.any(axis=1)
    rows, weights = rows[is_touched], weights[is_touched]
    is_new = np.ones(len(rows), np.bool_)
    if not own_sets:
        is_new[1:] = (weights[1:] != weights[:-1]).any(axis=1)
    owners, touched_columns = np.nonzero(weights[is_new])
    return Contacts(
        rows,
        np.cumsum(is_new) - 1,
        np.searchsorted(owners, np.arange(np.count_nonzero(is_new) + 1)),
        columns[touched_columns],
        weights[is_new][owners, touched_columns],
        None
        if details is None
        else details.of(np.flatnonzero(is_touched)[owners], touched_columns),
    )


def _contacts_at(
    query: ContactQuery, rows: I64, follows: Bool, reported: Bool
) -> Iterator[tuple[int, Contact]]:
    """Yield (index, contact) for ``reported`` rows (n,) with skin cells near the volume. ``rows``
    and ``follows`` are as in the query; the volume is usable at all rows."""
    skin, volume = query.skin.skin, Volume(query.effect, query.falloff)
    of_model = Skin.of(skin.model, skin.finer)
    fineness = None  # only vertices are tested
    if skin.is_split:
        share, distance_m = skin.tolerance.spacing_share, skin.tolerance.distance_m
        fineness = Fineness(max(share, EXACT.share), EXACT.least_m, max(distance_m, EXACT.most_m))
    body = Body(of_model, query.skin.binding, query.pose, fineness)
    with_details = query.asks_details
    is_solid = inverse_placement(query.pose.to_world[rows])[1]
    for k in np.flatnonzero(reported).tolist():
        # Tracking needs an invertible frame of the body at both rows.
        is_tracked = follows[k] and math.isfinite(skin.edge_m) and is_solid[k - 1 : k + 1].all()
        row, before = int(rows[k]), int(rows[k - 1]) if is_tracked else None
        near = _cells_near(body, volume, row, before)
        query.counters.volume_tests += 1
        query.counters.vertices_posed += len(near)
        if len(near):
            body_near = replace(body, cells=near)
            yield k, contact(body_near, volume, row, before, with_details=with_details)


def _cells_near(body: Body, volume: Volume, row: int, before: int | None) -> I64:
    """Ascending cells with skin that a volume may reach at a row or since the row ``before``."""
    surface, rows = body.skin.surface, [row] if before is None else [before, row]
    corners = surface.triangles.T
    if body.fineness is None:
        corners = np.arange(len(surface), dtype=np.int32)[None]
    points = [world_points(surface, body.binding, body.pose, at) for at in rows]
    places = np.stack([posed[:, corner] for posed in points for corner in corners])
    low, high = places.min(axis=0), places.max(axis=0)
    shape, matrices = volume.shape(row), np.stack([volume.matrix(at) for at in rows])
    boxes = world_bounds(shape, matrices)
    reach = _BULGE * np.sqrt(np.square(high - low).sum(axis=0))
    # Turning motion leaves the straight path between both rows; the boxes grow by that bound.
    if before is not None:
        corners_of_box = np.stack(np.meshgrid(*shape.bounds.T)).reshape(3, -1)
        reach = reach + _swing(matrices, [corners_of_box])
        frames = body.pose.to_world[rows]
        own = zip(np.linalg.inv(frames), points, strict=True)
        reach = reach + _swing(frames, [moved(inverse, posed) for inverse, posed in own])
    meets = (low - reach <= boxes[:, 1].max(axis=0)[:, None]).all(axis=0)
    meets &= (high + reach >= boxes[:, 0].min(axis=0)[:, None]).all(axis=0)
    return np.unique(body.skin.owner[corners[:, meets]]).astype(np.int64)


def _swing(frames: F64, points: list[F64]) -> float:
    """Bound of the distance of points (3, N) from straight paths while their frame turns, metres. A
    point o in frames A and B (2, 4, 4) stays as near to both ends of its path as the ends are to
    each other, |A o - B o|, apart from the origin, which moves straight."""
    change = frames[1, :3, :3] - frames[0, :3, :3]
    ways = change @ np.concatenate(points, axis=1)
    return float(np.sqrt(np.square(ways).sum(axis=0).max()))
