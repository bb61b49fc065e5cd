# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion between two samples, from the samples around them.

Each side is continued as it moves, by a parabola through its last three samples. Where both
continuations arrive at the other side's sample, motion is smooth; where neither does, it turns in
between, at the moment at which they are nearest to each other: a ball that bounces.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool

NEIGHBOURS: Final = 2
"""Samples on either side of an interval, besides its ends, that its path depends on."""

OVERLAP: Final = 2 * NEIGHBOURS + 1
"""Samples that a block shares with the one after it, at most."""

_NOISE: Final = 5e-5  # metres, and entries of matrices: less beside a path is none
_SMOOTH: Final = 0.3  # of the second differences: a larger third one is a turn
_STEADY: Final = 0.5  # of the first difference: a larger second one is not continued over a turn
_MEETS: Final = 0.2  # of a step: continuations that stay farther apart are of a jump
_MOMENTS: Final = 65  # at which the nearest one is looked for


_NODES: Final = np.arange(4) / 3.0
"""Shares of a sample interval at which a path is evaluated exactly; a cubic joins the positions."""

_CUBICS: Final = np.linalg.inv(np.vander(_NODES))  # of each node: 1 there, 0 at the others


class Path:
    """Motion of N rows of D values over an interval, 0 at its start and 1 at its end.

    Parameters
    ----------
    before, after : list of (N, D) float64
        Values at the interval's start and the samples before it, at its end and those after it,
        the nearest first: 1 to 3 each. Each of the N rows moves on its own.
    """

    def __init__(self, before: list[F64], after: list[F64]) -> None:
        self._is_still = all((each == before[0]).all() for each in after + before[1:])
        self._nodes, turns = _smooth(before, after)
        self._turns = turns[:0]
        if len(turns) and min(len(before), len(after)) > 1:
            self._left = _Leg([each[turns] for each in before], is_steady=True)
            self._right = _Leg([each[turns] for each in after], is_steady=True)
            self._turn, meets = _turn(self._left, self._right)
            self._turns, self._meets = turns, meets[:, None]

    def at(self, shares: F64) -> F64:
        """Values (S, N, D) at shares (S,)."""
        if self._is_still:
            return np.broadcast_to(self._nodes[0], (len(shares), *self._nodes.shape[1:]))
        basis = np.vander(shares, len(_NODES)) @ _CUBICS
        found: F64 = np.tensordot(basis, self._nodes, axes=1)
        if len(self._turns):
            s = shares[:, None, None]
            legs = self._left.at(s), self._right.at(1.0 - s)
            bent = np.where(s <= self._turn[:, None], *legs)
            found[:, self._turns] = np.where(self._meets, bent, found[:, self._turns])
        return found


def _smooth(before: list[F64], after: list[F64]) -> tuple[F64, I64]:
    """Places (4, N, D) at the nodes, and which rows turn: at these, those of a straight way."""
    start, end = before[0], after[0]
    s = _NODES[:, None, None]
    found: F64 = start + s * (end - start)
    if len(before) == len(after) == 1:
        return found, np.zeros(0, np.int64)
    left, right = _Leg(before), _Leg(after)
    # A parabola over a turn of its own side is no continuation: the straighter side is right then.
    differ = _length(left.change - right.change) > _SMOOTH * np.maximum(left.bend, right.bend)
    differ &= _length(left.change - right.change) > _NOISE
    reaches_end = _length(end - left.at(1.0)) <= _SMOOTH * left.bend + _NOISE
    reaches_end &= (len(before) > 1) & ~(differ & (left.bend > right.bend))
    reaches_start = _length(start - right.at(1.0)) <= _SMOOTH * right.bend + _NOISE
    reaches_start &= (len(after) > 1) & ~(differ & (right.bend >= left.bend))
    from_left = left.at(s) + s * (end - left.at(1.0))
    from_right = right.at(1.0 - s) + (1.0 - s) * (start - right.at(1.0))
    both = from_left + s * (from_right - from_left)
    found = np.where(reaches_end[:, None], from_left, found)
    found = np.where(
        reaches_start[:, None], np.where(reaches_end[:, None], both, from_right), found
    )
    return found, np.flatnonzero(~(reaches_end | reaches_start))


class _Leg:
    """Motion on one side of an interval, continued into it."""

    def __init__(self, samples: list[F64], *, is_steady: bool = False) -> None:
        self.start = samples[0]
        self.step = samples[0] - samples[1] if len(samples) > 1 else np.zeros_like(samples[0])
        self.change = np.zeros_like(self.start)
        if len(samples) > 2:
            self.change = self.step - (samples[1] - samples[2])
        if is_steady:
            is_uneven = _length(self.change) > _STEADY * _length(self.step)
            self.change = np.where(is_uneven[:, None], 0.0, self.change)
        self.bend = _length(self.change)

    def at(self, share: F64 | float) -> F64:
        """Values at shares of the interval from this leg's own end."""
        values: F64 = self.start + share * self.step + 0.5 * share * (share + 1.0) * self.change
        return values


def _turn(left: _Leg, right: _Leg) -> tuple[F64, Bool]:
    """Shares (N,) at which two legs are nearest to each other, and whether they meet there."""
    moments = np.linspace(0.0, 1.0, _MOMENTS)[:, None, None]
    apart = _length(left.at(moments) - right.at(1.0 - moments))
    nearest = apart.argmin(axis=0)
    turn = moments[nearest, 0, 0]
    # One step of Newton's method on the squared distance, the legs taken as straight.
    small = 0.5 / (_MOMENTS - 1)
    low, high = turn - small, turn + small
    apart_low = left.at(low[:, None]) - right.at(1.0 - low[:, None])
    way = left.at(high[:, None]) - right.at(1.0 - high[:, None]) - apart_low
    squared = np.einsum("nd,nd->n", way, way)
    back = -np.einsum("nd,nd->n", way, apart_low) / np.where(squared > 0.0, squared, 1.0)
    turn = np.clip(low + np.clip(back, -1.0, 2.0) * 2.0 * small, 0.0, 1.0)
    longest = np.maximum(_length(left.step), _length(right.step))
    return turn, apart[nearest, np.arange(len(nearest))] <= _MEETS * longest


def _length(values: F64) -> F64:
    length: F64 = np.sqrt(np.square(values).sum(axis=-1))
    return length
