# SPDX-License-Identifier: GPL-3.0-or-later
"""Interface of haptic volumes, and the falloff of weight from core to boundary."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from ..arrays import F64, Bool


class Shape(Protocol):
    """A closed solid in *shape space*; points are (3, N) float64, one row for each axis.

    The boundary belongs to the solid. NaN points are outside and raise nothing.
    """

    @property
    def bounds(self) -> F64:
        """Axis-aligned box, (2, 3): lowest and highest corner, shape space."""

    def contains(self, points: F64) -> Bool:
        """Test points for being inside or on the boundary, (N,) bool."""

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """World-space distance of inner points to the boundary, (N,) metres.

        ``to_world`` is the (4, 4) placing matrix, finite. 0 outside and for NaN.
        """


class FalloffKind(StrEnum):
    """Profile of the weight from the boundary inwards."""

    NONE = "none"
    LINEAR = "linear"
    SMOOTH = "smooth"


@dataclass(frozen=True)
class Falloff:
    """Weight of 1 in the core, falling to 0 at the boundary.

    ``share`` is the part of the way from boundary to core over which the weight rises: 1 reaches 1
    only at the core; 0, as kind NONE, is 1 everywhere inside.
    """

    kind: FalloffKind = FalloffKind.NONE
    share: float = 1.0

    @property
    def is_flat(self) -> bool:
        """True for a weight of 1 everywhere inside: kind NONE or share 0."""
        return self.kind is FalloffKind.NONE or self.share <= 0.0

    @property
    def precision(self) -> type[np.floating[Any]]:
        """NumPy type of weights: float32 without falloff, to save memory, else float64."""
        return np.float32 if self.is_flat else np.float64

    def weight(self, rise: F64) -> F64:
        """Contact weights (N,) in 0..1 of inner points: linear or smoothstep up to ``share``.

        ``rise`` (N,) is each point's share of the way from the boundary (0) to the core (1).
        """
        if self.is_flat:
            return np.ones_like(rise)
        t = np.clip(rise, 0.0, self.share) / self.share
        if self.kind is FalloffKind.SMOOTH:
            t = t * t * (3.0 - 2.0 * t)
        return t
