# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of bodies with volumes: vertices whose skin is inside, and the share of it.

The compiled library finds them, :mod:`.compiled_contacts`; without it they are computed as
:mod:`..reference` defines them.
"""

from __future__ import annotations

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
from ..skin.cell_coverage import SkinCoverage
from ..volume.placing_matrix import inverse_placement, world_bounds
from . import compiled_contacts
from .contact_query import ContactQuery, Contacts, DetailArrays

_BULGE: Final = 0.1
"""No skin is farther from its triangle than this share of the diagonal of the triangle's box:
its three edges bulge by a quarter of its size at most, each by a ninth of that in the middle."""


def begin(query: ContactQuery) -> Callable[[], Contacts]:
    """Begin the contacts of a body with a volume at some rows of a block.

    Returns
    -------
    callable
        Waits for it and gives the :class:`Contacts`. What is on the boundary is inside; what
        falloff weakens to nothing is left out.
    """
    if library.is_there():
        target = compiled_contacts.placed(query)
        if not target.is_usable.all():
            query = _usable(query, target.is_usable)
            target = compiled_contacts.placed(query)
        return compiled_contacts.begin(query, target)
    contacts = _by_definition(query)
    return lambda: contacts


def _usable(query: ContactQuery, usable: Bool) -> ContactQuery:
    """The query at the rows (n,) bool at which its volume is usable; the others are warned of."""
    if usable.all():
        return query
    query.counters.warn(
        f"{query.title} is flattened, endless or not a number: it is not felt",
        int(np.count_nonzero(~usable & query.reported)),
    )
    follows = query.follows.copy()
    follows[1:] &= usable[:-1]
    at = query.rows[usable], follows[usable], query.reported[usable]
    return replace(query, rows=at[0], follows=at[1], reported=at[2])


def _by_definition(query: ContactQuery) -> Contacts:
    matrices = query.effect.matrices
    assert matrices is not None
    usable = inverse_placement(matrices[query.rows])[1]
    usable = usable & (np.abs(matrices[query.rows]) <= FARTHEST).all(axis=(1, 2))
    query = _usable(query, usable)
    rows = query.rows
    found = list(_contacts_at(query, rows, query.follows, query.reported))
    columns = np.flatnonzero(sum((each.weights > 0.0 for _, each in found), np.False_))
    weights: Weights = np.zeros((len(rows), len(columns)), query.falloff.precision)
    details = DetailArrays.empty(*weights.shape) if query.asks_details else None
    for k, felt in found:
        weights[k] = felt.weights[columns]
        for each in () if details is None else fields(details):
            getattr(details, each.name)[k] = getattr(felt.details, each.name)[..., columns].T
    return _gathered(rows, columns.astype(np.int32), weights, details, query.own_sets)


def _gathered(
    rows: I64,
    columns: I32,
    weights: Weights,
    details: DetailArrays | None,
    own_sets: bool,
) -> Contacts:
    felt = weights.any(axis=1)
    rows, weights = rows[felt], weights[felt]
    is_new = np.ones(len(rows), np.bool_)
    if not own_sets:
        is_new[1:] = (weights[1:] != weights[:-1]).any(axis=1)
    owners, felt_columns = np.nonzero(weights[is_new])
    return Contacts(
        rows,
        np.cumsum(is_new) - 1,
        np.searchsorted(owners, np.arange(np.count_nonzero(is_new) + 1)),
        columns[felt_columns],
        weights[is_new][owners, felt_columns],
        None if details is None else details.of(np.flatnonzero(felt)[owners], felt_columns),
    )


def _contacts_at(
    query: ContactQuery, rows: I64, follows: Bool, reported: Bool
) -> Iterator[tuple[int, Contact]]:
    """Contacts at the ``reported`` of some rows, at all of which the volume is usable: places among
    the rows, and contacts, where the volume comes near the skin at all.

    Parameters
    ----------
    rows, follows, reported : (n,) int64, bool, bool
        As in the query.
    """
    skin, volume = query.skin.skin, Volume(query.effect, query.falloff)
    of_model = Skin.of(skin.model, skin.finer)
    body = Body(of_model, query.skin.binding, query.pose, _fineness(skin))
    with_details = query.asks_details
    is_solid = inverse_placement(query.pose.to_world[rows])[1]
    for k in np.flatnonzero(reported).tolist():
        is_tracked = follows[k] and math.isfinite(skin.edge_m) and is_solid[k - 1 : k + 1].all()
        row, before = int(rows[k]), int(rows[k - 1]) if is_tracked else None
        near = _cells_near(body, volume, row, before)
        query.counters.volume_tests += 1
        query.counters.vertices_posed += len(near)
        if len(near):
            body_near = replace(body, cells=near)
            yield k, contact(body_near, volume, row, before, with_details=with_details)


def _fineness(skin: SkinCoverage) -> Fineness | None:
    """Samples as dense as a tolerance asks for; None where vertices alone are tested."""
    if not skin.is_split:
        return None
    share, distance_m = skin.tolerance.spacing_share, skin.tolerance.distance_m
    return Fineness(max(share, EXACT.share), EXACT.least_m, max(distance_m, EXACT.most_m))


def _cells_near(body: Body, volume: Volume, row: int, before: int | None) -> I64:
    """Cells with any skin that a volume may reach at a row, or since the one before it."""
    surface, rows = body.skin.surface, [row] if before is None else [before, row]
    corners = surface.triangles.T
    if body.fineness is None:
        corners = np.arange(len(surface), dtype=np.int32)[None]
    points = [world_points(surface, body.binding, body.pose, each) for each in rows]
    places = np.stack([each[:, corner] for each in points for corner in corners])
    low, high = places.min(axis=0), places.max(axis=0)
    shape, matrices = volume.shape(row), np.stack([volume.matrix(each) for each in rows])
    boxes = world_bounds(shape, matrices)
    reach = _BULGE * np.sqrt(np.square(high - low).sum(axis=0))
    if before is not None:
        corners_of_box = np.stack(np.meshgrid(*shape.bounds.T)).reshape(3, -1)
        reach = reach + _swing(matrices, [corners_of_box])
        frames = body.pose.to_world[rows]
        own = zip(np.linalg.inv(frames), points, strict=True)
        reach = reach + _swing(frames, [moved(inverse, each) for inverse, each in own])
    meets = (low - reach <= boxes[:, 1].max(axis=0)[:, None]).all(axis=0)
    meets &= (high + reach >= boxes[:, 0].min(axis=0)[:, None]).all(axis=0)
    return np.unique(body.skin.owner[corners[:, meets]]).astype(np.int64)


def _swing(frames: F64, points: list[F64]) -> float:
    """Bound of the distance of points (3, N) that turn and stretch with a frame, from the straight
    ways between their ends, metres.

    What is at o in the frames (2, 4, 4) A and B is on its way no farther from both ends than these
    are from each other, |A o - B o|, but for the origin, which moves straight.
    """
    change = frames[1, :3, :3] - frames[0, :3, :3]
    ways = change @ np.concatenate(points, axis=1)
    return float(np.sqrt(np.square(ways).sum(axis=0).max()))
