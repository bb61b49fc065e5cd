# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibrations of different frequencies at one actuator.

An actuator with a frequency control plays the frequency of the strongest contributor
until another contributor is clearly stronger, so that nearly equal contributors do not alternate.
An actuator driven by a waveform plays the sum of all vibrations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...arrays import F32, F64, I64

MARGIN: Final = 1.25
"""Ratio of strengths at which another contributor takes over: 2 dB, about a noticeable difference.
The just noticeable difference of vibration amplitude is 10 to 20 % and more (a survey in Choi and
Kuchenbecker, "Vibrotactile display", Proceedings of the IEEE 2013)."""

TONE_PAIR_HZ: Final = {"40 Hz": 40.0, "320 Hz": 320.0}
"""Tones of a pair, by the name of their partial: one for slow, one for fast receptors of the skin
(Allerkamp, Böttcher, Wolter, Brady, Qu and Summers, The Visual Computer 2007)."""

_SAME_HZ: Final = 1.0  # largest difference of equal frequencies, as in ``mixing.combine_vibration``


def tone_pair_shares(frequencies_hz: F64) -> F64:
    """Shares (2, R) of amplitude of the tones of a pair, for vibrations of frequencies (R,), Hz. 40
    Hz alone up to 40 Hz, 320 Hz alone from 320 Hz; between them of constant power, by the logarithm
    of the frequency."""
    low_hz, high_hz = TONE_PAIR_HZ.values()
    octaves = np.log2(np.maximum(frequencies_hz, low_hz) / low_hz)
    turn = 0.5 * np.pi * np.minimum(octaves / np.log2(high_hz / low_hz), 1.0)
    return np.stack([np.cos(turn), np.sin(turn)])


class StrongestContributor:
    """Contributor whose frequency each of A actuators plays, held from row to row."""

    def __init__(self, count: int) -> None:
        self._held = np.full(count, -1, np.int64)
        self._numbers: dict[str, int] = {}

    def frequencies(self, names: Sequence[str], amplitudes: F64, frequencies_hz: F64) -> F64:
        """Frequencies of the next rows, (R, A), from amplitudes (n, R, A), frequencies (n, R).

        Contributors of equal frequency support each other; a name of ``names`` (n,) is the same
        contributor in all calls. 0 in silence; NaN at actuators with a contributor whose frequency
        is not finite.
        """
        numbers = np.array([self._numbers.setdefault(n, len(self._numbers)) for n in names])
        is_bad = ~np.isfinite(frequencies_hz)
        hz = np.where(is_bad, 0.0, frequencies_hz)
        if np.ptp(hz, axis=0).max(initial=0.0) <= _SAME_HZ:
            # Equal frequencies, the common case: no contributor can take over from another.
            strongest = np.argmax(amplitudes, axis=0)
            sounds = amplitudes.max(axis=0) > 0.0
            self._held = np.where(sounds[-1], numbers[strongest[-1]], self._held)
            chosen_hz = np.where(sounds, hz[strongest, np.arange(hz.shape[1])[:, None]], 0.0)
        else:
            chosen_hz = self._chosen_of(numbers, amplitudes, hz)
        if is_bad.any():
            chosen_hz[(is_bad[..., None] & (amplitudes > 0.0)).any(axis=0)] = np.nan
        return chosen_hz

    def _chosen_of(self, numbers: I64, amplitudes: F64, hz: F64) -> F64:
        """Frequencies (R, A) of the held contributors, from amplitudes (n, R, A) and ``hz`` (n, R).
        The contributor with the largest summed amplitude within 1 Hz takes over beyond ``MARGIN``
        times that of the held one, or in its silence. 0 in silence."""
        count, rows, width = amplitudes.shape
        is_same = (np.abs(hz[:, None] - hz[None]) <= _SAME_HZ).astype(np.float64)
        together = np.einsum("ijr,jra->ira", is_same, amplitudes)
        # The extra last contributor stands for "absent" and has no support.
        support = np.zeros((count + 1, rows, width))
        support[:count] = np.where(amplitudes > 0.0, together, 0.0)
        best = np.argmax(support, axis=0)
        most, columns = support.max(axis=0), np.arange(width)
        is_held = numbers[:, None] == self._held
        held = np.where(is_held.any(axis=0), np.argmax(is_held, axis=0), count)
        chosen, sounds = best.copy(), most > 0.0
        # An actuator whose strongest contributor never changes needs no pass over the rows.
        only = best[sounds.argmax(axis=0), columns]
        is_clear = ((best == only) | ~sounds).all(axis=0) & ((held == count) | (held == only))
        then = np.where(sounds.any(axis=0), only, held)
        doubtful = np.flatnonzero(~is_clear & sounds.any(axis=0))
        now_held = held[doubtful]
        # Each row depends on the contributor held before, so the rest is decided row by row.
        for row in range(rows) if len(doubtful) else ():
            now, strongest = support[now_held, row, doubtful], most[row, doubtful]
            # Hysteresis: keep the held contributor unless the strongest exceeds it by the margin.
            stays = (now > 0.0) & (strongest <= MARGIN * now)
            chosen[row, doubtful] = np.where(stays, now_held, best[row, doubtful])
            now_held = np.where(strongest > 0.0, chosen[row, doubtful], now_held)
        then[doubtful] = now_held
        held = then
        self._held = np.where(held < count, np.append(numbers, -1)[held], self._held)
        frequencies = hz[np.minimum(chosen, count - 1), np.arange(rows)[:, None]]
        return np.where(most > 0.0, frequencies, 0.0)


