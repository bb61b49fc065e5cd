# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning of sources over loudspeakers, by the rendering schemes of haptic devices."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from ...errors import UsageError
from ..arrays import F64
from ..rendering.panning.constant_power import RingPanning, VectorBasePanning
from .hearing import Hearing
from .layouts import LoudspeakerLayout

Scheme = Literal["vbap", "ring"]
SCHEMES: Final[tuple[Scheme, ...]] = ("vbap", "ring")


class Panner:
    """Gains of loudspeakers for places around a listener.

    ``scheme``: vector-base amplitude panning, or constant power between neighbours on a flat ring.
    Raises UsageError for a scheme that does not fit the layout.
    """

    def __init__(
        self, layout: LoudspeakerLayout, hearing: Hearing, scheme: Scheme = "vbap"
    ) -> None:
        self._layout = layout
        self.hearing = hearing
        self._is_flat = layout.is_flat
        self._scheme: VectorBasePanning | RingPanning
        if scheme == "ring":
            if not layout.is_flat:
                raise UsageError(f"loudspeakers '{layout.name}': a ring must be flat; use vbap")
            self._scheme = RingPanning(np.radians(layout.azimuths_deg))
        else:
            try:
                self._scheme = VectorBasePanning(layout.directions)
            except ValueError:
                raise UsageError(
                    f"loudspeakers '{layout.name}': those that are not all at ear height must "
                    "surround more than a plane"
                ) from None

    def gains(self, places_m: F64) -> tuple[F64, F64]:
        """Gains of each loudspeaker for the dry part (n, C), and gain of the wet part (n,).

        Places (n, 3) are in listener space; a place that is not finite is silent. Near the head
        (within ``spread_m``) the sound spreads over all loudspeakers.
        """
        known = np.isfinite(places_m).all(axis=1)
        places = np.where(known[:, None], places_m, 0.0)
        distances = np.where(known, np.linalg.norm(places, axis=1), np.inf)
        dry, wet = self.hearing.gains(distances)
        directions = places[:, :2] if self._is_flat else places
        lengths = np.linalg.norm(directions, axis=1)
        if isinstance(self._scheme, RingPanning):
            panned = self._scheme.gains(np.arctan2(directions[:, 1], directions[:, 0])[:, None])
        else:
            panned = self._scheme.gains(directions)
        # Near the head the sound spreads over all loudspeakers, so that a source passing through
        # does not jump from one side to the opposite one.
        share = np.clip(1.0 - lengths / self.hearing.spread_m, 0.0, 1.0)[:, None]
        everywhere = 1.0 / len(self._layout)
        # Mixing powers keeps the loudness constant.
        power = (1.0 - share) * np.square(panned) + share * everywhere
        return np.sqrt(power) * dry[:, None], wet
