# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF wavelet bands as waveforms: block codec, inverse transform, sequence of blocks.

Sources: ISO/IEC 23090-31, wavelet bands, and encoded files (MPEGGroup, HapticReferenceSoftware).
Codec: an adaptive arithmetic code over SPIHT bit planes (A. Said and W. Pearlman, "A new, fast, and
efficient image codec based on set partitioning in hierarchical trees", 1996, in one dimension).
Filters: A. Cohen, I. Daubechies, J.-C. Feauveau, "Biorthogonal bases of compactly supported
wavelets", 1992 (9/7, as in JPEG 2000), with gain sqrt(2).
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...files import limits
from ..sound.waveforms import BYTES, Waveform
from .bands import Placed

# Analysis filters of the 9/7 pair, nine taps low and seven taps high; symmetric, so the first half
# and the middle tap suffice.
_LOW: Final = np.array([0.037828455507, -0.023849465019, -0.110624404418, 0.377402855613])
_LOW_MIDDLE: Final = 0.852698679009
_HIGH: Final = np.array([-0.064538882629, 0.040689417609, 0.418092273222])
_HIGH_MIDDLE: Final = -0.788485616406
_SHORTEST, _LONGEST = 16, 1 << 16  # samples of a block


def _symmetric(half: F64, middle: float) -> F64:
    """Symmetric filter (2 n + 1,) from its first half (n,) and its middle tap."""
    return np.concatenate([half, [middle], half[::-1]])


# Quadrature mirror: synthesis filters are the other band's analysis filters, alternating in sign.
_FROM_LOW: Final = _symmetric(_HIGH * [1.0, -1.0, 1.0], -_HIGH_MIDDLE)
_FROM_HIGH: Final = _symmetric(_LOW * [-1.0, 1.0, -1.0, 1.0], -_LOW_MIDDLE)


def synthesized(coefficients: F64) -> F64:
    """Samples of a block, (n,), from its wavelet coefficients; n is a power of two, 16 or more."""
    samples = coefficients.copy()
    # Inverse transform level by level: upsample the low and high halves, filter, add. Low bands
    # have even samples, high bands odd ones. The coarsest level has 4 low and 4 high coefficients.
    length = 8
    while length <= len(samples):
        low, high = np.zeros((2, length))
        low[::2], high[1::2] = samples[: length // 2], samples[length // 2 : length]
        samples[:length] = _filtered(low, _FROM_LOW) + _filtered(high, _FROM_HIGH)
        length *= 2
    return samples


def _filtered(samples: F64, taps: F64) -> F64:
    """Convolve samples (n,) with a filter of an odd number of taps; (n,), samples mirrored about
    the end samples."""
    reach = len(taps) // 2
    # Mirroring without a repeated end sample fits symmetric filters of odd length: the inverse
    # transform is exact up to both ends.
    return np.convolve(np.pad(samples, reach, mode="reflect"), taps, mode="valid")


def waveform(
    band: dict[str, Any], effects: Sequence[Placed], timescale: int, name: str
) -> tuple[Waveform | None, Counter[str]]:
    """Waveform of a wavelet band (None without readable blocks), and counts of losses by reason.

    Overlapping blocks are played in sequence: the standard's reference software writes such
    positions, and plays the blocks in sequence. The band's upper limit is the sampling rate;
    ``effects`` are position in ticks and block. Raises TooLargeError, with ``name``, beyond the
    limits of samples or memory.
    """
    rate_hz = float(band["upper_frequency_limit"])
    lost: Counter[str] = Counter()
    blocks: list[tuple[int, F64]] = []
    total = 0
    for position, effect in effects:
        count = _count(band, effect, timescale)
        if rate_hz <= 0.0 or count is None:
            lost["have no block length that is a power of two samples"] += 1
            continue
        total += count
        # Counted before decoding: a few bytes of references may unfold to billions of samples.
        limits.UNFOLDED.check(total, name, "its wavelet bands have")
        coefficients = _coefficients(effect, count)
        if coefficients is None:
            lost["have no readable wavelet stream and are silent"] += 1
            coefficients = np.zeros(count)  # the blocks after it keep their time
        first = round(position * rate_hz / timescale)
        blocks.append((first, synthesized(coefficients)))
    if not blocks:
        return None, lost
    # Blocks are played in sequence: a block never starts before its predecessor has ended.
    blocks.sort(key=lambda block: block[0])
    begin = end = blocks[0][0]
    firsts = []
    for first, samples in blocks:
        firsts.append(max(first, end))
        end = firsts[-1] + len(samples)
    limits.MEMORY.check(BYTES * (end - begin), name, "its waveform would take")
    values = np.zeros(end - begin)
    for first, (_, samples) in zip(firsts, blocks, strict=True):
        values[first - begin : first - begin + len(samples)] = samples
    return Waveform(begin / rate_hz, rate_hz, values), lost


def _count(band: dict[str, Any], effect: dict[str, Any], timescale: int) -> int | None:
    """Samples of a block, a power of two from 16 to 65536; None for other lengths. ``block_length``
    is in ticks, or in milliseconds. Draft files hold the coefficients as keyframes, with one or two
    more for the scale."""
    frames = effect.get("keyframes", ())
    if frames and not effect.get("wavelet_stream"):
        lengths = [float(len(frames) - 2), float(len(frames) - 1)]
    else:
        # The standard's unit, ticks, counts first.
        ticks = band.get("block_length", 0) * float(band["upper_frequency_limit"])
        lengths = [ticks / timescale, ticks / 1000.0]
    for length in lengths:
        count = round(length)
        is_power = count > 0 and not count & (count - 1) and abs(length - count) < 1e-6
        if is_power and _SHORTEST <= count <= _LONGEST:
            return count
    return None


def _coefficients(effect: dict[str, Any], count: int) -> F64 | None:
    """Wavelet coefficients of an effect, (count,), of the stream or else of draft keyframes.
    Keyframes hold the coefficients, then their scale. None for an unreadable stream, too few
    keyframes, or neither; an empty stream without keyframes is silence."""
    stream, frames = effect.get("wavelet_stream"), effect.get("keyframes", ())
    if stream or (stream == "" and not frames):
        try:
            return decoded_block(stream, count)
        except ValueError:
            return None
    # Drafts stored coefficients divided by their scale, with the scale as a further keyframe.
    levels = [frame.get("amplitude_modulation", 0.0) for frame in frames]
    if len(levels) <= count:
        return None
    return np.array(levels[:count]) * levels[count]


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
    """Decoder of the adaptive arithmetic code, one decision per call. ``stream`` are base64 digits
    with padding; KeyError for another character. The code word lies in the interval from ``_lower``
    to ``_upper``, which each decision narrows."""

    def __init__(self, stream: str) -> None:
        self._bits = [
            number >> shift & 1
            for number in map(_DIGITS.__getitem__, stream.rstrip("="))
            for shift in range(5, -1, -1)
        ]
        self._next = 0
        self._code = 0
        # The code word begins with as many digits as the range has.
        for _ in range(_FULL.bit_length() - 1):
            self._code = 2 * self._code + self._digit()
        self._lower, self._upper = 0, _FULL
        # Each context starts at a probability of 1/2 with the weight of 16 decisions, as in the
        # encoder.
        self._zeros, self._counts = [8] * 7, [16] * 7

    def _digit(self) -> int:
        """Next binary digit; 0 after the end of the stream, as trailing zeros are not stored."""
        self._next += 1
        return self._bits[self._next - 1] if self._next <= len(self._bits) else 0

    @property
    def is_over(self) -> bool:
        """True if the bits are used up and every further decision would decode to 0."""
        return self._next >= len(self._bits) and self._code == self._lower

    def take(self, kind: int) -> int:
        """Decode the next decision of a context (``_HEADER`` to ``_REFINEMENT``), 0 or 1. The
        context's probability is adapted."""
        # The interval is split in proportion to the context's probability of 0; both parts have
        # a width of 1 at least, so that either decision can be coded.
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
        # Renormalization: double the interval while it lies in one half of the range, whose digit
        # is then known, or in the middle half.
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
        """Decode a whole number of ``length`` binary digits of the header, lowest digit first."""
        return sum(self.take(_HEADER) << digit for digit in range(length))


def decoded_block(stream: str, count: int) -> F64:
    """Decode the wavelet coefficients of a block, (count,), coarse to fine.

    ``stream`` are base64 digits of any number; padding ``=`` at the end is ignored, and zero bits
    follow a cut-off stream; an empty stream is silence. ``count`` is a power of two, 16 or more.
    Coefficients are whole numbers times header value / 2^planes. Raises ValueError for a character
    outside base64.
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
    """Decode the bit planes ``planes`` (highest) to 0 into signed whole numbers, (count,); planes
    after the end of the stream are 0."""
    # SPIHT: coefficients at 2 k and 2 k + 1, half as long in time, are the children of coefficient
    # k. A whole tree without significant coefficients (absolute value of 2^plane or more) costs a
    # single decision.
    values = [0] * count
    points = list(range(_LOWEST_POINTS))  # not yet significant
    # Trees whose points below the root, or below its children, are not yet significant.
    trees = [(root, False) for root in range(_LOWEST_POINTS // 2, _LOWEST_POINTS)]
    significant: list[int] = []
    for plane in range(planes, -1, -1):
        # Missing planes are zero bits: coefficients decoded so far stay, only coarser.
        if bits.is_over:
            break
        step = 1 << plane
        before = len(significant)
        # Sorting pass: single coefficients first, then trees, which split when they become
        # significant. Last the refinement pass: the next bit of all earlier coefficients.
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
                # Without grandchildren within the block, no tree is left.
                if 4 * root + 3 < count:
                    trees.append((root, True))
        trees = remaining
        # Coefficients new in this plane already have the plane's bit, their highest.
        for point in significant[:before]:
            if bits.take(_REFINEMENT):
                values[point] += step if values[point] > 0 else -step
    return values
