# SPDX-License-Identifier: GPL-3.0-or-later
"""Logistic psychometric functions: posterior on a grid, for fits and for adaptive levels.

P(x) = guess + (1 - guess - lapse) F((x - threshold) / spread) with the logistic function F. The
threshold is the level at which F is 0.5. Without guessing (guess 0), lapses go to either answer:
P = lapse / 2 + (1 - lapse) F, and the threshold is the point of subjective equality.

Adaptive levels are those of the psi method (Kontsevich and Tyler, Vision Research 1999): the level
with the lowest expected entropy of threshold and spread, lapses marginalised (Prins, 2013).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import entr, expit

from hfx_blender.engine.arrays import F64, I64

_LAPSES: Final = np.array([0.0, 0.01, 0.02, 0.04, 0.07, 0.1])
_LAPSE_PRIOR: Final = (1.0 - _LAPSES) ** 19  # Beta(1, 20): lapses are rare
_SPREAD_SHARE: Final = 0.04  # of the range of levels: centre of the prior
_SPREAD_DECADES: Final = 0.3  # standard deviation of its logarithm
_COVERAGE: Final = 0.95


@dataclass(frozen=True)
class Fit:
    """Psychometric function of answers: posterior medians, with 95 % intervals of the threshold.

    ``threshold`` and its interval are in the unit of the levels; ``spread`` is on the axis of the
    fit (decades for a logarithmic scale). ``is_bounded`` is False for a threshold that the levels
    do not enclose.
    """

    threshold: float
    low: float
    high: float
    spread: float
    lapse: float
    guess: float
    is_logarithmic: bool
    is_bounded: bool

    def share(self, level: float) -> float:
        """Probability of the target's answer at a level."""
        values = np.array([level, self.threshold], np.float64)
        x, t = np.log10(values) if self.is_logarithmic else values
        lowest = self.guess if self.guess else 0.5 * self.lapse
        highest = 1.0 - (self.lapse if self.guess else 0.5 * self.lapse)
        return float(lowest + (highest - lowest) * expit((x - t) / self.spread))


class PsychometricGrid:
    """Posterior of threshold, spread and lapse on a grid, for fixed levels.

    ``levels``: two or more, ascending, above 0 for a logarithmic scale. ``counts``: thresholds and
    spreads of the grid. The prior is flat in threshold; the spread is near 4 % of the range of the
    levels, within a factor of about 2.
    """

    def __init__(
        self,
        levels: Sequence[float],
        *,
        is_logarithmic: bool,
        guess: float,
        counts: tuple[int, int] = (161, 31),
    ) -> None:
        self.is_logarithmic, self.guess = is_logarithmic, guess
        given = np.asarray(levels, np.float64)
        self._x = np.log10(given) if is_logarithmic else given
        extent = float(self._x[-1] - self._x[0])
        margin = 0.1 * extent
        self.thresholds = np.linspace(self._x[0] - margin, self._x[-1] + margin, counts[0])
        shares_of_range = np.geomspace(0.01, 0.3, counts[1])
        self.spreads = extent * shares_of_range
        shares = expit(
            (self._x[:, None, None] - self.thresholds[None, :, None]) / self.spreads[None, None, :]
        )[..., None]
        lapses = _LAPSES[None, None, None, :]
        if guess > 0.0:
            chances = guess + (1.0 - guess - lapses) * shares
        else:
            chances = 0.5 * lapses + (1.0 - lapses) * shares
        # A perfect observer would make one contrary answer impossible.
        self._chances = np.clip(chances, 1e-6, 1.0 - 1e-6)
        deviations = np.log10(shares_of_range / _SPREAD_SHARE) / _SPREAD_DECADES
        self._log_prior = np.broadcast_to(
            np.log(_LAPSE_PRIOR) - 0.5 * deviations[:, None] ** 2, self._chances.shape[1:]
        )
        self._log_yes, self._log_no = np.log(self._chances), np.log1p(-self._chances)
        self._log_posterior = self._log_prior.copy()

    def observe(self, level: int, is_yes: bool) -> None:
        """Update the posterior by an answer at a level, given by index."""
        self._log_posterior += (self._log_yes if is_yes else self._log_no)[level]

    def next_level(self) -> int:
        """Index of the level with the lowest expected entropy; of equal levels the lowest."""
        posterior = self._posterior()
        # Joint probability of the answer and of threshold and spread, lapses marginalised.
        yes = np.einsum("ltsk,tsk->lts", self._chances, posterior)
        no = posterior.sum(axis=2) - yes
        entropy = entr(yes).sum((1, 2)) + entr(no).sum((1, 2))
        # Entropy given the answer: the joint entropy without that of the answer itself.
        entropy -= entr(yes.sum((1, 2))) + entr(no.sum((1, 2)))
        return int(np.argmin(np.round(entropy, 12)))

    def fit(self, yes: I64, total: I64) -> Fit:
        """Fit counts (L,) of answers for the target, of all answers at each level."""
        no = np.asarray(total) - np.asarray(yes)
        self._log_posterior = (
            self._log_prior
            + np.tensordot(np.asarray(yes, np.float64), self._log_yes, 1)
            + np.tensordot(np.asarray(no, np.float64), self._log_no, 1)
        )
        return self.summary()

    def summary(self) -> Fit:
        """Medians and 95 % interval of the present posterior."""
        posterior = self._posterior()
        by_threshold = posterior.sum((1, 2))
        low, middle, high = _quantiles(self.thresholds, by_threshold)
        spread = 10.0 ** _quantiles(np.log10(self.spreads), posterior.sum((0, 2)))[1]
        lapse = float(_LAPSES @ posterior.sum((0, 1)))
        is_inside = (self.thresholds >= self._x[0]) & (self.thresholds <= self._x[-1])
        ends = [10.0**x if self.is_logarithmic else x for x in (middle, low, high)]
        return Fit(
            threshold=float(ends[0]),
            low=float(ends[1]),
            high=float(ends[2]),
            spread=float(spread),
            lapse=lapse,
            guess=self.guess,
            is_logarithmic=self.is_logarithmic,
            is_bounded=bool(by_threshold[is_inside].sum() > _COVERAGE),
        )

    def _posterior(self) -> F64:
        shares = np.exp(self._log_posterior - self._log_posterior.max())
        return np.asarray(shares / shares.sum())


def _quantiles(values: F64, weights: F64) -> tuple[float, float, float]:
    """Lower end, median and upper end of the 95 % interval of weights at even ascending values."""
    # Each weight is spread over the cell around its value.
    edges = np.append(values, values[-1] * 2 - values[-2]) - 0.5 * (values[1] - values[0])
    reached = np.concatenate([[0.0], np.cumsum(weights)])
    tail = 0.5 * (1.0 - _COVERAGE)
    low, middle, high = np.interp([tail, 0.5, 1.0 - tail], reached, edges)
    return float(low), float(middle), float(high)


def staircase(levels: Sequence[float], *, is_logarithmic: bool, guess: float) -> PsychometricGrid:
    """Coarse grid for the choice of levels, quick enough between two trials."""
    return PsychometricGrid(levels, is_logarithmic=is_logarithmic, guess=guess, counts=(61, 11))


def counted(answers: Iterable[tuple[float, bool]], levels: Sequence[float]) -> tuple[I64, I64]:
    """Counts (L,) of answers for the target and of all answers, by level."""
    index = {level: k for k, level in enumerate(levels)}
    yes, total = np.zeros(len(levels), np.int64), np.zeros(len(levels), np.int64)
    for level, is_yes in answers:
        total[index[level]] += 1
        yes[index[level]] += is_yes
    return yes, total
