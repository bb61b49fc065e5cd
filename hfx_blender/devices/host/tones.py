# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibrations of several frequencies at actuators that are driven as sound, live.

Such an actuator plays the sum of what it is asked for, as it does in an exported WAV. A frame
holds the device's columns first, as for any device; after them each tone: its number, then the
amplitude and the frequency of each of the W actuators that take a waveform.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...engine.arrays import F64, I64
from ...engine.rendering.conditioning.frequency import Partial
from ...engine.rendering.device import DeviceConfig

MAX_TONES: Final = 16
"""Largest number of different frequencies at once; of more, the strongest are kept."""

LONE: Final = -1
"""Number of the one tone of values that come without tones: a script's, a test pulse."""

_ALIKE_HZ: Final = 1.0
"""Frequencies closer than this are played as one, as where a single frequency is chosen."""


@dataclass(frozen=True, eq=False)
class Tones:
    """Sines of K numbers at W actuators."""

    numbers: I64  # (K,)
    amplitudes: F64  # (K, W)
    frequencies_hz: F64  # (K, W)

    @classmethod
    def none(cls, width: int) -> Tones:
        return cls(np.zeros(0, np.int64), np.zeros((0, width)), np.zeros((0, width)))


def of_partials(partials: Iterable[Partial], numbers: Mapping[str, int], width: int) -> Tones:
    """Tones of one moment; partials of equal frequency are merged.

    Parameters
    ----------
    partials : iterable of Partial
        Of one row.
    numbers : mapping
        By effect; the tone of several has that of the first.
    """
    found: list[tuple[int, F64, F64]] = []
    for each in partials:
        amplitudes, hz = each.amplitudes[0], each.frequencies_hz[0]
        if not amplitudes.any():
            continue
        for k, (number, others, others_hz) in enumerate(found):
            sounds = amplitudes > 0.0
            differs = np.abs(hz - others_hz.max())[sounds].max() > _ALIKE_HZ
            if number == numbers[each.effect_id] or not differs:
                both_hz = np.where(others > 0.0, others_hz, hz)
                found[k] = number, others + amplitudes, both_hz
                break
        else:
            found.append((numbers[each.effect_id], amplitudes, hz))
    found = sorted(found, key=lambda tone: -float(tone[1].max()))[:MAX_TONES]
    if not found:
        return Tones.none(width)
    return Tones(
        np.array([number for number, _, _ in found], np.int64),
        np.stack([amplitudes for _, amplitudes, _ in found]),
        np.stack([hz for _, _, hz in found]),
    )


def frame_of(values: F64, tones: Tones) -> F64:
    """Frame of values (columns,) and tones."""
    rows = np.column_stack((tones.numbers, tones.amplitudes, tones.frequencies_hz))
    return np.concatenate([values, rows.ravel()])


