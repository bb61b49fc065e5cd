# SPDX-License-Identifier: GPL-3.0-or-later
"""Mix of moving sound sources into the channels of loudspeakers.

Values change linearly between the raster's times; phases are exact integrals, so the result does
not depend on block sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from .hearing import absorption_db_m, doppler_hz
from .panner import Panner
from .reverberation import Reverberators


@dataclass(frozen=True, eq=False)
class SoundSource:
    """A sine source at T times."""

    name: str
    places_m: F64  # (T, 3) listener space; silent where not finite
    amplitudes: F64  # (T,) 0..1
    frequencies_hz: F64  # (T,)


class SpatialMix:
    """Loudspeaker signals, at ``rate_hz``, of sources with values at ``raster_hz``."""

    def __init__(
        self,
        sources: Sequence[SoundSource],
        panner: Panner,
        reverberators: Reverberators,
        raster_hz: Fraction,
        rate_hz: int,
    ) -> None:
        self._reverberators = reverberators
        self._step = (raster_hz / rate_hz).as_integer_ratio()
        self._raster_hz = float(raster_hz)
        self._channels = reverberators.impulses.shape[0]
        self._voices = [
            _Voice.of(source, panner, reverberators, self._raster_hz) for source in sources
        ]
        self._rows = len(sources[0].amplitudes) if sources else 0

    def blocks(self, sample_count: int) -> Iterator[F64]:
        """Yield ``sample_count`` samples as blocks (n, C); iterate once: reverberation runs on."""
        size = self._reverberators.block
        for first in range(0, sample_count, size):
            samples = self._block(first, size)
            yield samples[: sample_count - first]

    def _block(self, first: int, size: int) -> F64:
        """Samples (size, C) from sample ``first`` on, dry and wet; dry silence after the end."""
        mixed = np.zeros((size, self._channels))
        bus = np.zeros(size)
        numerator, denominator = self._step
        # Exact integers: raster row of each audio sample, and its share of the way to the next.
        position = np.arange(first, first + size, dtype=np.int64) * numerator
        row, rest = position // denominator, position % denominator
        share = rest / denominator
        inside = row < self._rows
        row = np.minimum(row, max(self._rows - 1, 0))
        span = slice(int(row[0]), int(row[-1]) + 2)
        for voice in self._voices:
            if not voice.loudness[span].any():
                continue
            # Integral of the linearly changing frequency since the row.
            turns = voice.turns[row] + share / self._raster_hz * (
                voice.frequencies[row]
                + 0.5 * share * (voice.frequencies[row + 1] - voice.frequencies[row])
            )
            signal = np.sin(2.0 * np.pi * turns) * inside
            apart = _between(voice.apart, row, share)
            wet = np.sin(2.0 * np.pi * (turns + apart)) * inside
            bus += wet * _between(voice.wet, row, share)
            for channel in np.flatnonzero(voice.dry[span].any(axis=0)).tolist():
                mixed[:, channel] += signal * _between(voice.dry[:, channel], row, share)
        return mixed + self._reverberators.process(bus)


@dataclass(frozen=True, eq=False)
class _Voice:
    """A source at T rows and silence after the last row, (T + 1, ...)."""

    dry: F64  # (T + 1, C) amplitude times the panner's gain
    wet: F64  # (T + 1,)
    loudness: F64  # (T + 1,)
    frequencies: F64  # (T + 1,)
    turns: F64  # (T + 1,) played before each row
    apart: F64  # (T + 1,) lead of the wet part, in turns

    @classmethod
    def of(
        cls, source: SoundSource, panner: Panner, reverberators: Reverberators, raster_hz: float
    ) -> _Voice:
        """Voice of a source: panned, and if set with Doppler shift and absorption."""
        dry, wet = panner.gains(source.places_m)
        distances = np.linalg.norm(source.places_m, axis=1)
        hearing, at_listener_hz = panner.hearing, source.frequencies_hz
        if hearing.with_doppler:
            at_listener_hz = doppler_hz(at_listener_hz, np.nan_to_num(distances), raster_hz)
        amplitudes = np.nan_to_num(source.amplitudes)
        if hearing.air > 0.0:
            loss_db = hearing.air * absorption_db_m(at_listener_hz) * np.nan_to_num(distances)
            amplitudes *= 10.0 ** (-loss_db / 20.0)
        dry, wet = dry * amplitudes[:, None], wet * amplitudes
        frequencies = np.append(at_listener_hz, at_listener_hz[-1:])
        steps = 0.5 * (frequencies[1:] + frequencies[:-1]) / raster_hz
        turns = np.concatenate([[0.0], np.cumsum(steps)])
        turns[1:] = np.mod(turns[1:], 1.0)
        apart = _quadrature(dry, reverberators, at_listener_hz)
        silence = np.zeros((1, dry.shape[1]))
        return cls(
            np.vstack([dry, silence]),
            np.append(wet, 0.0),
            np.append(np.abs(dry).sum(axis=1) + np.abs(wet), 0.0),
            frequencies,
            turns,
            np.append(apart, apart[-1:]),
        )


def _quadrature(dry: F64, reverberators: Reverberators, frequencies_hz: F64) -> F64:
    """Lead (T,), in turns, at which the power of the wet part adds to that of the dry part.

    A sine and its reverberation interfere. Summed over the channels, the product of dry gains (T,
    C) and the reverberators' responses has one phase; a quarter turn away from that phase the sum
    is 0.
    """
    unique_hz, which = np.unique(frequencies_hz, return_inverse=True)
    together = np.einsum("tc,tc->t", dry, reverberators.response(unique_hz)[which])
    known = np.flatnonzero(np.abs(together) > 1e-12)
    if not len(known):
        return np.zeros(len(dry))
    # Both signs are solutions; unwrapping takes the solution nearer to the row before.
    half = 0.5 * np.unwrap(np.pi - 2.0 * np.angle(together[known]))
    return np.asarray(np.interp(np.arange(len(dry)), known, half / (2.0 * np.pi)))


def _between(values: F64, row: npt.NDArray[np.int64], share: F64) -> F64:
    """Linear interpolation (n,) of ``values`` from row ``row`` (n,) to the next by ``share``."""
    here = values[row]
    return np.asarray(here + share * (values[row + 1] - here))
