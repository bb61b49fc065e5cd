# SPDX-License-Identifier: GPL-3.0-or-later
"""Between which actuators a phantom sensation may be: on one limb, and not far apart on the skin.

Whatever a scheme asks for, no two actuators play one place together that are on different limbs or
more than 200 mm of skin apart: over such a gap nobody feels one sensation between them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ...body.model import PerceptualModel
from ...body.parts import PARTS
from ...body.skin_distance import SkinDistances

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

MAX_SPAN_M: Final = 0.2
"""Farthest that two neighbours may be apart, along the skin."""

_SURELY_NEAR_M: Final = 0.1
"""Skin between two places this close in space is not measured."""

_LIMBS: Final = {
    "head": 0,
    "torso": 1,
    **dict.fromkeys(("upper_arm", "forearm", "hand_dorsum", "hand_palm", "fingers"), 2),
    **dict.fromkeys(("upper_leg", "lower_leg", "foot_dorsum", "foot_sole"), 3),
}


def limbs_of(model: PerceptualModel) -> I64:
    """A number for each vertex: that of its limb, or of the head or torso, (V,)."""
    kind = np.array([_LIMBS[part] for part in PARTS])[model.part]
    is_trunk = kind <= 1  # one piece from left to right
    return np.asarray(kind * 3 + np.where(is_trunk, 0, model.side), np.int64)


def joined_on_skin(model: PerceptualModel, centres: F64, anchors: I64) -> Bool:
    """Which pairs of A actuators are neighbours enough to share a place, (A, A).

    Parameters
    ----------
    model : PerceptualModel
    centres : (A, 3) float64
        Rest space, metres.
    anchors : (A,) int64
        The vertex under each actuator.
    """
    straight_m = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    limb = limbs_of(model)[anchors]
    found = (straight_m <= MAX_SPAN_M) & (limb[:, None] == limb[None])
    doubtful = found & (straight_m > _SURELY_NEAR_M)
    skin: SkinDistances | None = None
    for k in np.flatnonzero(np.triu(doubtful).any(axis=1)):
        skin = skin or SkinDistances(model.vertices, model.triangles)
        others = np.flatnonzero(doubtful[k] & (np.arange(len(centres)) > k))
        reached, _ = skin.around(skin.nearest(centres[k]), MAX_SPAN_M)
        is_far = ~np.isin(anchors[others], reached)
        found[k, others[is_far]] = found[others[is_far], k] = False
    return np.asarray(found)


def parted(gains: F64, is_joined: Bool) -> F64:
    """Gains (n, A) of which no two actuators that are not joined play together.

    Of two that are not, the weaker is silent, and the stronger fades out until both are as
    strong: on a gap between two, from a quarter of the way to the middle. So nothing jumps.
    """
    one, other = np.nonzero(np.triu(~is_joined, 1))
    if not len(one):
        return gains
    power = gains * gains
    both = (gains[:, one] > 0.0) & (gains[:, other] > 0.0)
    is_shared = both.any(axis=0)
    if not is_shared.any():
        return gains
    share = np.ones_like(gains)
    for a, b in zip(one[is_shared], other[is_shared], strict=True):
        total = power[:, a] + power[:, b]
        lead = np.divide(power[:, a] - power[:, b], total, out=0.0 * total, where=total > 0.0)
        meets = (gains[:, a] > 0.0) & (gains[:, b] > 0.0)
        share[:, a] = np.where(meets, np.minimum(share[:, a], 2.0 * lead), share[:, a])
        share[:, b] = np.where(meets, np.minimum(share[:, b], -2.0 * lead), share[:, b])
    return np.asarray(gains * np.clip(share, 0.0, 1.0))
