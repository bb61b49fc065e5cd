# SPDX-License-Identifier: GPL-3.0-or-later
"""Keyframe curves sampled at many times: constant, linear and Bezier segments.

Curves with keys at the same frames (baked channels) are sampled together. Values are constant
before the first and after the last key.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32

_KEY_WIDTH = 1e-4  # frames before a key from which Blender uses the key's value
_STEPS = 40
_PRECISION = 1e-10


class Interpolation(IntEnum):
    """Interpolation from a key to the next."""

    CONSTANT = 0
    LINEAR = 1
    BEZIER = 2


@dataclass(frozen=True, eq=False)
class KeyedCurves:
    """Curves with common key frames and interpolations. ``left`` and ``right`` are handles (frame,
    value) of each key; None without Bezier segments."""

    frames: F64  # (K,) ascending
    interpolation: I32  # (K,) of the segment after each key
    values: F64  # (C, K)
    left: F64 | None = None  # (C, K, 2)
    right: F64 | None = None  # (C, K, 2)

    @cached_property
    def _by_key(self) -> F64:
        """Values (K, C), contiguous."""
        return np.ascontiguousarray(self.values.T)

    def sample(self, frames: F64, *, single: bool = False) -> F64:
        """Values (T, C) at frames (T,), constant beyond the first and last key. ``single``
        evaluates linear segments in float32 and in Blender's order, for bit-identical values."""
        last = len(self.frames) - 1
        if last == 0:
            return np.repeat(self.values.T, len(frames), axis=0)
        clipped = np.clip(frames, self.frames[0], self.frames[-1])
        # A frame just before a key belongs to the key, as in Blender.
        segment = np.searchsorted(self.frames - _KEY_WIDTH, clipped, side="right") - 1
        segment = np.clip(segment, 0, last - 1)
        start, end = self.frames[segment], self.frames[segment + 1]
        length = np.where(end > start, end - start, 1.0)
        share = np.clip((clipped - start) / length, 0.0, 1.0)
        interpolation = self.interpolation[segment]
        # Fraction of the way to the next key: 0 on constant segments.
        linear = np.where(interpolation == Interpolation.CONSTANT, 0.0, share)
        # The last key has no segment of its own: it is the end of the last segment.
        linear = np.where(clipped >= self.frames[-1] - _KEY_WIDTH, 1.0, linear)[:, None]
        sampled = self._by_key[segment]
        sampled *= 1.0 - linear
        sampled += linear * self._by_key[segment + 1]
        if single:
            is_linear = (interpolation == Interpolation.LINEAR) & (linear[:, 0] < 1.0)
            rows = np.flatnonzero(is_linear & (clipped - start > _KEY_WIDTH))
            first, second = (self._by_key[segment[rows] + k].astype(np.float32) for k in (0, 1))
            time = (clipped[rows] - start[rows]).astype(np.float32)[:, None]
            duration = length[rows].astype(np.float32)[:, None]
            sampled[rows] = (second - first) * time / duration + first
        curved = np.flatnonzero(
            (interpolation == Interpolation.BEZIER) & (share > 0.0) & (share < 1.0)
        )
        if len(curved):
            sampled[curved] = self._on_bezier(segment[curved], clipped[curved])
        return sampled

    def _on_bezier(self, segment: npt.NDArray[np.int64], frames: F64) -> F64:
        """Values (n, C) at frames (n,) within the Bezier segments after keys ``segment`` (n,)."""
        assert self.left is not None and self.right is not None
        x0, x3 = self.frames[segment][:, None], self.frames[segment + 1][:, None]
        y0, y3 = self._by_key[segment], self._by_key[segment + 1]
        out = self.right[:, segment].transpose(1, 0, 2)
        into = self.left[:, segment + 1].transpose(1, 0, 2)
        x1, y1 = _shortened(x0, y0, out, x3 - x0)
        x2, y2 = _shortened(x3, y3, into, x3 - x0)
        # Frame to curve parameter first, because a Bezier segment is a curve (frame, value)(u).
        u = _parameter_at(frames[:, None] - x0, x1 - x0, x2 - x0, x3 - x0)
        v = 1.0 - u
        return np.asarray(v**3 * y0 + 3 * v**2 * u * y1 + 3 * v * u**2 * y2 + u**3 * y3)


def _shortened(x: F64, y: F64, handle: F64, length: F64) -> tuple[F64, F64]:
    """Frames and values of handles (..., 2) of keys at (x, y), shortened in both to at most
    ``length`` frames, as in Blender."""
    # Blender shortens handles, so that a segment stays a function of the frame.
    dx, dy = handle[..., 0] - x, handle[..., 1] - y
    reach = np.abs(dx)
    scale = np.where(reach > length, length / np.where(reach > 0.0, reach, 1.0), 1.0)
    return x + scale * dx, y + scale * dy


def _parameter_at(x: F64, x1: F64, x2: F64, x3: F64) -> F64:
    """Parameter 0..1 at which a monotonic cubic from 0 to ``x3``, with handles x1 and x2, has the
    value ``x``; arrays broadcast."""
    a, b, c = 3 * x1, 3 * (x2 - 2 * x1), x3 - 3 * x2 + 3 * x1
    low = np.zeros(np.broadcast_shapes(x.shape, a.shape))
    high = np.ones_like(low)
    # Exact for evenly spaced handles, so that few steps follow for typical keys.
    u = np.broadcast_to(x / x3, low.shape).copy()
    # Newton's method within a shrinking bracket; bisection where a step leaves the bracket.
    for _ in range(_STEPS):
        error = ((c * u + b) * u + a) * u - x
        if np.abs(error / x3).max(initial=0.0) < _PRECISION:
            break
        low, high = np.where(error < 0.0, u, low), np.where(error < 0.0, high, u)
        slope = (3 * c * u + 2 * b) * u + a
        step = u - error / np.where(slope > 0.0, slope, 1.0)
        u = np.where((slope > 0.0) & (step > low) & (step < high), step, (low + high) / 2)
    return u
