# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion between two samples, from the samples around them.

Each side is continued as it moves, by a parabola through its last three samples. Where both
continuations arrive at the other side's sample, motion is smooth; where neither does, it turns in
between, at the moment at which they are nearest to each other: a ball that bounces.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64

NEIGHBOURS: Final = 2
"""Samples on either side of an interval, besides its ends, that its path depends on."""

OVERLAP: Final = 2 * NEIGHBOURS + 1
"""Samples that a block shares with the one after it, at most."""

_NOISE: Final = 2e-6  # metres, and entries of matrices: rounding of Blender's float32
_SMOOTH: Final = 0.3  # of the second differences: a larger third one is a turn
_STEADY: Final = 0.5  # of the first difference: a larger second one is not continued over a turn
_MEETS: Final = 0.2  # of a step: continuations that stay farther apart are of a jump
_MOMENTS: Final = 65  # at which the nearest one is looked for


def between(before: list[F64], after: list[F64], shares: F64) -> F64:
    """Values (S, N, D) at shares (S,) of an interval, 0 at its start and 1 at its end.

    Parameters
    ----------
    before, after : list of (N, D) float64
        Values at the interval's start and the samples before it, at its end and those after it,
        the nearest first: 1 to 3 each. Each of the N rows moves on its own.
    """
    start, end = before[0], after[0]
    s = shares[:, None, None]
    straight: F64 = start + s * (end - start)
    if len(before) == len(after) == 1:
        return straight
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
    found = np.where(reaches_end[:, None], from_left, straight)
    both = from_left + s * (from_right - from_left)
    found = np.where(
        reaches_start[:, None], np.where(reaches_end[:, None], both, from_right), found
    )
    turns = np.flatnonzero(~(reaches_end | reaches_start))
    if len(turns) and min(len(before), len(after)) > 1:
        found[:, turns] = _turning(
            _Leg([each[turns] for each in before], is_steady=True),
            _Leg([each[turns] for each in after], is_steady=True),
            s,
            straight[:, turns],
        )
    return found


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


def _turning(left: _Leg, right: _Leg, s: F64, straight: F64) -> F64:
    """Paths (S, N, D) that change from one leg to the other where these are nearest."""
    moments = np.linspace(0.0, 1.0, _MOMENTS)[:, None, None]
    apart = _length(left.at(moments) - right.at(1.0 - moments))
    nearest = apart.argmin(axis=0)
    which = np.arange(len(nearest))
    turn = moments[nearest, 0, 0]
    # One step of Newton's method on the squared distance, the legs taken as straight.
    small = 0.5 / (_MOMENTS - 1)
    low, high = turn - small, turn + small
    apart_low = left.at(low[:, None]) - right.at(1.0 - low[:, None])
    way = left.at(high[:, None]) - right.at(1.0 - high[:, None]) - apart_low
    squared = np.einsum("nd,nd->n", way, way)
    back = -np.einsum("nd,nd->n", way, apart_low) / np.where(squared > 0.0, squared, 1.0)
    turn = np.clip(low + np.clip(back, -1.0, 2.0) * 2.0 * small, 0.0, 1.0)
    path = np.where(s <= turn[:, None], left.at(s), right.at(1.0 - s))
    longest = np.maximum(_length(left.step), _length(right.step))
    meets = apart[nearest, which] <= _MEETS * longest
    return np.where(meets[:, None], path, straight)


def _length(values: F64) -> F64:
    length: F64 = np.sqrt(np.square(values).sum(axis=-1))
    return length
