# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance cues: gains of the direct and the reverberated part of a source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64

_FADE: Final = 0.1  # of the audible radius, over which a source fades in
FARTHEST_M: Final = 1000.0
_THICKEST: Final = 1e6  # as a multiple of air: silences all but the lowest at once


@dataclass(frozen=True)
class Hearing:
    """Distance model of the listener.

    Politis, Pugliese, Takala: beyond a reference distance a sound is wet, at it dry and wet are
    equal, very close it is dry; beyond a radius of visibility it is silent. Made one continuous
    crossfade of constant power: dry at the listener, wet from twice the reference on.
    """

    reference_m: float = 2.0
    audible_m: float = 8.0  # silence from here on
    spread_m: float = 0.5  # nearer than this, a source comes from more and more loudspeakers
    air: float = 0.0  # absorption of high frequencies, as a multiple of that of air
    with_doppler: bool = False

    def __post_init__(self) -> None:
        for name in ("reference_m", "audible_m", "spread_m"):
            if not 1.0 / FARTHEST_M <= getattr(self, name) <= FARTHEST_M:
                raise ValueError(
                    f"{name}: expected {1.0 / FARTHEST_M:g} to {FARTHEST_M:g}, "
                    f"got {getattr(self, name):g}"
                )
        if not 0.0 <= self.air <= _THICKEST:
            raise ValueError(f"air: expected 0 to {_THICKEST:g}, got {self.air:g}")

    def gains(self, distances_m: F64) -> tuple[F64, F64]:
        """Gains (n,) of the dry and the wet part; the sum of their squares is 1 where audible."""
        angle = 0.25 * np.pi * np.minimum(distances_m / self.reference_m, 2.0)
        audible = (self.audible_m - distances_m) / (_FADE * self.audible_m)
        audible = np.clip(np.nan_to_num(audible), 0.0, 1.0)
        return np.cos(angle) * audible, np.sin(angle) * audible
