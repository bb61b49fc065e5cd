# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded wavelet blocks of HJIF: an adaptive arithmetic code over SPIHT's bit planes.

Sources: ISO/IEC 23090-31, wavelet bands; A. Said and W. Pearlman, "A new, fast, and efficient
image codec based on set partitioning in hierarchical trees", 1996, in one dimension; the bits
of real files (MPEGGroup, HapticReferenceSoftware).
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
_FULL: Final = 1024  # the code's range; 10 digits of it are looked at
_HALF: Final = _FULL // 2
_QUARTER: Final = _FULL // 4
_HEADER, _SIGN, _POINT, _CHILDREN, _CHILD, _GRANDCHILDREN, _REFINEMENT = range(7)
"""Kinds of binary decisions; each has probabilities of its own."""

_LOWEST_POINTS: Final = 8  # coefficients that no other one is the parent of


class _Bits:
    """Decoder of the arithmetic code, a decision at a time."""

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
        """The stream's next digit; its last zeros are not written."""
        self._next += 1
        return self._bits[self._next - 1] if self._next <= len(self._bits) else 0

    @property
    def is_over(self) -> bool:
        """Test that all further decisions are 0."""
        return self._next >= len(self._bits) and self._code == self._lower

    def take(self, kind: int) -> int:
        """The next decision, 0 or 1."""
        width = self._upper - self._lower
        share = int(self._zeros[kind] / self._counts[kind] * _FULL + 0.5)
        split = min(max(width * share // _FULL, 1), width - 1)
        self._counts[kind] += 1
        if self._code - self._lower < split:
            found = 0
            self._upper = self._lower + split
            self._zeros[kind] += 1
        else:
            found = 1
            self._lower += split
        while True:
            if self._upper <= _HALF:
                off = 0
            elif self._lower >= _HALF:
                off = _HALF
            elif self._lower >= _QUARTER and self._upper <= 3 * _QUARTER:
                off = _QUARTER
            else:
                return found
            self._lower = 2 * (self._lower - off)
            self._upper = 2 * (self._upper - off)
            self._code = 2 * (self._code - off) + self._digit()

    def number(self, length: int) -> int:
        """A whole number of the header, its lowest digit first."""
        return sum(self.take(_HEADER) << place for place in range(length))


def decode(stream: str, count: int) -> F64:
    """Wavelet coefficients of a block, (count,), coarse ones first.

    Parameters
    ----------
    stream : str
        Base64 digits, of any number; none are silence, as zeros at a stream's end are not written.
    count : int
        A power of two, 16 or more.

    Raises
    ------
    ValueError
        A character is no digit.
    """
    try:
        bits = _Bits(stream)
    except KeyError as error:
        raise ValueError(f"{error} is no digit of base64") from None
    planes = bits.number(4)
    # Below 1 the largest value has 7 digits after the point; from 1 on 4 before it and 3 after.
    largest = 1.0 + bits.number(7) / 8.0 if bits.take(_HEADER) else bits.number(7) / 128.0
    values = _planes(bits, planes, count)
    return np.array(values, np.float64) * (largest / 2.0**planes)


def _planes(bits: _Bits, planes: int, count: int) -> list[int]:
    """Whole numbers of the bit planes, from the highest plane down."""
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
        waiting = []
        for point in points:
            if bits.take(_POINT):
                values[point] = step if bits.take(_SIGN) else -step
                significant.append(point)
            else:
                waiting.append(point)
        points = waiting
        remaining = []
        for root, is_deep in trees:  # grows while it is looked through
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