class Sounding:
    """Actuators of a device that take a waveform, and their tones within their limits."""

    def __init__(self, device: DeviceConfig) -> None:
        members = [k for k, each in enumerate(device.actuators) if each.type.takes_waveform]
        kinds = [device.actuators[k].type for k in members]
        self.columns: I64 = device.strength_columns[members]
        self._column_count = len(device.controls)
        self._highest = np.array([kind.strength.highest for kind in kinds])
        self._lowest_hz = np.array([kind.controls[1].lowest for kind in kinds])
        self._highest_hz = np.array([kind.controls[1].highest for kind in kinds])
        self.reset()

    def __len__(self) -> int:
        return len(self.columns)

    def reset(self) -> None:
        """Begin from silence."""
        self._from = self._to = self._here = Tones.none(len(self))

    def fault_of(self, frame: F64) -> str:
        """Fault of a frame for this device; empty if it has none."""
        columns, width = self._column_count, 1 + 2 * len(self)
        more = np.size(frame) - columns if np.ndim(frame) == 1 else -1
        is_of_tones = len(self) and 0 < more <= MAX_TONES * width and more % width == 0
        if more == 0 or is_of_tones:
            return ""
        return f"it was sent {np.size(frame)} values and takes {columns}"

    def split(self, frame: F64) -> F64:
        """Take a new frame's tones as the target; returns its values (columns,).

        Raises
        ------
        ValueError
            It is not a frame of this device.
        """
        if fault := self.fault_of(frame):
            raise ValueError(fault)
        values = frame[: self._column_count]
        if not len(self):
            return values
        rows = frame[self._column_count :].reshape(-1, 1 + 2 * len(self))
        count = len(rows)
        numbers = np.nan_to_num(rows[:, 0]).astype(np.int64)
        tones = Tones(numbers, rows[:, 1 : 1 + len(self)], rows[:, 1 + len(self) :])
        self._from, self._to = self._here, tones if count else self._plain_tones(values)
        return values

    def totals(self, share: float, wanted: F64) -> F64:
        """A frame's values (columns,) for the guard: at least as strong as its tones together.

        Tones of a frame whose values tell of less would pass the limits otherwise.
        """
        if not len(self):
            return wanted
        here = _between(self._from, self._to, share)
        is_finite = np.isfinite(here.amplitudes) & np.isfinite(here.frequencies_hz)
        totals = np.where(is_finite, np.maximum(here.amplitudes, 0.0), 0.0)
        totals = np.sqrt((np.minimum(totals, self._highest) ** 2).sum(axis=0))
        asked = wanted[self.columns]
        found = wanted.copy()
        found[self.columns] = np.where(asked > 0.0, np.maximum(asked, totals), asked)
        return found

    def at(self, share: float, wanted: F64, passed: F64) -> Tones:
        """Tones at a share of the way to the newest frame.

        Parameters
        ----------
        share : float
            0..1
        wanted, passed : (columns,) float64
            The frame's values there, as :meth:`totals` gives them, and what the guard has let pass
            of them: tones are turned down alike.
        """
        self._here = _between(self._from, self._to, share)
        asked, given = wanted[self.columns], passed[self.columns]
        finite = np.isfinite(self._here.amplitudes) & np.isfinite(self._here.frequencies_hz)
        amplitudes = np.where(finite, np.maximum(self._here.amplitudes, 0.0), 0.0)
        hz = np.where(finite, self._here.frequencies_hz, 0.0)
        plays = (asked > 0.0) & np.isfinite(asked)
        with np.errstate(over="ignore", invalid="ignore"):
            amplitudes *= np.where(plays, given / np.where(plays, asked, 1.0), 0.0)
        amplitudes = np.minimum(np.nan_to_num(amplitudes), self._highest)
        alone = self._plain_tones(passed)  # output without a tone: a test pulse
        is_alone = ~amplitudes.any(axis=0)
        numbers = self._here.numbers
        if LONE not in numbers:
            numbers = np.append(numbers, LONE)
            amplitudes, hz = (np.vstack([each, np.zeros(len(self))]) for each in (amplitudes, hz))
        row = numbers.tolist().index(LONE)
        amplitudes[row, is_alone] = alone.amplitudes[0, is_alone]
        hz[row, is_alone] = alone.frequencies_hz[0, is_alone]
        tones = Tones(numbers, amplitudes, hz)
        total = tones.amplitudes.sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = np.where(total > self._highest, self._highest / total, 1.0)
        return Tones(
            tones.numbers,
            tones.amplitudes * turned,
            np.clip(tones.frequencies_hz, self._lowest_hz, self._highest_hz),
        )

    def _plain_tones(self, values: F64) -> Tones:
        """Tone of plain values, one for each actuator."""
        return Tones(
            np.array([LONE], np.int64), values[None, self.columns], values[None, self.columns + 1]
        )


def _between(one: Tones, other: Tones, share: float) -> Tones:
    """Tones between two sets: interpolated strengths, frequencies of the target."""
    if share >= 1.0:
        return other
    numbers = list(dict.fromkeys([*one.numbers.tolist(), *other.numbers.tolist()]))
    (a, a_hz), (b, b_hz) = _in_order(one, numbers), _in_order(other, numbers)
    with np.errstate(invalid="ignore", over="ignore"):
        amplitudes = a + share * (b - a)
    hz = np.where(b > 0.0, b_hz, a_hz)
    return Tones(np.array(numbers, np.int64), amplitudes, hz)


def _in_order(tones: Tones, numbers: Sequence[int]) -> tuple[F64, F64]:
    shape = len(numbers), tones.amplitudes.shape[1]
    amplitudes, hz = np.zeros(shape), np.zeros(shape)
    for k, number in enumerate(tones.numbers.tolist()):
        row = numbers.index(number)
        amplitudes[row], hz[row] = tones.amplitudes[k], tones.frequencies_hz[k]
    return amplitudes, hz
