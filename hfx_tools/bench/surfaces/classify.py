# SPDX-License-Identifier: GPL-3.0-or-later
"""Classification of materials by rendered signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.texture.stroke_rendering import StrokeSignal

_QUANTILES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)
_LAGS_S: Final = (0.005, 0.01, 0.02, 0.04)


def features(signal: StrokeSignal) -> F64:
    """Feature vector of a signal, independent of its mean level, (14,).

    Log mean and spread of frequency, shape of the amplitude's distribution, and autocorrelation of
    the amplitude at four lags.
    """
    level = signal.amplitude_m_s2
    mean = float(level.mean())
    shape = level / mean if mean > 0.0 else np.ones_like(level)
    is_perceptible = level > 0.0
    octaves = (
        np.log2(np.maximum(signal.frequency_hz[is_perceptible], 1.0))
        if is_perceptible.any()
        else np.zeros(1)
    )
    centred = shape - 1.0
    spread = float(centred.std())
    skew = float(np.mean(centred**3)) / spread**3 if spread > 1e-9 else 0.0
    return np.array(
        [
            3.0 * octaves.mean(),  # an octave weighs like the whole range of another feature
            3.0 * octaves.std(),
            np.log(spread + 0.02),
            np.clip(skew, -3.0, 3.0) / 3.0,
            np.mean(np.abs(np.diff(shape))),
            *np.quantile(shape, _QUANTILES),
            *(_likeness(centred, max(round(lag / signal.step_s), 1)) for lag in _LAGS_S),
        ]
    )


def _likeness(centred: F64, lag: int) -> float:
    power = float(np.mean(centred**2))
    if power <= 1e-12 or lag >= len(centred):
        return 0.0
    return float(np.mean(centred[lag:] * centred[:-lag])) / power


@dataclass(frozen=True, eq=False)
class NearestNeighbour:
    """Nearest-neighbour classifier with features scaled by their spread."""

    known: F64  # (N, k)
    labels: I64  # (N,)
    names: tuple[str, ...]

    @classmethod
    def of(cls, examples: Sequence[tuple[str, StrokeSignal]]) -> NearestNeighbour:
        """Train on named signals."""
        names = tuple(dict.fromkeys(name for name, _ in examples))
        return cls(
            np.array([features(signal) for _, signal in examples]),
            np.array([names.index(name) for name, _ in examples]),
            names,
        )

    def classify(self, signals: Sequence[StrokeSignal]) -> list[str]:
        """Name of the nearest example for each signal."""
        vectors = np.array([features(signal) for signal in signals])
        spread = self.known.std(axis=0)
        scale = 1.0 / np.where(spread > 0.0, spread, 1.0)
        away = np.square((vectors[:, None] - self.known[None]) * scale).sum(axis=2)
        return [self.names[k] for k in self.labels[np.argmin(away, axis=1)]]


def confusion(truth: Sequence[str], guesses: Sequence[str], names: Sequence[str]) -> I64:
    """Confusion matrix (k, k): counts of each true name (row) classified as each name (column)."""
    table = np.zeros((len(names), len(names)), np.int64)
    for true, guess in zip(truth, guesses, strict=True):
        table[names.index(true), names.index(guess)] += 1
    return table
