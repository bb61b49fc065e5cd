# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for samples before which a volume may have touched skin and turned back.

Near skin at both samples, on a bent way: told from boxes, then by contacts of a larger volume.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from ..arrays import F64, Bool
from ..contact.reachable_bounds import bends_m
from ..samples import SampleRun
from ..volume.mesh import MeshVolume
from .touches import Moments, boxes_at

_LEAST_M: Final = 1e-4  # a smaller way beside the straight one touches no skin worth telling

Contacts = Callable[[Moments, Bool], SampleRun | None]
"""Contacts of the volume at the rows of moments, without its response. The second argument (n,)
tells which rows follow the one before, as in :class:`.contact_query.ContactQuery`."""


def may_graze(moments: Moments) -> Bool:
    """Rows (n,) before which a volume may have touched skin on a bent way, near it at both ends.

    Told from boxes: of the volume, and of the body's clusters.
    """
    assert moments.effect.matrices is not None
    rows, found = moments.rows, np.zeros(len(moments.rows), np.bool_)
    if len(rows) < 3:
        return found
    bounds, follows = moments.bounds, follow_on(moments)
    at = np.searchsorted(bounds.rows, rows)
    boxes = boxes_at(moments.effect, rows)
    beside = bends_m(boxes, follows)
    most = float(beside.max(initial=0.0)) + float(bounds.bends_m.max(initial=0.0))
    if not most > _LEAST_M:
        return found
    meets = _meets(boxes, bounds.of_rows[at], most)
    for k in np.flatnonzero(meets & follows).tolist():
        reach = beside[k] + bounds.bends_m[at[k]]
        for row in (k - 1, k):
            low, high = bounds.low[at[row]], bounds.high[at[row]]
            overlaps = (boxes[row, 0] - reach[:, None] <= high).all(axis=1)
            overlaps &= (boxes[row, 1] + reach[:, None] >= low).all(axis=1)
            found[k] |= bool((overlaps & (reach > _LEAST_M)).any())
    return found


def may_touch(moments: Moments, grazes: Bool, contacts: Contacts) -> Bool:
    """Select rows (n,) at which a volume larger by half of its way, and all beside, is touched."""
    effect, chosen = moments.effect, np.flatnonzero(grazes)
    if not len(chosen) or any(isinstance(each, MeshVolume) for each in effect.shapes):
        return grazes
    assert effect.matrices is not None
    bounds, rows = moments.bounds, moments.rows
    at, boxes = np.searchsorted(bounds.rows, rows), boxes_at(effect, rows)
    beside = bends_m(boxes, follow_on(moments))[chosen] + bounds.bends_m[at[chosen]].max(axis=1)
    ways = np.abs(boxes[chosen] - boxes[chosen - 1]).max(axis=(1, 2))
    moved = np.abs(bounds.low[at[chosen]] - bounds.low[at[chosen - 1]]).max(axis=(1, 2))
    more = np.zeros(len(rows))
    for part in (chosen, chosen - 1):
        more[part] = np.maximum(more[part], beside + 0.5 * (ways + moved))
    grown = effect.matrices.copy()
    lengths = np.maximum(np.linalg.norm(grown[rows, :3, :3], axis=1), 1e-9)
    grown[rows, :3, :3] *= (1.0 + more[:, None] / lengths)[:, None, :]
    near = np.union1d(chosen, chosen - 1)
    larger = replace(moments, effect=replace(effect, matrices=grown), rows=rows[near])
    run = contacts(larger, np.zeros(len(near), np.bool_))
    is_near = np.zeros(len(rows), np.bool_)
    if run is not None:
        is_near[np.isin(moments.indices[rows], run.indices)] = True
    return grazes & (is_near | np.concatenate([[False], is_near[:-1]]))


def _meets(boxes: F64, bodies: F64, reach: float) -> Bool:
    """Test whether boxes (n, 2, 3) come within a reach at a row or the one before."""
    both = []
    for part in (slice(None, -1), slice(1, None)):
        low = boxes[part, 0] - reach <= bodies[part, 1]
        high = boxes[part, 1] + reach >= bodies[part, 0]
        both.append((low & high).all(axis=1))
    return np.concatenate([[False], both[0] | both[1]])


def follow_on(moments: Moments) -> Bool:
    """Rows (n,) that follow the one before: at the next sample, where the effect was on."""
    rows = moments.rows
    steps = (np.diff(rows) == 1) & (np.diff(moments.indices[rows]) == 1)
    return np.concatenate([[False], steps])
