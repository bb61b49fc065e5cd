# SPDX-License-Identifier: GPL-3.0-or-later
"""Latency compensation: values are sent earlier by an actuator's latency."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np

from ...arrays import F64


def advanced(values: F64, neutral: F64, rate_hz: Fraction, latency_ms: float) -> F64:
    """Rows that come earlier by an actuator's latency, to the nearest row.

    What should be felt within the latency after the first row would have to begin before it.
    There it is given at its own time, where nothing else is, and felt as late as the actuator
    answers.

    Parameters
    ----------
    values : (T, P) float64
        Controls of one actuator.
    neutral : (P,) float64
        What is given at the end, when nothing follows.
    rate_hz : Fraction
        Of the rows.

    Returns
    -------
    (T, P) float64
        ``values`` itself if the latency is less than half a row.
    """
    rows = min(rows_of(rate_hz, latency_ms), len(values))
    if not rows:
        return values
    early = np.concatenate([values[rows:], np.tile(neutral, (rows, 1))])
    is_free = (early[:rows] == neutral).all(axis=1)
    early[:rows][is_free] = values[:rows][is_free]
    return early


@lru_cache(maxsize=64)
def rows_of(rate_hz: Fraction, latency_ms: float) -> int:
    """A latency in rows, rounded to the nearest, halves up."""
    return int(Fraction(latency_ms) / 1000 * rate_hz + Fraction(1, 2))
