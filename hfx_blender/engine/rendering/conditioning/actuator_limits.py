# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits of actuators: range, allowed values, latency and update interval."""

from fractions import Fraction
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from ...arrays import F64, I64
from ..device_config import ActuatorType, DeviceConfig

_ROUNDING: Final = 1e-6
"""Share by which a value may miss an allowed value: weights are of single precision."""


def limited(
    values: npt.ArrayLike, lowest: npt.ArrayLike, highest: npt.ArrayLike, silent: npt.ArrayLike
) -> F64:
    """Clip values (..., P) of an actuator to ``lowest`` and ``highest``, both included. If any of
    the P parameters is NaN or infinite, all become ``silent``. Limits and ``silent`` are (P,) or
    broadcastable."""
    values = np.asarray(values, np.float64)
    # Before clipping, as a minimum or maximum alone would turn NaN or infinity into full power.
    is_number = np.isfinite(values).all(axis=-1, keepdims=True)
    return np.clip(np.where(is_number, values, silent), lowest, highest)


def rounded(values: F64, kind: ActuatorType) -> F64:
    """Round finite values (..., P) within limits to allowed values; itself where all are allowed. A
    strength is rounded towards neutral, a frequency down, or to the lowest allowed frequency. With
    P = 1 ``values`` are strengths alone."""
    if not kind.is_stepped:
        return values
    values = values.copy()
    for column, control in enumerate(kind.controls[: values.shape[-1]]):
        if not control.values:
            continue
        allowed, wanted = np.array(control.values), values[..., column]
        margins = _ROUNDING * np.abs(allowed)
        below = np.searchsorted(allowed - margins, wanted, side="right") - 1
        down = allowed[np.maximum(below, 0)]
        if column == 0:  # a strength below neutral, as of cooling
            above = np.searchsorted(allowed + margins, wanted, side="left")
            up = allowed[np.minimum(above, len(allowed) - 1)]
            down = np.where(wanted < control.neutral, up, down)
        values[..., column] = down
    return values


class DeviceLimits:
    """Ranges of all A actuators of a device, with up to P controls each. An actuator with fewer
    controls repeats its strength. Neutral values are the attributes ``neutral`` (columns,) and, by
    actuator with the strength first, ``silent`` (A, P)."""

    def __init__(self, device: DeviceConfig) -> None:
        kinds = [actuator.type for actuator in device.actuators]
        controls = device.controls
        self.neutral: F64 = device.neutral
        counts = np.array([len(kind.controls) for kind in kinds])
        places = np.arange(counts.max())
        # A column for each control, so that all actuators are clipped by one array operation.
        self._columns: I64 = device.strength_columns[:, None] + np.where(
            places < counts[:, None], places, 0
        )
        self._lowest = np.array([c.lowest for c in controls], np.float64)[self._columns]
        self._highest = np.array([c.highest for c in controls], np.float64)[self._columns]
        self.silent: F64 = self.neutral[self._columns]
        self._stepped = [(k, kind) for k, kind in enumerate(kinds) if kind.is_stepped]

    def by_actuator(self, values: F64) -> F64:
        """Values (columns,) as (A, P), limited; fewer controls than P repeat the strength."""
        return limited(values[self._columns], self._lowest, self._highest, self.silent)

    def rounded(self, values: F64) -> F64:
        """Copy of limited values (A, P) of all actuators, rounded to allowed values."""
        values = values.copy()
        for k, kind in self._stepped:
            part = slice(len(kind.controls))
            values[k, part] = rounded(values[k, part], kind)
        return values

    def joined(self, values: F64) -> F64:
        """New array (columns,) of values (A, P): P parameters of each of A actuators. Actuators
        with fewer parameters repeat their strength in ``values``; the repetitions are dropped."""
        columns = np.zeros_like(self.neutral)
        for index in reversed(range(values.shape[1])):  # the strength last, over its repetitions
            columns[self._columns[:, index]] = values[:, index]
        return columns


def advanced(values: F64, neutral: F64, latency_rows: int) -> F64:
    """Rows (T, P) of one actuator, ``latency_rows`` earlier, ``neutral`` last. Values of the first
    ``latency_rows`` would have to be sent before. Such values stay at their own rows, if these are
    otherwise neutral, and are felt late. Returns ``values`` itself without a latency."""
    rows = min(latency_rows, len(values))
    if not rows:
        return values
    early = np.concatenate([values[rows:], np.tile(neutral, (rows, 1))])
    # Values too late to be advanced go where nothing else is played.
    is_free = (early[:rows] == neutral).all(axis=1)
    early[:rows][is_free] = values[:rows][is_free]
    return early


@lru_cache(maxsize=64)
def rows_of(rate_hz: Fraction, latency_ms: float) -> int:
    """Latency in rows, rounded to the nearest, halves up."""
    return int(Fraction(latency_ms) / 1000 * rate_hz + Fraction(1, 2))


def held(values: F64, neutral: F64, rate_hz: Fraction, interval_ms: float) -> F64:
    """Hold rows (T, P) over update intervals: each interval takes the strongest row.

    Intervals start at the first row; a row belongs to the interval of its start. Strength is the
    deviation of column 0 from ``neutral[0]``; the first of equal rows counts. A contact shorter
    than an interval keeps its peak; a value comes at most an interval early. Returns ``values``
    itself if an interval is no longer than a row.
    """
    numerator, denominator = _interval(rate_hz, interval_ms)
    if numerator <= denominator or not len(values):
        return values
    # Whole numbers: floats would put a row on a border into either interval.
    intervals = np.arange(len(values), dtype=np.int64) * denominator // numerator
    deviation = np.abs(values[:, 0] - neutral[0])
    # Stable sort: by interval, then the strongest first, then the earliest.
    order = np.lexsort((-deviation, intervals))
    peaks = order[np.flatnonzero(np.diff(intervals[order], prepend=-1))]
    return np.asarray(values[peaks[intervals]])


@lru_cache(maxsize=64)
def _interval(rate_hz: Fraction, interval_ms: float) -> tuple[int, int]:
    """Rows in an update interval as (numerator, denominator); approximated for long fractions."""
    rows = Fraction(interval_ms) / 1000 * rate_hz
    if rows.numerator >= 1 << 31:  # an interval such as 33.3 ms is a long binary fraction
        rows = rows.limit_denominator(1 << 16)
    return rows.as_integer_ratio()
