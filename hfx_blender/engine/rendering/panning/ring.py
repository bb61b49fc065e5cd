# SPDX-License-Identifier: GPL-3.0-or-later
"""Constant-power panning between neighbours on a belt (ring) or a strip (line).

Politis, Pugliese, Takala (audio-tactile belt): g1 = sqrt(1 - d / D), g2 = sqrt(d / D) at distance d
from the first of two neighbours that are D apart; on a ring both are arcs.
"""

from __future__ import annotations

import numpy as np

from ...arrays import F64
from .complex import merged_places


class RingPanning:
    """Panning around a belt: the two neighbours of a direction share its power.

    Parameters
    ----------
    angles : (A,) float64
        Angles of the actuators seen from the centre, radians. A single actuator plays all
        directions.
    """

    def __init__(self, angles: F64) -> None:
        self._axis = _Axis(_turns(angles), period=1.0)

    def gains(self, points: F64) -> F64:
        """Gains (n, A), squares summing to 1, for angles (n, 1), radians; 0 if not finite."""
        return np.sqrt(self._axis.shares(_turns(points[:, 0])))


class LinePanning:
    """Panning along a strip: the two neighbours of a place share its power; ends play beyond.

    Parameters
    ----------
    positions : (A,) float64
        Along the strip, metres.
    """

    def __init__(self, positions: F64) -> None:
        self._axis = _Axis(positions, period=None)

    def gains(self, points: F64) -> F64:
        """Gains (n, A), squares summing to 1, for places (n, 1), m; 0 if not finite."""
        return np.sqrt(self._axis.shares(points[:, 0]))


def _turns(angles: F64) -> F64:
    """Angles in radians as turns, 0 included to 1 excluded."""
    return np.asarray(np.mod(angles / (2.0 * np.pi), 1.0))


class _Axis:
    """Positions (A,) on an axis, closed with a period or open."""

    def __init__(self, positions: F64, period: float | None) -> None:
        places, place_of = merged_places(positions[:, None])
        order = np.argsort(places[:, 0], kind="stable")
        self._places = places[order, 0]
        self._place_of = np.argsort(order)[place_of]
        self._period = period

    def shares(self, values: F64) -> F64:
        """Shares (n, A), linear, of the two neighbours of each value (n,); 0 if not finite.

        Beyond the ends of an open axis the end has share 1; actuators at one place divide a share.
        """
        count = len(self._places)
        shares = np.zeros((len(values), count))
        rows = np.flatnonzero(np.isfinite(values))
        at = values[rows]
        after = np.searchsorted(self._places, at, side="right")
        if self._period is None:
            before, after = np.maximum(after - 1, 0), np.minimum(after, count - 1)
            gap = self._places[after] - self._places[before]
            way = at - self._places[before]
        else:
            before, after = (after - 1) % count, after % count
            # On a ring the last place is before the first.
            gap = np.mod(self._places[after] - self._places[before], self._period)
            gap[gap == 0.0] = self._period  # a single actuator
            way = np.mod(at - self._places[before], self._period)
        share = np.clip(np.divide(way, gap, out=np.zeros_like(way), where=gap > 0.0), 0.0, 1.0)
        np.add.at(shares, (rows, before), 1.0 - share)
        np.add.at(shares, (rows, after), share)
        crowd = np.bincount(self._place_of, minlength=count)
        return np.asarray((shares / crowd)[:, self._place_of])
