# SPDX-License-Identifier: GPL-3.0-or-later
"""Keyframe curves, sampled at many times at once: constant, linear and Bezier segments.

Curves whose keys stand at the same frames are sampled together, as the channels of a baked
motion are. Before the first key and after the last, a curve keeps its value.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32

_KEY_WIDTH = 1e-4
"""Frames before a key at which Blender already takes its value."""

_STEPS = 40
_PRECISION = 1e-10


class Interpolation(IntEnum):
    """Interpolation of a curve between one key and the next."""

    CONSTANT = 0
    LINEAR = 1
    BEZIER = 2


@dataclass(frozen=True, eq=False)
class KeyedCurves:
    """Curves with keys at the same frames and the same interpolation between them.

    ``left`` and ``right`` are the handles (frame, value) of each key; None without Bezier
    segments.
    """

    frames: F64  # (K,) ascending
    interpolation: I32  # (K,) of the segment that begins at each key
    values: F64  # (C, K)
    left: F64 | None = None  # (C, K, 2)
    right: F64 | None = None  # (C, K, 2)

    @cached_property
    def _by_key(self) -> F64:
        """Values, (K, C)."""
        return np.ascontiguousarray(self.values.T)

    def sample(self, frames: F64, *, single: bool = False) -> F64:
        """Values at some frames (T,) as (T, C).

        ``single`` computes straight lines in 32 bits and in the order of Blender's own sums, so
        that their values are Blender's bit by bit.
        """
        last = len(self.frames) - 1
        if last == 0:
            return np.repeat(self.values.T, len(frames), axis=0)
        inside = np.clip(frames, self.frames[0], self.frames[-1])
        segment = np.searchsorted(self.frames - _KEY_WIDTH, inside, side="right") - 1
        segment = np.clip(segment, 0, last - 1)
        start, end = self.frames[segment], self.frames[segment + 1]
        length = np.where(end > start, end - start, 1.0)
        share = np.clip((inside - start) / length, 0.0, 1.0)
        kind = self.interpolation[segment]
        # The last key itself belongs to no segment.
        linear = np.where(kind == Interpolation.CONSTANT, 0.0, share)
        linear = np.where(inside >= self.frames[-1] - _KEY_WIDTH, 1.0, linear)[:, None]
        sampled = self._by_key[segment]
        sampled *= 1.0 - linear
        sampled += linear * self._by_key[segment + 1]
        if single:
            between = (kind == Interpolation.LINEAR) & (linear[:, 0] < 1.0)
            rows = np.flatnonzero(between & (inside - start > _KEY_WIDTH))
            ends = self._by_key[segment[rows]], self._by_key[segment[rows] + 1]
            sampled[rows] = _on_lines(inside[rows] - start[rows], length[rows], *ends)
        curved = np.flatnonzero((kind == Interpolation.BEZIER) & (share > 0.0) & (share < 1.0))
        if len(curved):
            sampled[curved] = self._on_bezier(segment[curved], inside[curved])
        return sampled

    def _on_bezier(self, segment: npt.NDArray[np.int64], frames: F64) -> F64:
        """Values within Bezier segments, (n, C)."""
        assert self.left is not None and self.right is not None
        x0, x3 = self.frames[segment][:, None], self.frames[segment + 1][:, None]
        y0, y3 = self._by_key[segment], self._by_key[segment + 1]
        out = self.right[:, segment].transpose(1, 0, 2)
        into = self.left[:, segment + 1].transpose(1, 0, 2)
        x1, y1 = _shortened(x0, y0, out, x3 - x0)
        x2, y2 = _shortened(x3, y3, into, x3 - x0)
        u = _parameter_at(frames[:, None] - x0, x1 - x0, x2 - x0, x3 - x0)
        v = 1.0 - u
        value: F64 = v**3 * y0 + 3 * v**2 * u * y1 + 3 * v * u**2 * y2 + u**3 * y3
        return value


def _on_lines(time: F64, length: F64, first: F64, second: F64) -> F64:
    """Values (n, C) at times (n,) into segments of some lengths, in 32 bits."""
    at, duration = (each.astype(np.float32)[:, None] for each in (time, length))
    begin = first.astype(np.float32)
    found: F64 = ((second.astype(np.float32) - begin) * at / duration + begin).astype(np.float64)
    return found


def _shortened(x: F64, y: F64, handle: F64, length: F64) -> tuple[F64, F64]:
    """A key's handle, no longer in time than its segment, so that a curve never runs back."""
    dx, dy = handle[..., 0] - x, handle[..., 1] - y
    reach = np.abs(dx)
    scale = np.where(reach > length, length / np.where(reach > 0.0, reach, 1.0), 1.0)
    return x + scale * dx, y + scale * dy


def _parameter_at(x: F64, x1: F64, x2: F64, x3: F64) -> F64:
    """Parameter (0..1) at which a monotonic cubic from 0 to ``x3`` has the value ``x``."""
    a, b, c = 3 * x1, 3 * (x2 - 2 * x1), x3 - 3 * x2 + 3 * x1
    low, high = np.zeros(np.broadcast_shapes(x.shape, a.shape)), np.ones(1)
    high = np.ones_like(low)
    u = np.broadcast_to(x / x3, low.shape).copy()
    for _ in range(_STEPS):  # Newton's method, kept within a bracket
        off = ((c * u + b) * u + a) * u - x
        if np.abs(off / x3).max(initial=0.0) < _PRECISION:
            break
        low, high = np.where(off < 0.0, u, low), np.where(off < 0.0, high, u)
        slope = (3 * c * u + 2 * b) * u + a
        step = u - off / np.where(slope > 0.0, slope, 1.0)
        u = np.where((slope > 0.0) & (step > low) & (step < high), step, (low + high) / 2)
    return u