@dataclass(frozen=True, eq=False)
class Partial:
    """Sine of one effect at W actuators driven by a waveform."""

    effect_id: str
    first_row: int
    amplitudes: F64  # (n, W) m/s^2, peak
    frequencies_hz: F64  # (n, W) 0 in silence


class Partials:
    """Collector of the sines of effects at W = ``count`` actuators driven by a waveform."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._parts: dict[str, list[tuple[I64, F32, F32]]] = {}

    def add(self, name: str, rows: I64, amplitudes: F64, frequencies_hz: F64) -> None:
        """Store amplitudes (R, W), m/s^2, and frequencies (R,), Hz, of effect ``name`` at raster
        rows (R,), as float32 copies.

        Rows with amplitude 0 at all W actuators are left out. Rows ascend over all calls.
        """
        is_on = amplitudes.any(axis=1)
        if is_on.any():
            sines = (values[is_on].astype(np.float32) for values in (amplitudes, frequencies_hz))
            self._parts.setdefault(name, []).append((rows[is_on], *sines))

    def forget(self) -> None:
        """Discard the stored rows of all effects."""
        self._parts.clear()

    def finished(
        self,
        row_count: int,
        latency_rows: Sequence[int],
        lowest_hz: F64,
        highest_hz: F64,
        highest: F64,
    ) -> tuple[Partial, ...]:
        """One partial per effect, in the order of their first :meth:`add`; stored rows stay.

        Each of W actuators plays ``latency_rows`` (W,) earlier; rows before 0, or at or after
        ``row_count``, are dropped, and effects without remaining rows. Where the sum of amplitudes
        over all effects, at one row and actuator, exceeds ``highest`` (W,), all are scaled to that
        sum. Frequencies are clipped to ``lowest_hz`` and ``highest_hz`` (W,), and 0 in silence.
        """
        partials = [self._one(name, row_count, latency_rows) for name in self._parts]
        partials = [partial for partial in partials if len(partial.amplitudes)]
        total = np.zeros((row_count, self.count))
        for partial in partials:
            rows = slice(partial.first_row, partial.first_row + len(partial.amplitudes))
            total[rows] += partial.amplitudes
        with np.errstate(divide="ignore", invalid="ignore"):
            # Scale all partials of a row equally: the sum keeps the limit and its spectrum.
            share = np.where(total > highest, highest / total, 1.0)
        limited = []
        for partial in partials:
            rows = slice(partial.first_row, partial.first_row + len(partial.amplitudes))
            hz = np.clip(partial.frequencies_hz, lowest_hz, highest_hz)
            hz = np.where(partial.amplitudes > 0.0, hz, 0.0)
            amplitudes = partial.amplitudes * share[rows]
            limited.append(Partial(partial.effect_id, partial.first_row, amplitudes, hz))
        return tuple(limited)

    def _one(self, name: str, row_count: int, latency_rows: Sequence[int]) -> Partial:
        """Unlimited partial of effect ``name``, each actuator's column advanced by its latency.
        Covers first to last row, 0 in gaps. A row with a non-finite amplitude or frequency, or a
        frequency up to 0, is silent at all actuators; a negative amplitude is 0."""
        parts = self._parts[name]
        rows = np.concatenate([part[0] for part in parts])
        values = np.concatenate([part[1] for part in parts]).astype(np.float64)
        hz = np.concatenate([part[2] for part in parts]).astype(np.float64)
        # Effects vibrate at 0.1 Hz at least; values that are not finite are reported when read.
        safe = np.isfinite(values).all(axis=1) & np.isfinite(hz) & (hz > 0.0)
        values[~safe] = 0.0
        # Rows from the earliest of the actuators with most latency to the last with least.
        first = max(0, int(rows[0]) - max(latency_rows))
        stop = int(rows[-1]) + 1 - min(latency_rows)
        amplitudes = np.zeros((max(stop - first, 0), self.count))
        frequencies = np.zeros_like(amplitudes)
        for column, late in enumerate(latency_rows):
            at = rows - late - first
            inside = (at >= 0) & (at < len(amplitudes)) & (rows - late < row_count)
            amplitudes[at[inside], column] = np.maximum(values[inside, column], 0.0)
            frequencies[at[inside], column] = hz[inside]
        return Partial(name, first, amplitudes, frequencies)
