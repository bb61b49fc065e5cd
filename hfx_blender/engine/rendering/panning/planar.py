# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on a flat layout: the phantom sensation of a tactile pad.

Schneider et al., UIST 2015: Delaunay triangulation of the actuators, the virtual actuator's
barycentric coordinates in its triangle, and a law from these to gains.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from .complex import ActuatorComplex, merged_places
from .laws import Law, gain

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

_FLATTEST: Final = 1e-6
"""Width over length of a layout that counts as a line."""


class PlanarPanning:
    """Between the actuators of a flat pad; beyond their hull, its nearest place is shown.

    Parameters
    ----------
    positions : (A, 2) float64
        Metres. One actuator, two, actuators on a line or at one place will do.
    law : {"linear", "log", "power"}
    """

    def __init__(self, positions: F64, law: Law = "log") -> None:
        self._law = law
        self._complex = _triangulated(np.asarray(positions, np.float64))

    def gains(self, points: F64) -> F64:
        """Gains of the actuators, (n, A), for places on the pad, (n, 2) metres."""
        return gain(self._complex.shares(_lifted(np.asarray(points, np.float64)))[0], self._law)


def _lifted(points: F64) -> F64:
    return np.column_stack((points, np.zeros(len(points))))


def _triangulated(positions: F64) -> ActuatorComplex:
    places, place_of = merged_places(positions)
    return ActuatorComplex(_lifted(places), simplices_of(places), place_of)


def simplices_of(places: F64) -> I64:
    """Triangles of distinct flat places (P, 2); edges along a line, or one point, as (S, 3)."""
    if len(places) == 1:
        return np.zeros((1, 3), np.int64)
    centred = places - places.mean(axis=0)
    _, extents, axes = np.linalg.svd(centred, full_matrices=False)
    if len(places) == 2 or extents[1] <= _FLATTEST * extents[0]:
        order = np.argsort(centred @ axes[0], kind="stable")
        return np.column_stack((order[:-1], order[1:], order[1:])).astype(np.int64)
    from scipy.spatial import Delaunay

    triangles: I64 = Delaunay(centred / extents[0]).simplices.astype(np.int64)
    return triangles
