# SPDX-License-Identifier: GPL-3.0-or-later
"""Opaque colours of an avatar's vertices, for the demo's pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.colouring import COLOURS, Spread
from hfx_blender.engine.samples import Sample

from ..felt_shares import SKIN, felt_shares


def avatar_colours(
    samples: Iterable[Sample],
    spreads: Mapping[str, Spread],
    vertex_counts: Mapping[str, int],
    contact_effects: frozenset[str] = frozenset(),
) -> F64:
    """Colours (A, 3) of an avatar's vertices at one time, linear RGB in 0..1, with bare skin."""
    shares = felt_shares(samples, spreads, vertex_counts, contact_effects)
    colour = sum(share[:, None] * np.array(COLOURS[name]) for name, share in shares.items())
    most = np.max(list(shares.values()), axis=0)
    skin = (1.0 - most)[:, None] * np.array(SKIN)
    return np.clip(skin + colour, 0.0, 1.0)
