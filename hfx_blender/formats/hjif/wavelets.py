# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF wavelet bands as waveforms.

Source of the filters: A. Cohen, I. Daubechies, J.-C. Feauveau, "Biorthogonal bases of compactly
supported wavelets", 1992 (9/7, as in JPEG 2000), with gain sqrt(2).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64
from ...files import limits
from ..sound.waveforms import BYTES, Waveform
from . import spiht
from .bands import Placed

_LOW: Final = np.array([0.037828455507, -0.023849465019, -0.110624404418, 0.377402855613])
_LOW_MIDDLE: Final = 0.852698679009
_HIGH: Final = np.array([-0.064538882629, 0.040689417609, 0.418092273222])
_HIGH_MIDDLE: Final = -0.788485616406
_SHORTEST, _LONGEST = 16, 1 << 16  # samples of a block


def _symmetric(half: F64, middle: float) -> F64:
    """Symmetric filter from its first half and its middle tap."""
    return np.concatenate([half, [middle], half[::-1]])


# Quadrature mirror: synthesis filters are the other band's analysis filters, alternating in sign.
_FROM_LOW: Final = _symmetric(_HIGH * [1.0, -1.0, 1.0], -_HIGH_MIDDLE)
_FROM_HIGH: Final = _symmetric(_LOW * [-1.0, 1.0, -1.0, 1.0], -_LOW_MIDDLE)


def synthesized(coefficients: F64) -> F64:
    """Samples of a block, (n,), from its wavelet coefficients; n is a power of two, 16 or more."""
    samples = coefficients.copy()
    # Inverse transform level by level: upsample the low and high halves, filter, add.
    length = 8
    while length <= len(samples):
        low, high = np.zeros((2, length))
        low[::2], high[1::2] = samples[: length // 2], samples[length // 2 : length]
        samples[:length] = _filtered(low, _FROM_LOW) + _filtered(high, _FROM_HIGH)
        length *= 2
    return samples


def _filtered(samples: F64, taps: F64) -> F64:
    """Convolve samples with taps; both ends are mirrored without repeating the last sample."""
    reach = len(taps) // 2
    return np.convolve(np.pad(samples, reach, mode="reflect"), taps, mode="valid")


def waveform(
    band: dict[str, Any], effects: Sequence[Placed], timescale: int, name: str
) -> tuple[Waveform | None, Counter[str]]:
    """Waveform of a wavelet band.

    Blocks that would overlap follow each other instead: the standard's reference software
    writes such positions, and plays the blocks one after the other.

    Parameters
    ----------
    band : dict
        Its upper limit is the sampling rate.
    effects : sequence of (int, dict)
        Positions and blocks, ticks.
    name : str
        Of the file, for messages.

    Returns
    -------
    waveform : Waveform or None
        None if nothing can be decoded.
    lost : Counter
        Counts of effects that cannot be decoded, by reason.

    Raises
    ------
    TooLargeError
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
        limits.UNFOLDED.check(total, name, "its wavelet bands have")
        coefficients = _coefficients(effect, count)
        if coefficients is None:
            lost["have no readable wavelet stream and are silent"] += 1
            coefficients = np.zeros(count)  # the blocks after it keep their time
        first = round(position * rate_hz / timescale)
        blocks.append((first, synthesized(coefficients)))
    if not blocks:
        return None, lost
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
    """Samples of a block; None if it is no power of two within reason.

    Files from before the standard hold the coefficients as keyframes, with two more for their
    scale, and tell the length of a block in milliseconds.
    """
    frames = effect.get("keyframes", ())
    if frames and not effect.get("wavelet_stream"):
        lengths = [float(len(frames) - 2), float(len(frames) - 1)]
    else:
        ticks = band.get("block_length", 0) * float(band["upper_frequency_limit"])
        lengths = [ticks / timescale, ticks / 1000.0]
    for length in lengths:
        count = round(length)
        is_power = count > 0 and not count & (count - 1) and abs(length - count) < 1e-6
        if is_power and _SHORTEST <= count <= _LONGEST:
            return count
    return None


def _coefficients(effect: dict[str, Any], count: int) -> F64 | None:
    stream, frames = effect.get("wavelet_stream"), effect.get("keyframes", ())
    if stream or (stream == "" and not frames):
        try:
            return spiht.decode(stream, count)
        except ValueError:
            return None
    levels = [frame.get("amplitude_modulation", 0.0) for frame in frames]
    if len(levels) <= count:
        return None
    return np.array(levels[:count]) * levels[count]
