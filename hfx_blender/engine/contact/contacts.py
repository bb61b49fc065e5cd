# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact of bodies with volumes: vertices whose skin is inside, and the share of it.

The compiled library finds them, :mod:`.compiled_contacts`; without it they are computed as
:mod:`..reference` defines them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from ..active_rows import FARTHEST
from ..arrays import I32, I64, Bool, Weights
from ..native import library
from ..volume.placing_matrix import inverse_placement
from . import compiled_contacts, reference_contacts
from .contact_details import Contacts, DetailArrays
from .contact_query import ContactQuery


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
    found = list(reference_contacts.contacts_at(query, rows, query.follows, query.reported))
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
