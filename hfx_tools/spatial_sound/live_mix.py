# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound in real time: blocks of loudspeaker signals at the newest places of the sources."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.arrays import F64

from .hearing import absorption_db_m
from .loudspeakers import Panner
from .spatial_mix import Reverberators


class LiveMix:
    """Mix of S sine sources of constant frequencies (S,) in Hz at ``rate_hz``, in blocks of
    ``block`` samples.

    Gains change linearly over a block, from the gains of the block before, and phases run on. At
    constant places the result is that of :class:`.SpatialMix`. There is no Doppler shift.
    """

    def __init__(
        self,
        frequencies_hz: F64,
        panner: Panner,
        reverberators: Reverberators,
        rate_hz: int,
        block: int,
    ) -> None:
        self._frequencies_hz, self._panner = frequencies_hz, panner
        self._rate_hz, self._size = rate_hz, block
        self._reverberation = _Convolution(reverberators.impulses, block)
        self._turns = np.zeros(len(frequencies_hz))  # at the begin of the next block
        self._response = reverberators.response(frequencies_hz)
        # Gains (S, C) of dry parts, gains (S,) and leads (S,) in turns of wet parts.
        self._before: tuple[F64, F64, F64] | None = None

    def block(self, places_m: F64, amplitudes: F64) -> F64:
        """Next samples (block, C) of sources that reach places (S, 3) in listener
        space, metres, and amplitudes (S,) at the end of the block; not finite places are silent."""
        now = self._gains(places_m, amplitudes)
        dry0, wet0, lead0 = now if self._before is None else self._before
        dry, wet, lead = self._before = now
        size = self._size
        share = np.arange(size) / size
        mixed, bus = np.zeros((size, dry.shape[1])), np.zeros(size)
        for k, frequency_hz in enumerate(self._frequencies_hz.tolist()):
            turns = self._turns[k] + frequency_hz / self._rate_hz * np.arange(size)
            signal = np.sin(2.0 * np.pi * turns)
            mixed += signal[:, None] * (dry0[k] + share[:, None] * (dry[k] - dry0[k]))
            leads = lead0[k] + share * (lead[k] - lead0[k])
            wets = wet0[k] + share * (wet[k] - wet0[k])
            bus += np.sin(2.0 * np.pi * (turns + leads)) * wets
        self._turns = np.mod(self._turns + self._frequencies_hz * size / self._rate_hz, 1.0)
        return mixed + self._reverberation.process(bus)

    def _gains(self, places_m: F64, amplitudes: F64) -> tuple[F64, F64, F64]:
        """Gains (S, C) of dry parts, and gains (S,) and leads (S,) of wet parts."""
        dry, wet = self._panner.gains(places_m)
        amplitudes = np.nan_to_num(amplitudes)
        if self._panner.hearing.air > 0.0:
            distances = np.nan_to_num(np.linalg.norm(places_m, axis=1), posinf=0.0)
            loss_db = absorption_db_m(self._frequencies_hz) * distances * self._panner.hearing.air
            amplitudes = amplitudes * 10.0 ** (-loss_db / 20.0)
        dry, wet = dry * amplitudes[:, None], wet * amplitudes
        # A quarter turn from the common phase of dry and wet part their powers add; of both
        # solutions, half a turn apart, the one nearer to the block before avoids a jump.
        together = np.einsum("sc,sc->s", dry, self._response)
        lead = 0.25 - 0.5 * np.angle(together) / np.pi
        before = lead if self._before is None else self._before[2]
        lead = lead + 0.5 * np.round(2.0 * (before - lead))
        return dry, wet, np.where(np.abs(together) > 1e-12, lead, before)


class _Convolution:
    """Convolution with impulses (C, length), in blocks: overlap-save with parts of a block's
    length, whose cost for short blocks is far below that of one transform over the length."""

    def __init__(self, impulses: F64, block: int) -> None:
        channels, length = impulses.shape
        count = -(-length // block)
        parts = np.zeros((channels, count * block))
        parts[:, :length] = impulses
        spectra = np.fft.rfft(parts.reshape(channels, count, block), 2 * block, axis=2)
        # For each frequency (F, count, C), so that the sum over parts is a product of matrices.
        self._spectra = np.ascontiguousarray(spectra.transpose(2, 1, 0))
        # Spectra of the last blocks (F, 1, count), newest first.
        self._history = np.zeros((block + 1, 1, count), np.complex128)
        self._before = np.zeros(block)

    def process(self, signal: F64) -> F64:
        """Samples (block, C) of the next block (block,)."""
        self._history[:, 0, 1:] = self._history[:, 0, :-1]
        self._history[:, 0, 0] = np.fft.rfft(np.concatenate([self._before, signal]))
        self._before = signal
        total = (self._history @ self._spectra)[:, 0]
        # The first half is wrapped around.
        return np.asarray(np.fft.irfft(total, axis=0)[len(signal) :])
