# SPDX-License-Identifier: GPL-3.0-or-later
"""Mix of moving sound sources into the channels of loudspeakers.

Values change linearly between the raster's times; phases are exact integrals, so the result does
not depend on block sizes. Wet sound is diffuse: each loudspeaker has an independent reverberator, a
chain of all-pass sections (Schroeder 1961) with random delays and signs, so every frequency leaves
every loudspeaker with the same power.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64

from .hearing import absorption_db_m, doppler_hz
from .loudspeakers import Panner


@dataclass(frozen=True, eq=False)
class SoundSource:
    """A source at T times: a sine, or a sound that repeats from each start of the source."""

    name: str
    places_m: F64  # (T, 3) listener space; silent where not finite
    amplitudes: F64  # (T,) 0..1
    frequencies_hz: F64  # (T,) of the sine, or repetitions of the sound a second
    sound: F64 | None = None  # (n,) one repetition; None: a sine


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
            _Voice(source, panner, reverberators, self._raster_hz) for source in sources
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
        # With the row after the last, for the interpolation.
        span = slice(int(row[0]), int(row[-1]) + 2)
        for voice in self._voices:
            if not voice.loudness[span].any():
                continue
            # Integral of the linearly changing frequency since the row.
            turns = voice.turns[row] + share / self._raster_hz * (
                voice.frequencies[row]
                + 0.5 * share * (voice.frequencies[row + 1] - voice.frequencies[row])
            )
            signal = voice.wave(turns) * inside
            lead = _between(voice.lead, row, share)
            wet = voice.wave(turns + lead) * inside
            bus += wet * _between(voice.wet, row, share)
            for channel in np.flatnonzero(voice.dry[span].any(axis=0)).tolist():
                mixed[:, channel] += signal * _between(voice.dry[:, channel], row, share)
        return mixed + self._reverberators.process(bus)


class _Voice:
    """A source at T rows and silence after the last row, (T + 1, ...): panned, with Doppler shift
    and absorption of air if the panner's hearing has these. Non-finite amplitudes are 0."""

    def __init__(
        self, source: SoundSource, panner: Panner, reverberators: Reverberators, raster_hz: float
    ) -> None:
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
        # Turns at each row, by the trapezoidal rule: exact for frequencies that change linearly.
        self.frequencies = np.append(at_listener_hz, at_listener_hz[-1:])
        steps = 0.5 * (self.frequencies[1:] + self.frequencies[:-1]) / raster_hz
        self.turns = np.concatenate([[0.0], np.cumsum(steps)])  # played before each row
        self._sound = source.sound
        if source.sound is not None:
            # A sound begins anew at the last silent row before the source is on.
            is_start = np.append(amplitudes <= 0.0, False)
            rows = np.where(is_start, np.arange(len(is_start)), 0)
            self.turns -= self.turns[np.maximum.accumulate(rows)]
        self.turns[1:] = np.mod(self.turns[1:], 1.0)
        lead = _quadrature(dry, reverberators, at_listener_hz)
        if source.sound is not None:  # its frequencies have no common quarter turn
            lead = np.zeros_like(lead)
        self.lead = np.append(lead, lead[-1:])  # of the wet part, in turns
        self.dry = np.vstack([dry, np.zeros((1, dry.shape[1]))])  # amplitude times panner's gain
        self.wet = np.append(wet, 0.0)
        self.loudness = np.append(np.abs(dry).sum(axis=1) + np.abs(wet), 0.0)

    def wave(self, turns: F64) -> F64:
        """Samples (n,) at ``turns`` (n,), one a period of the sine or a repetition of the sound;
        linear between the samples of a sound."""
        if self._sound is None:
            return np.asarray(np.sin(2.0 * np.pi * turns))
        at = np.mod(turns, 1.0) * len(self._sound)
        row = np.minimum(at.astype(np.int64), len(self._sound) - 1)
        following = self._sound[(row + 1) % len(self._sound)]
        return np.asarray(self._sound[row] + (at - row) * (following - self._sound[row]))


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


_SEED: Final = 20120711
_SECTIONS: Final = 8
_GAIN: Final = 0.7  # Schroeder's
_SHRINKING: Final = 0.65  # ratio of delays of successive sections
_LEAST_SHARE: Final = 0.7  # smallest factor of a randomly shortened delay


