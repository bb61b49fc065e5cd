# SPDX-License-Identifier: GPL-3.0-or-later
"""Strengths and colours of all haptic samples of one time at the vertices of an avatar."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.colouring import COLD, COLOURS, Spread, colour_name, strengths
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import Sample

SKIN: Final = (0.62, 0.6, 0.58)
"""Colour of bare skin, linear RGB."""


def felt_shares(
    samples: Iterable[Sample],
    spreads: Mapping[str, Spread],
    vertex_counts: Mapping[str, int],
    contact_effects: frozenset[str] = frozenset(),
) -> dict[str, F64]:
    """Displayed strength of each modality at each vertex of an avatar, (A,), 1 for the full colour.

    Keys are names of :data:`COLOURS`; zeros for a modality without samples. The square root makes
    the lower half of the strengths visible.
    """
    count = len(next(iter(spreads.values())).nearest)
    totals: dict[str, F64] = {}
    for sample in samples:
        stream = sample.stream
        is_contact = stream.effect_id in contact_effects
        at_model = np.zeros(vertex_counts[stream.model_id])
        at_model[sample.vertices] = strengths(sample, is_contact)
        spread = spreads[stream.model_id]
        name = colour_name(sample, is_contact)
        at_avatar = np.einsum("ij,ij->i", at_model[spread.nearest], spread.shares)
        totals[name] = totals[name] + at_avatar if name in totals else at_avatar
    nothing = np.zeros(count)
    return {
        name: np.sqrt(totals[name]) if name in totals else nothing for name in (*MODALITIES, COLD)
    }


def avatar_colours(
    samples: Iterable[Sample],
    spreads: Mapping[str, Spread],
    vertex_counts: Mapping[str, int],
    contact_effects: frozenset[str] = frozenset(),
) -> F64:
    """Colours (A, 3) of an avatar's vertices at one time, linear RGB in 0..1, with bare skin."""
    shares = felt_shares(samples, spreads, vertex_counts, contact_effects)
    shares = {name: np.minimum(share, 1.0) for name, share in shares.items()}
    colour = sum(share[:, None] * np.array(COLOURS[name]) for name, share in shares.items())
    most = np.max(list(shares.values()), axis=0)
    skin = (1.0 - most)[:, None] * np.array(SKIN)
    return np.clip(skin + colour, 0.0, 1.0)
