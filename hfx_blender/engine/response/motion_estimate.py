# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion between two samples, estimated from neighbouring samples.

A parabola through its last three samples extrapolates each side. If an extrapolation reaches the
other side's sample, motion is smooth. If neither does, motion turns at the moment at which both
extrapolations are nearest: a bouncing ball.
"""

from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool

NEIGHBOURS: Final = 2
"""Samples on either side of an interval, besides its ends, that an estimate depends on."""

OVERLAP: Final = 2 * NEIGHBOURS + 1
"""Largest number of samples shared by a block and the next block."""

_NOISE: Final = 5e-5  # metres, and matrix entries: smaller deviations are noise
_SMOOTH: Final = 0.3  # fraction of the second differences: a larger third difference is a turn
_STEADY: Final = 0.5  # fraction of the first difference: a larger second one stops at a turn
_MEETS: Final = 0.2  # fraction of a step: extrapolations farther apart belong to a jump
_MOMENTS: Final = 65  # of the search for the nearest moment

_NODES: Final = np.arange(4) / 3.0
"""Fractions of an interval with exact evaluation; cubics interpolate between them."""

_CUBICS: Final = np.linalg.inv(np.vander(_NODES))  # basis: 1 at one node, 0 at the others


class MotionEstimate:
    """Motion of N rows of D values over an interval, from 0 at the start to 1 at the end.
    ``before`` are values (N, D) at the interval's start and at samples before, ``after`` at the end
    and at samples after, the nearest first: 1 to 3 each. Rows move independently."""

    def __init__(self, before: list[F64], after: list[F64]) -> None:
        self._is_still = all((values == before[0]).all() for values in after + before[1:])
        self._nodes, turns = _smooth(before, after)
        self._turns = turns[:0]
        if len(turns) and min(len(before), len(after)) > 1:
            self._left = _Leg([values[turns] for values in before], is_steady=True)
            self._right = _Leg([values[turns] for values in after], is_steady=True)
            self._turn, meets = _turn(self._left, self._right)
            self._turns, self._meets = turns, meets[:, None]

    def at(self, shares: F64) -> F64:
        """Values (S, N, D) at fractions (S,) of the interval; equal samples give the constant,
        read-only."""
        if self._is_still:
            return np.broadcast_to(self._nodes[0], (len(shares), *self._nodes.shape[1:]))
        # Two parabolas blended by a linear weight are a cubic, which four nodes determine exactly.
        basis = np.vander(shares, len(_NODES)) @ _CUBICS
        values: F64 = np.tensordot(basis, self._nodes, axes=1)
        if len(self._turns):
            s = shares[:, None, None]
            legs = self._left.at(s), self._right.at(1.0 - s)
            # Before the turn the left leg counts, after it the right one; legs that do not meet are
            # a jump.
            bent = np.where(s <= self._turn[:, None], *legs)
            values[:, self._turns] = np.where(self._meets, bent, values[:, self._turns])
        return values


def _smooth(before: list[F64], after: list[F64]) -> tuple[F64, I64]:
    """Values (4, N, D) at fractions 0, 1/3, 2/3, 1, and ascending indices of turning rows: neither
    side's parabola reaches the other end, so their values are linear. ``before`` and ``after``:
    nearest sample first. With one sample each, all rows are linear, and the indices empty."""
    start, end = before[0], after[0]
    s = _NODES[:, None, None]
    values: F64 = start + s * (end - start)
    if len(before) == len(after) == 1:
        return values, np.zeros(0, np.int64)
    left, right = _Leg(before), _Leg(after)
    # A parabola over a turn on its own side is no extrapolation: the straighter side is right.
    differ = _length(left.change - right.change) > _SMOOTH * np.maximum(left.bend, right.bend)
    differ &= _length(left.change - right.change) > _NOISE
    reaches_end = _length(end - left.at(1.0)) <= _SMOOTH * left.bend + _NOISE
    reaches_end &= (len(before) > 1) & ~(differ & (left.bend > right.bend))
    reaches_start = _length(start - right.at(1.0)) <= _SMOOTH * right.bend + _NOISE
    reaches_start &= (len(after) > 1) & ~(differ & (right.bend >= left.bend))
    # Each extrapolation is corrected linearly to end at the known sample; two valid ones are
    # blended.
    from_left = left.at(s) + s * (end - left.at(1.0))
    from_right = right.at(1.0 - s) + (1.0 - s) * (start - right.at(1.0))
    both = from_left + s * (from_right - from_left)
    values = np.where(reaches_end[:, None], from_left, values)
    values = np.where(
        reaches_start[:, None], np.where(reaches_end[:, None], both, from_right), values
    )
    return values, np.flatnonzero(~(reaches_end | reaches_start))


class _Leg:
    """Motion on one side of an interval, extrapolated into the interval."""

    def __init__(self, samples: list[F64], *, is_steady: bool = False) -> None:
        self.start = samples[0]
        self.step = samples[0] - samples[1] if len(samples) > 1 else np.zeros_like(samples[0])
        self.change = np.zeros_like(self.start)
        if len(samples) > 2:
            self.change = self.step - (samples[1] - samples[2])
        if is_steady:
            # Strong acceleration right before a turn is part of the turn itself: continue at
            # constant velocity.
            is_uneven = _length(self.change) > _STEADY * _length(self.step)
            self.change = np.where(is_uneven[:, None], 0.0, self.change)
        self.bend = _length(self.change)

    def at(self, share: F64 | float) -> F64:
        """Values at ``share`` of the interval, from 0 at this leg's own end to 1 at the other end,
        by a parabola; (N, D), with more axes if ``share`` has more."""
        values: F64 = self.start + share * self.step + 0.5 * share * (share + 1.0) * self.change
        return values


def _turn(left: _Leg, right: _Leg) -> tuple[F64, Bool]:
    """Fractions (N,) from the left at which two legs are nearest, and a mask (N,): nearer than a
    fifth of the longer step, else a jump."""
    moments = np.linspace(0.0, 1.0, _MOMENTS)[:, None, None]
    apart = _length(left.at(moments) - right.at(1.0 - moments))
    nearest = apart.argmin(axis=0)
    turn = moments[nearest, 0, 0]
    # One step of Newton's method on the squared distance, with linear legs.
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
    """Euclidean length of the last axis."""
    return np.asarray(np.sqrt(np.square(values).sum(axis=-1)))