class Reverberators:
    """Reverberators of C channels, with together the power of the input.

    ``decay_s`` is the time of a decay by 60 dB; ``block`` the samples in each call of
    :meth:`process`. Convolution runs block by block and carries a tail over.
    """

    def __init__(
        self, channels: int, rate_hz: int, decay_s: float = 1.4, block: int = 1 << 15
    ) -> None:
        self.block = block
        self._rate_hz = rate_hz
        self._chains = [_Chain(channel, rate_hz, decay_s) for channel in range(channels)]
        length = max(int(decay_s * rate_hz), 1)
        impulses = np.stack([chain.impulse(length) for chain in self._chains])
        # Power of the impulses as cut off, so that the channels share exactly the input's power.
        power = channels * np.square(impulses).sum(axis=1, keepdims=True)
        self.impulses: F64 = impulses / np.sqrt(power)  # (C, length)
        # Long enough for the whole convolution of a block, so that nothing wraps around.
        self._size = 1 << int(np.ceil(np.log2(block + length - 1)))
        self._spectra = np.fft.rfft(self.impulses, self._size, axis=1)
        self._tail = np.zeros((channels, self._size - block))

    def response(self, frequencies_hz: F64) -> npt.NDArray[np.complex128]:
        """Complex gains (n, C) of the channels for steady sines of frequencies (n,) in Hz."""
        responses = [chain.response(frequencies_hz / self._rate_hz) for chain in self._chains]
        return np.stack(responses, axis=1) / np.sqrt(len(responses))

    def process(self, signal: F64) -> F64:
        """Reverberate the next ``block`` samples of a mono signal, (block, C); keeps the tail.
        Raises ValueError for a signal of another length."""
        if signal.shape != (self.block,):
            raise ValueError(f"signal: expected ({self.block},), got {signal.shape}")
        whole = np.zeros((len(self._tail), self._size))
        # Overlap-add: the tail of all blocks before, plus the response to this block.
        whole[:, : self._tail.shape[1]] = self._tail
        if signal.any():
            spectrum = np.fft.rfft(signal, self._size)
            for channel, own in enumerate(self._spectra):
                whole[channel] += np.fft.irfft(spectrum * own, self._size)
        self._tail = whole[:, self.block :]
        return np.ascontiguousarray(whole[:, : self.block].T)


class _Chain:
    """Successive all-pass sections y[n] = -g x[n] + x[n - d] + g y[n - d] of a channel, drawn from
    a fixed seed; the longest section decays by 60 dB in ``decay_s``."""

    def __init__(self, channel: int, rate_hz: int, decay_s: float) -> None:
        rng = np.random.default_rng([_SEED, channel])
        # A comb with gain g and delay d decays by 60 dB in -3 d / log10(g) samples.
        longest = decay_s * rate_hz * -np.log10(_GAIN) / 3.0
        delays = longest * _SHRINKING ** np.arange(_SECTIONS)
        delays = np.maximum(delays * rng.uniform(_LEAST_SHARE, 1.0, _SECTIONS), 1.0)
        gains = _GAIN * rng.choice([-1.0, 1.0], _SECTIONS)
        self.delays: list[int] = delays.astype(int).tolist()  # samples
        self.gains: list[float] = gains.tolist()

    def impulse(self, length: int) -> F64:
        """First ``length`` samples of the impulse response of all sections in a row."""
        signal = np.zeros(length)
        signal[0] = 1.0
        for delay, gain in zip(self.delays, self.gains, strict=True):
            passed = -gain * signal
            passed[delay:] += signal[: max(length - delay, 0)]
            # The recursion reaches back by one delay, so whole runs of that length are independent.
            for start in range(delay, length, delay):
                part = passed[start : start + delay]
                part += gain * passed[start - delay : start - delay + len(part)]
            signal = passed
        return signal

    def response(self, turns_per_sample: F64) -> npt.NDArray[np.complex128]:
        """Complex gains (n,), of magnitude 1, at frequencies (n,) as shares of the sample rate."""
        gains = np.ones(len(turns_per_sample), np.complex128)
        for delay, gain in zip(self.delays, self.gains, strict=True):
            later = np.exp(-2j * np.pi * delay * turns_per_sample)
            gains *= (later - gain) / (1.0 - gain * later)
        return gains
