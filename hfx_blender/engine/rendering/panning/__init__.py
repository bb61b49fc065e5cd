# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning: a place between actuators is rendered by its neighbours.

Every scheme is a small object made from an actuator layout once, with one method:
``gains(points)`` takes places, (n, D) metres or directions, and yields (n, A) gains.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


class Panning(Protocol):
    """A rendering scheme for one layout of A actuators."""

    def gains(self, points: F64) -> F64:
        """Gain of each actuator for each place, (n, A), never negative.

        A place that is not finite drives nothing.
        """
