# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for intervals in which a volume may have touched skin and turned back.

Candidates are near skin at both ends with a bent path: first by boxes, then by contacts of an
enlarged volume.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from ..arrays import F64, Bool
from ..contact.reachable_bounds import bends_m
from ..samples import SampleRun
from ..volume.mesh import MeshVolume
from .touches import Moments, boxes_at

_LEAST_M: Final = 1e-4  # metres; a smaller deviation from the straight path is ignored

Contacts = Callable[[Moments, Bool], SampleRun | None]
"""Function (moments, follows) -> contacts of the volume at the rows of moments, without response.

``follows`` (n,) selects rows that continue the row before, see
:class:`.contact_query.ContactQuery`.
"""


def may_graze(moments: Moments) -> Bool:
    """Mask (n,) of rows before which a bent path may have touched skin, by boxes of volume and
    clusters. False for paths bent by less than 0.1 mm and below three rows."""
    assert moments.effect.matrices is not None
    rows, is_bent = moments.rows, np.zeros(len(moments.rows), np.bool_)
    if len(rows) < 3:
        return is_bent
    bounds, follows = moments.bounds, follow_on(moments)
    at = np.searchsorted(bounds.rows, rows)
    boxes = boxes_at(moments.effect, rows)
    # A path between two samples deviates from the straight one by at most half of its second
    # difference.
    beside = bends_m(boxes, follows)
    most = float(beside.max(initial=0.0)) + float(bounds.bends_m.max(initial=0.0))
    if not most > _LEAST_M:
        return is_bent
    meets = _meets(boxes, bounds.of_rows[at], most)
    for k in np.flatnonzero(meets & follows).tolist():
        reach = beside[k] + bounds.bends_m[at[k]]
        for row in (k - 1, k):
            low, high = bounds.low[at[row]], bounds.high[at[row]]
            overlaps = (boxes[row, 0] - reach[:, None] <= high).all(axis=1)
            overlaps &= (boxes[row, 1] + reach[:, None] >= low).all(axis=1)
            is_bent[k] |= bool((overlaps & (reach > _LEAST_M)).any())
    return is_bent


def may_touch(moments: Moments, grazes: Bool, contacts: Contacts) -> Bool:
    """Part of the mask ``grazes`` (n,): rows at which, or before which, the volume touches skin
    when enlarged by half of all motion and the bend. With mesh volumes ``grazes`` itself."""
    effect, chosen = moments.effect, np.flatnonzero(grazes)
    # A scaled mesh is no mesh enlarged by a margin.
    if not len(chosen) or any(isinstance(shape, MeshVolume) for shape in effect.shapes):
        return grazes
    assert effect.matrices is not None
    bounds, rows = moments.bounds, moments.rows
    at, boxes = np.searchsorted(bounds.rows, rows), boxes_at(effect, rows)
    bends = bends_m(boxes, follow_on(moments))[chosen] + bounds.bends_m[at[chosen]].max(axis=1)
    ways = np.abs(boxes[chosen] - boxes[chosen - 1]).max(axis=(1, 2))
    moved = np.abs(bounds.low[at[chosen]] - bounds.low[at[chosen - 1]]).max(axis=(1, 2))
    margins_m = np.zeros(len(rows))
    for part in (chosen, chosen - 1):
        margins_m[part] = np.maximum(margins_m[part], bends + 0.5 * (ways + moved))
    grown = effect.matrices.copy()
    # Scaling an axis of length l by 1 + margin / l moves the surface outwards by the margin.
    lengths = np.maximum(np.linalg.norm(grown[rows, :3, :3], axis=1), 1e-9)
    grown[rows, :3, :3] *= (1.0 + margins_m[:, None] / lengths)[:, None, :]
    near_rows = np.union1d(chosen, chosen - 1)
    larger = replace(moments, effect=replace(effect, matrices=grown), rows=rows[near_rows])
    run = contacts(larger, np.zeros(len(near_rows), np.bool_))
    is_near = np.zeros(len(rows), np.bool_)
    if run is not None:
        is_near[np.isin(moments.indices[rows], run.indices)] = True
    return grazes & (is_near | np.concatenate([[False], is_near[:-1]]))


def _meets(boxes: F64, bodies: F64, reach: float) -> Bool:
    """Mask (n,): box of ``boxes`` (n, 2, 3), enlarged by ``reach`` on all sides, meets that of
    ``bodies`` (n, 2, 3) at the row or at the row before; False at the first row."""
    both = []
    for part in (slice(None, -1), slice(1, None)):
        low = boxes[part, 0] - reach <= bodies[part, 1]
        high = boxes[part, 1] + reach >= bodies[part, 0]
        both.append((low & high).all(axis=1))
    return np.concatenate([[False], both[0] | both[1]])


def follow_on(moments: Moments) -> Bool:
    """Mask (n,) of rows whose row and sample index follow the row before by 1; the first: False."""
    rows = moments.rows
    steps = (np.diff(rows) == 1) & (np.diff(moments.indices[rows]) == 1)
    return np.concatenate([[False], steps])
