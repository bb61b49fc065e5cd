# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF wavelet block codec: adaptive arithmetic code over SPIHT bit planes (decoder).

Sources: ISO/IEC 23090-31, wavelet bands; A. Said and W. Pearlman, "A new, fast, and efficient
image codec based on set partitioning in hierarchical trees", 1996, in one dimension; encoded
files of MPEGGroup, HapticReferenceSoftware.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...engine.arrays import F64

_DIGITS: Final = {
    letter: number
    for number, letter in enumerate(
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
    )
}
_FULL: Final = 1024  # range of the code: 10 binary digits
_HALF: Final = _FULL // 2
_QUARTER: Final = _FULL // 4
_HEADER, _SIGN, _POINT, _CHILDREN, _CHILD, _GRANDCHILDREN, _REFINEMENT = range(7)
"""Contexts of binary decisions, each with an adaptive probability."""

_LOWEST_POINTS: Final = 8  # coefficients without a parent


class _Bits:
    """Decoder of the arithmetic code, one decision per call."""

    def __init__(self, stream: str) -> None:
        self._bits = [
            number >> shift & 1
            for number in map(_DIGITS.__getitem__, stream.rstrip("="))
            for shift in range(5, -1, -1)
        ]
        self._next = 0
        self._code = 0
        for _ in range(_FULL.bit_length() - 1):
            self._code = 2 * self._code + self._digit()
        self._lower, self._upper = 0, _FULL
        self._zeros, self._counts = [8] * 7, [16] * 7

    def _digit(self) -> int:
        """Next binary digit of the stream; 0 after its end, as trailing zeros are not stored."""
        self._next += 1
        return self._bits[self._next - 1] if self._next <= len(self._bits) else 0

    @property
    def is_over(self) -> bool:
        """True if all further decisions are 0."""
        return self._next >= len(self._bits) and self._code == self._lower

    def take(self, kind: int) -> int:
        """Decode the next decision of a context, 0 or 1, and adapt its probability."""
        width = self._upper - self._lower
        share = int(self._zeros[kind] / self._counts[kind] * _FULL + 0.5)
        split = min(max(width * share // _FULL, 1), width - 1)
        self._counts[kind] += 1
        if self._code - self._lower < split:
            decision = 0
            self._upper = self._lower + split
            self._zeros[kind] += 1
        else:
            decision = 1
            self._lower += split
        # Renormalization: double the interval until it spans more than half of the range.
        while True:
            if self._upper <= _HALF:
                off = 0
            elif self._lower >= _HALF:
                off = _HALF
            elif self._lower >= _QUARTER and self._upper <= 3 * _QUARTER:
                off = _QUARTER
            else:
                return decision
            self._lower = 2 * (self._lower - off)
            self._upper = 2 * (self._upper - off)
            self._code = 2 * (self._code - off) + self._digit()

    def number(self, length: int) -> int:
        """Decode a whole number of the header, least significant digit first."""
        return sum(self.take(_HEADER) << digit for digit in range(length))


def decode(stream: str, count: int) -> F64:
    """Decode the wavelet coefficients of a block, (count,), coarse to fine.

    ``stream`` are base64 digits of any number; an empty stream is silence. ``count`` is a power of
    two, 16 or more. Raises ValueError for a character outside base64.
    """
    try:
        bits = _Bits(stream)
    except KeyError as error:
        raise ValueError(f"{error} is no digit of base64") from None
    planes = bits.number(4)
    # Fixed point of the largest value: below 1 seven fraction bits, from 1 on three.
    largest = 1.0 + bits.number(7) / 8.0 if bits.take(_HEADER) else bits.number(7) / 128.0
    values = _planes(bits, planes, count)
    return np.array(values, np.float64) * (largest / 2.0**planes)


def _planes(bits: _Bits, planes: int, count: int) -> list[int]:
    """Decode the bit planes from high to low into signed whole numbers, (count,)."""
    values = [0] * count
    points = list(range(_LOWEST_POINTS))  # not yet significant
    # Trees whose points below the root, or below its children, are not yet significant.
    trees = [(root, False) for root in range(_LOWEST_POINTS // 2, _LOWEST_POINTS)]
    significant: list[int] = []
    for plane in range(planes, -1, -1):
        if bits.is_over:
            break
        step = 1 << plane
        before = len(significant)
        # Sorting pass: single coefficients first, then trees, which split when they become
        # significant. Last the refinement pass: one more bit of all earlier coefficients.
        waiting = []
        for point in points:
            if bits.take(_POINT):
                values[point] = step if bits.take(_SIGN) else -step
                significant.append(point)
            else:
                waiting.append(point)
        points = waiting
        remaining = []
        for root, is_deep in trees:  # the list grows during the iteration
            if not bits.take(_GRANDCHILDREN if is_deep else _CHILDREN):
                remaining.append((root, is_deep))
            elif is_deep:
                trees += [(2 * root, False), (2 * root + 1, False)]
            else:
                for child in (2 * root, 2 * root + 1):
                    if bits.take(_CHILD):
                        values[child] = step if bits.take(_SIGN) else -step
                        significant.append(child)
                    else:
                        points.append(child)
                if 4 * root + 3 < count:
                    trees.append((root, True))
        trees = remaining
        for point in significant[:before]:
            if bits.take(_REFINEMENT):
                values[point] += step if values[point] > 0 else -step
    return values
