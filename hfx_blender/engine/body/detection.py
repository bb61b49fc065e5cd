# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection thresholds of skin by body part, and strength above them in dB SL (sensation level).

``detection.csv`` holds the published values, with the source of each, and the parts that take the
value of another part. No threshold of wind is listed.
"""

import csv
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from .parts import PARTS

REFERENCE_HZ = 100.0
"""Frequency at which strengths are compared, and that of modalities without a frequency."""

MOST_RAISE = 4.0
"""Largest factor of Equal Feel, 12 dB. Fast vibration on the trunk would need 70 at 500 Hz."""


@cache
def _curves(modality: str) -> dict[str, tuple[F64, F64]]:
    """Frequencies (n,), Hz, and thresholds (n,) by part: dB re 1 um for vibration, else kPa or K.
    Empty for a modality without thresholds."""
    with Path(__file__).with_name("detection.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["modality"] == modality]
    curves: dict[str, tuple[F64, F64]] = {}
    for part in dict.fromkeys(row["part"] for row in rows if row["value"]):
        own = [row for row in rows if row["part"] == part]
        hz = np.array([float(row["frequency_hz"] or REFERENCE_HZ) for row in own])
        values = np.array([float(row["value"]) for row in own])
        if own[0]["unit"] == "dB above fingers":
            # The palm's curve also bends between the frequencies of the part.
            palm_hz, palm_db = curves["hand_palm"]
            every = np.union1d(hz, palm_hz)
            values = _at(every, hz, values) + _at(every, palm_hz, palm_db)
            hz = every
        curves[part] = hz, values
    return curves | {row["part"]: curves[row["taken_from"]] for row in rows if row["taken_from"]}


def _at(wanted_hz: F64, hz: F64, values: F64) -> F64:
    """Values at frequencies, linear in the logarithm of the frequency; the ends continue."""
    return np.interp(np.log(np.maximum(wanted_hz, 1e-3)), np.log(hz), values)


def threshold(modality: str, hz: npt.ArrayLike = REFERENCE_HZ) -> F64:
    """Detection threshold of each of ``PARTS`` at frequencies (...), as (..., parts).

    In m/s^2 (peak), kPa, or K from neutral; NaN for a modality without thresholds.
    """
    frequencies = np.asarray(hz, np.float64)[..., None]
    curves = _curves(modality)
    if not curves:
        return np.full((*frequencies.shape[:-1], len(PARTS)), np.nan)
    values = np.concatenate([_at(frequencies, *curves[part]) for part in PARTS], axis=-1)
    if modality != "vibration":
        return values
    # Peak acceleration of a sine with this peak displacement.
    return np.asarray((2.0 * np.pi * frequencies) ** 2 * 1e-6 * 10.0 ** (values / 20.0))


def level_db(strengths: npt.ArrayLike, thresholds: F64) -> F64:
    """Strengths in dB SL, 0 at the threshold; -inf in silence, NaN without a threshold."""
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.asarray(strengths, np.float64) / thresholds))


def equal_feel_factors(modality: str, thresholds: F64) -> F64:
    """Factors of strengths for equal dB SL, by detection thresholds (...); at most ``MOST_RAISE``.

    1 for NaN, and at the least sensitive part at 100 Hz: the part alone never raises a strength.
    """
    factors = np.minimum(thresholds / threshold(modality).max(), MOST_RAISE)
    return np.where(np.isnan(thresholds), 1.0, factors)
