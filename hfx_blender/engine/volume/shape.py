# SPDX-License-Identifier: GPL-3.0-or-later
"""Interface of haptic volumes, and the falloff from the boundary to the core."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from ..arrays import F64, Bool


class Shape(Protocol):
    """A closed solid in *shape space*. Points are (3, N) float64, one row a coordinate.

    The boundary belongs to the solid. No method raises on NaN points: they are outside.
    """

    @property
    def bounds(self) -> F64:
        """Axis-aligned box, (2, 3): lowest and highest corner."""

    def contains(self, points: F64) -> Bool:
        """Test points for being inside or on the boundary, (N,) bool."""

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """World-space distance to the boundary of points that are inside, (N,) metres.

        ``to_world`` is the (4, 4) placing matrix, finite. 0 outside and for NaN.
        """


class FalloffKind(StrEnum):
    """Shape of the rise of strength from the boundary inwards."""

    NONE = "none"
    LINEAR = "linear"
    SMOOTH = "smooth"


@dataclass(frozen=True)
class Falloff:
    """Full strength in the core, falling to nothing at the boundary.

    ``share`` is the part of the way from boundary to core over which strength rises:
    1 peaks only at the core, 0 (or kind NONE) is full strength everywhere inside.
    """

    kind: FalloffKind = FalloffKind.NONE
    share: float = 1.0

    @property
    def is_flat(self) -> bool:
        """Full strength everywhere inside."""
        return self.kind is FalloffKind.NONE or self.share <= 0.0

    @property
    def precision(self) -> type[np.floating[Any]]:
        """Floating-point type of weights: without falloff, half the memory suffices."""
        return np.float32 if self.is_flat else np.float64

    def weight(self, rise: F64) -> F64:
        """Contact weight (N,) in 0..1 of points inside.

        ``rise`` is their share of the way from the boundary, 0, to the core, 1.
        """
        if self.is_flat:
            return np.ones_like(rise)
        t = np.clip(rise, 0.0, self.share) / self.share
        if self.kind is FalloffKind.SMOOTH:
            t = t * t * (3.0 - 2.0 * t)
        return t
