# SPDX-License-Identifier: GPL-3.0-or-later
"""Tones: several sines at once at actuators that take a waveform, in live output.

Such an actuator plays the sum of the tones, as in an exported WAV. A *frame* is a row of numbers:
the values (columns,) of the device; then the number, W amplitudes and W frequencies
of each tone, for W actuators with a waveform.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...engine.arrays import F64, I64
from ...engine.rendering.conditioning.frequency import Partial
from ...engine.rendering.device_config import DeviceConfig

MAX_TONES: Final = 16
"""Largest number of tones at once; of more, the strongest are played."""

LONE: Final = -1
"""Number of the single tone made from values without tones: of a script, or of a test pulse."""

# Frequencies that differ by less are merged into one tone.
_ALIKE_HZ: Final = 1.0


@dataclass(frozen=True, eq=False)
class Tones:
    """K tones at W actuators; equal numbers in successive frames continue the same sine."""

    numbers: I64  # (K,)
    amplitudes: F64  # (K, W) m/s^2; for an output, shares of full scale
    frequencies_hz: F64  # (K, W)

    @classmethod
    def none(cls, width: int) -> "Tones":
        """No tones, at ``width`` actuators."""
        return cls(np.zeros(0, np.int64), np.zeros((0, width)), np.zeros((0, width)))


def of_partials(partials: Iterable[Partial], numbers: Mapping[str, int], width: int) -> Tones:
    """Tones of a moment; partials of the same effect or of equal frequency are merged.

    At most :data:`MAX_TONES`, the strongest first; silent partials are left out.

    ``partials``: partials of a single row at W = ``width`` actuators.
    ``numbers``: tone numbers by effect id; a merged tone has the number of the first effect.
    """
    merged: list[tuple[int, F64, F64]] = []
    for partial in partials:
        amplitudes, hz = partial.amplitudes[0], partial.frequencies_hz[0]
        if not amplitudes.any():
            continue
        # A partial joins the first tone of its effect, or of equal frequency at all actuators
        # where it sounds.
        for k, (number, sum_, sum_hz) in enumerate(merged):
            sounds = amplitudes > 0.0
            differs = np.abs(hz - sum_hz.max())[sounds].max() > _ALIKE_HZ
            if number == numbers[partial.effect_id] or not differs:
                # Merged amplitudes add, the frequency is that of the first partial that sounds.
                both_hz = np.where(sum_ > 0.0, sum_hz, hz)
                merged[k] = number, sum_ + amplitudes, both_hz
                break
        else:
            merged.append((numbers[partial.effect_id], amplitudes, hz))
    # Without the weakest tones, so that a frame has a bound.
    merged = sorted(merged, key=lambda tone: -float(tone[1].max()))[:MAX_TONES]
    if not merged:
        return Tones.none(width)
    return Tones(
        np.array([number for number, _, _ in merged], np.int64),
        np.stack([amplitudes for _, amplitudes, _ in merged]),
        np.stack([hz for _, _, hz in merged]),
    )


def frame_of(values: F64, tones: Tones) -> F64:
    """Row of ``values`` (columns,), then for each tone number, W amplitudes and W frequencies."""
    rows = np.column_stack((tones.numbers, tones.amplitudes, tones.frequencies_hz))
    return np.concatenate([values, rows.ravel()])


class Sounding:
    """Tones of a device's W actuators that take a waveform, ramped and limited.

    W is 0 for most devices; then all methods pass values through.
    """

    def __init__(self, device: DeviceConfig) -> None:
        members = [k for k, actuator in enumerate(device.actuators) if actuator.type.takes_waveform]
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
        """Set no tones as start, target and last tones of the ramp."""
        self._from = self._to = self._here = Tones.none(len(self))

    def fault_of(self, frame: F64) -> str:
        """Message for a frame with a wrong number of entries; "" for values with 0 to 16 tones."""
        columns, width = self._column_count, 1 + 2 * len(self)
        more = np.size(frame) - columns if np.ndim(frame) == 1 else -1
        is_of_tones = len(self) and 0 < more <= MAX_TONES * width and more % width == 0
        if more == 0 or is_of_tones:
            return ""
        return f"it was sent {np.size(frame)} values and takes {columns}"

    def split(self, frame: F64) -> F64:
        """Set the tones of a new frame as the ramp's target; return the frame's values (columns,).

        A frame without tones sets the tone :data:`LONE` of the values.

        Raises ValueError: the frame has a wrong number of entries.
        """
        if fault := self.fault_of(frame):
            raise ValueError(fault)
        values = frame[: self._column_count]
        if not len(self):
            return values
        rows = frame[self._column_count :].reshape(-1, 1 + 2 * len(self))
        count = len(rows)
        # Numbers of a faulty worker must not raise here; amplitudes are limited in any case.
        numbers = np.nan_to_num(rows[:, 0]).astype(np.int64)
        tones = Tones(numbers, rows[:, 1 : 1 + len(self)], rows[:, 1 + len(self) :])
        self._from, self._to = self._here, tones if count else self._plain_tones(values)
        return values

    def totals(self, share: float, wanted: F64) -> F64:
        """Values (columns,) for the guard, at least as strong as the root of the sum of squares of
        the tones.

        Otherwise strong tones with weak values would pass the limits.
        ``share`` is that of the ramp, 0..1. Returns a copy, or ``wanted`` itself without waveforms.
        """
        if not len(self):
            return wanted
        here = _between(self._from, self._to, share)
        is_finite = np.isfinite(here.amplitudes) & np.isfinite(here.frequencies_hz)
        totals = np.where(is_finite, np.maximum(here.amplitudes, 0.0), 0.0)
        # Sines of different frequencies add in power.
        totals = np.sqrt((np.minimum(totals, self._highest) ** 2).sum(axis=0))
        strengths = wanted[self.columns]
        raised = wanted.copy()
        raised[self.columns] = np.where(strengths > 0.0, np.maximum(strengths, totals), strengths)
        return raised

    def at(self, share: float, wanted: F64, passed: F64) -> Tones:
        """Tones to send at a share of the ramp, limited by the guard and to each actuator's range.

        Actuators without a tone get the single tone :data:`LONE` of their values, as of a test
        pulse. The tones before the limits are the start of the next ramp.

        ``share``: share of the ramp to the newest frame, 0..1.
        ``wanted``, ``passed`` (columns,): values before the guard, as returned by :meth:`totals`,
        and after the guard; amplitudes are scaled by the ratio.
        """
        self._here = _between(self._from, self._to, share)
        requested, limited_ = wanted[self.columns], passed[self.columns]
        finite = np.isfinite(self._here.amplitudes) & np.isfinite(self._here.frequencies_hz)
        amplitudes = np.where(finite, np.maximum(self._here.amplitudes, 0.0), 0.0)
        hz = np.where(finite, self._here.frequencies_hz, 0.0)
        plays = (requested > 0.0) & np.isfinite(requested)
        with np.errstate(over="ignore", invalid="ignore"):
            # All tones of an actuator are scaled by the share of its strength that passed the
            # guard.
            amplitudes *= np.where(plays, limited_ / np.where(plays, requested, 1.0), 0.0)
        amplitudes = np.minimum(np.nan_to_num(amplitudes), self._highest)
        # Actuators without a sounding tone: what passed the guard comes from plain values.
        alone = self._plain_tones(passed)
        is_alone = ~amplitudes.any(axis=0)
        numbers = self._here.numbers
        if LONE not in numbers:
            numbers = np.append(numbers, LONE)
            amplitudes, hz = (np.vstack([rows, np.zeros(len(self))]) for rows in (amplitudes, hz))
        row = numbers.tolist().index(LONE)
        amplitudes[row, is_alone] = alone.amplitudes[0, is_alone]
        hz[row, is_alone] = alone.frequencies_hz[0, is_alone]
        # A sum of sines may reach the sum of their amplitudes, which the range has to hold.
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
        """Tone :data:`LONE` of values (columns,): amplitude and frequency of each actuator."""
        return Tones(
            np.array([LONE], np.int64), values[None, self.columns], values[None, self.columns + 1]
        )


def _between(start: Tones, end: Tones, share: float) -> Tones:
    """Tones between two sets, of all numbers of both: amplitudes interpolate, frequencies jump. A
    tone of a single set fades in or out at a constant frequency."""
    # The end of the ramp drops tones that have faded out.
    if share >= 1.0:
        return end
    # Rows of both sets in a common order; 0 where a set lacks a tone.
    numbers = list(dict.fromkeys([*start.numbers.tolist(), *end.numbers.tolist()]))
    rows = np.zeros((2, 2, len(numbers), start.amplitudes.shape[1]))
    for tones, (amplitudes, hz) in zip((start, end), rows, strict=True):
        at = [numbers.index(number) for number in tones.numbers.tolist()]
        amplitudes[at], hz[at] = tones.amplitudes, tones.frequencies_hz
    (a, a_hz), (b, b_hz) = rows
    with np.errstate(invalid="ignore", over="ignore"):
        amplitudes = a + share * (b - a)
    # Frequencies jump, as in pacing.Ramp; the sound card smooths the change within 5 ms.
    hz = np.where(b > 0.0, b_hz, a_hz)
    return Tones(np.array(numbers, np.int64), amplitudes, hz)
