# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning by distance alone: nearest actuator, and Gaussian splatting."""

from __future__ import annotations

import numpy as np

from ...arrays import F64

_SPREAD = 4.0
"""Cut-off of a Gaussian in standard deviations (3e-4 of its peak)."""


class NearestPanning:
    """Panning to the nearest actuator alone.

    Schneider et al., UIST 2015, for dense grids. Output jumps half way between two actuators, so
    glides need another scheme.

    Parameters
    ----------
    positions : (A, D) float64
        Metres; the first of equally near actuators plays.
    """

    def __init__(self, positions: F64) -> None:
        self._positions = np.asarray(positions, np.float64)

    def gains(self, points: F64) -> F64:
        """Gains (n, A) for places (n, D), m: 1 at the nearest actuator; 0 if not finite."""
        distances = _distances(np.asarray(points, np.float64), self._positions)
        gains = np.zeros_like(distances)
        rows = np.flatnonzero(np.isfinite(distances).all(axis=1))
        gains[rows, np.argmin(distances[rows], axis=1)] = 1.0
        return gains


class GaussianSplatting:
    """Panning with gain exp(-d^2 / (2 sigma^2)) at distance d.

    After the Gaussian footprints of Westover ("Footprint evaluation for volume rendering", SIGGRAPH
    1990).

    Parameters
    ----------
    positions : (A, D) float64
        Metres.
    sigma_m : float
        Standard deviation, > 0. Gains reach 0 smoothly at four standard deviations.
    """

    def __init__(self, positions: F64, sigma_m: float) -> None:
        if not 0.0 < sigma_m < np.inf:
            raise ValueError(f"sigma_m: expected a positive number, got {sigma_m}")
        self._positions = np.asarray(positions, np.float64)
        self._sigma_m = sigma_m

    def gains(self, points: F64) -> F64:
        """Gains (n, A) for places (n, D), m, rescaled to 1 at an actuator, 0 from 4 sigma.

        0 for a place that is not finite.
        """
        ratio = _distances(np.asarray(points, np.float64), self._positions) / self._sigma_m
        floor = np.exp(-0.5 * _SPREAD**2)
        with np.errstate(over="ignore"):
            gains = (np.exp(-0.5 * ratio * ratio) - floor) / (1.0 - floor)
        return np.maximum(np.nan_to_num(gains, nan=0.0), 0.0)


def _distances(points: F64, positions: F64) -> F64:
    """Distances (n, A) of points (n, D) from positions (A, D); NaN for a non-finite point."""
    with np.errstate(invalid="ignore", over="ignore"):
        distances: F64 = np.sqrt(
            sum(
                (points[:, axis, None] - positions[None, :, axis]) ** 2
                for axis in range(positions.shape[1])
            )
        )
    distances[~np.isfinite(points).all(axis=1)] = np.nan
    return distances
