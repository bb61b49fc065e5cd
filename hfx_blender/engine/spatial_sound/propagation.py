# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects of the way that sound takes through air: absorption of high frequencies, Doppler."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64

SPEED_OF_SOUND_M_S: Final = 343.2  # in air of 20 degC

_HUMIDITY: Final = 50.0  # per cent
_FASTEST: Final = 0.5  # of the speed of sound; what is faster jumps, and is no movement


def absorption_db_m(frequencies_hz: F64) -> F64:
    """Absorption of pure tones in air of 20 degC, 50 % humidity and 101.325 kPa, dB a metre.

    ISO 9613-1, equations 3 to 5 and B.3.
    """
    temperature = 293.15
    vapour = _HUMIDITY * 10.0 ** (4.6151 - 6.8346 * (273.16 / temperature) ** 1.261)  # per cent
    oxygen_hz = 24.0 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour)
    nitrogen_hz = 9.0 + 280.0 * vapour
    squared = np.square(frequencies_hz)
    oxygen = 0.01275 * np.exp(-2239.1 / temperature) / (oxygen_hz + squared / oxygen_hz)
    nitrogen = 0.1068 * np.exp(-3352.0 / temperature) / (nitrogen_hz + squared / nitrogen_hz)
    loss: F64 = 8.686 * squared * (1.84e-11 + oxygen + nitrogen)
    return loss


def doppler_hz(frequencies_hz: F64, distances_m: F64, rate_hz: float) -> F64:
    """Frequencies (n,) as they are heard at distances (n,) at even times; higher coming nearer."""
    if len(distances_m) < 2:
        return frequencies_hz
    away = np.gradient(distances_m) * rate_hz / SPEED_OF_SOUND_M_S
    away = np.where(np.abs(away) <= _FASTEST, away, 0.0)
    return np.asarray(frequencies_hz / (1.0 + away))
