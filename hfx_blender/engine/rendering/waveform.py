# SPDX-License-Identifier: GPL-3.0-or-later
"""Sines for actuators that are driven as sound: the same ones in files and live.

Amplitude and frequency go straight from one value to the next; the phase is the exact integral of
the frequency, so it never jumps, however the samples are cut into blocks.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def kept_through_silence(amplitudes: tuple[F64, F64], hz: tuple[F64, F64]) -> tuple[F64, F64]:
    """Frequencies at the beginning and the end of ways between two amplitudes.

    A silent end's frequency means nothing: what begins there begins with its own, and what ends
    there ends with its own.

    Parameters
    ----------
    amplitudes, hz : pair of (...) float64
        At the beginning, and at the end.
    """
    first = np.where(amplitudes[0] == 0.0, hz[1], hz[0])
    last = np.where(amplitudes[1] == 0.0, hz[0], hz[1])
    return first, last


def cycles_on_the_way(hz: tuple[F64, F64], share: F64, seconds: float) -> F64:
    """Cycles played since a way began, of which ``share`` (0..1) of ``seconds`` has passed."""
    return np.asarray(share * (hz[0] + (hz[1] - hz[0]) * (share / 2.0)) * seconds)


def sines(amplitudes: tuple[F64, F64], share: F64, cycles: F64) -> F64:
    """Samples at a share of the ways between amplitudes, at so many cycles."""
    amplitude = amplitudes[0] * (1.0 - share) + amplitudes[1] * share
    return np.asarray(amplitude * np.sin(2.0 * np.pi * cycles))


def cycles_since_the_beginning(hz: F64, seconds: float) -> F64:
    """Phase of what begins now, in cycles: as if it had sounded from the beginning of time.

    Vibrations of one frequency are so in phase, and add.
    """
    return np.asarray(hz * seconds % 1.0)
