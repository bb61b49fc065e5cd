# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests and estimates of studies: shares, paired comparisons, repeated measures, information."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy import stats

from hfx_blender.engine.arrays import F64, I64, Bool

LEVEL: Final = 0.95
"""Level of all intervals."""

_STEPS: Final = 100
_ENOUGH: Final = 1e-13


@dataclass(frozen=True)
class Share:
    """Share of successes with Wilson's interval, and the exact two-sided binomial test."""

    successes: int
    total: int
    share: float  # NaN for no trials
    low: float
    high: float
    p: float


def share_of(successes: int, total: int, chance: float = 0.5) -> Share:
    """Share of successes, tested against ``chance``; NaN and 0 to 1 for no trials."""
    if not total:
        return Share(0, 0, math.nan, 0.0, 1.0, 1.0)
    test = stats.binomtest(successes, total, chance)
    ends = test.proportion_ci(LEVEL, method="wilson")
    share = successes / total
    return Share(successes, total, share, float(ends.low), float(ends.high), float(test.pvalue))


def holm(values: Sequence[float]) -> list[float]:
    """P values after Holm's step-down correction, in the order given; NaN stays NaN."""
    order = [k for k in np.argsort(values, kind="stable").tolist() if not math.isnan(values[k])]
    corrected, highest = [math.nan] * len(values), 0.0
    for rank, k in enumerate(order):
        highest = max(highest, min((len(order) - rank) * values[k], 1.0))
        corrected[k] = highest
    return corrected


@dataclass(frozen=True, eq=False)
class BradleyTerry:
    """Strengths (n,) of a Bradley-Terry model, mean 0: the logarithm of odds to be preferred.

    ``errors`` (n,) are standard errors; ``p`` is of the likelihood ratio test of equal strengths.
    ``is_finite`` is False where some items were never, or always, preferred to the rest: strengths
    and errors are NaN then.
    """

    strengths: F64
    errors: F64
    statistic: float
    p: float
    is_finite: bool


def bradley_terry(wins: I64) -> BradleyTerry:
    """Maximum likelihood fit of ``wins`` (n, n): how often the row was preferred to the column."""
    wins = np.asarray(wins, np.float64)
    count = len(wins)
    unknown = np.full(count, np.nan)
    if not _is_strongly_connected(wins > 0.0):
        return BradleyTerry(unknown, unknown, math.nan, math.nan, False)
    totals = wins + wins.T
    strengths = np.zeros(count)
    inverse = np.zeros((count, count))
    for _ in range(_STEPS):
        chances = 1.0 / (1.0 + np.exp(strengths[None, :] - strengths[:, None]))
        gradient = (wins - totals * chances).sum(axis=1)
        weights = totals * chances * chances.T
        information = np.diag(weights.sum(axis=1)) - weights
        # Strengths are defined up to a constant; the pseudo-inverse keeps their mean at 0.
        inverse = np.linalg.pinv(information, hermitian=True)
        step = inverse @ gradient
        # Short steps far from the maximum: Newton's method could overshoot.
        strengths += step * min(1.0, 2.0 / max(float(np.abs(step).max()), 1e-300))
        if np.abs(step).max() < _ENOUGH:
            break
    strengths -= strengths.mean()
    chances = 1.0 / (1.0 + np.exp(strengths[None, :] - strengths[:, None]))
    with np.errstate(divide="ignore", invalid="ignore"):
        fitted = float(np.sum(np.where(wins > 0.0, wins * np.log(chances), 0.0)))
    equal = float(wins.sum()) * math.log(0.5)
    statistic = max(2.0 * (fitted - equal), 0.0)
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    p = float(stats.chi2.sf(statistic, count - 1))
    return BradleyTerry(strengths, errors, statistic, p, True)


def _is_strongly_connected(edges: Bool) -> bool:
    """Test that every node (n, n) leads to every other one; True for a single node."""
    reach = np.eye(len(edges), dtype=np.bool_) | edges
    for _ in range(max(len(edges), 1).bit_length()):
        reach = reach @ reach
    return bool(reach.all())


@dataclass(frozen=True, eq=False)
class PairTest:
    """Wilcoxon's signed-rank test of two conditions, by index; ``p_holm`` among all pairs."""

    first: int
    second: int
    difference: float  # median of second minus first
    p: float
    p_holm: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Conditions compared within participants: Friedman's test, and Wilcoxon's with Holm.

    ``statistic``, ``p`` and Kendall's ``w`` are NaN for fewer than 3 conditions or 2 participants.
    """

    participants: int
    statistic: float
    p: float
    w: float
    pairs: tuple[PairTest, ...]


def compared(table: F64) -> Comparison:
    """Compare the conditions of a table (participants, conditions); rows with NaN are left out."""
    complete = table[np.isfinite(table).all(axis=1)]
    count, conditions = complete.shape
    statistic, p, w = friedman(complete)
    pairs = list(combinations(range(conditions), 2)) if count else []
    values = [_wilcoxon(complete[:, second] - complete[:, first]) for first, second in pairs]
    tests = tuple(
        PairTest(first, second, float(np.median(complete[:, second] - complete[:, first])), p, q)
        for (first, second), p, q in zip(pairs, values, holm(values), strict=True)
    )
    return Comparison(count, statistic, p, w, tests)


def friedman(table: F64) -> tuple[float, float, float]:
    """Statistic, p value and Kendall's W of Friedman's test of a complete table (participants,
    conditions); NaN for fewer than 3 conditions or 2 participants, and for equal conditions."""
    count, conditions = table.shape
    if conditions < 3 or count < 2 or not np.ptp(table, axis=1).any():
        return math.nan, math.nan, math.nan
    result = stats.friedmanchisquare(*table.T)
    statistic = float(result.statistic)
    return statistic, float(result.pvalue), statistic / (count * (conditions - 1))


def _wilcoxon(differences: F64) -> float:
    """P value of the signed-rank test, zeros left out (Wilcoxon); 1 if all are 0."""
    differences = differences[differences != 0.0]
    return float(stats.wilcoxon(differences).pvalue) if len(differences) else 1.0


def mean_interval(values: F64) -> tuple[float, float, float]:
    """Mean of finite values with Student's interval; NaN ends for fewer than two values."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return (float(values.mean()) if len(values) else math.nan), math.nan, math.nan
    mean = float(values.mean())
    error = float(values.std(ddof=1)) / math.sqrt(len(values))
    reach = float(stats.t.ppf(0.5 + 0.5 * LEVEL, len(values) - 1)) * error
    return mean, mean - reach, mean + reach


def information_bits(table: I64) -> float:
    """Transmitted information of a confusion table, bits (Miller 1955, without bias correction)."""
    total = float(table.sum())
    if not total:
        return math.nan
    joint = table / total
    expected = np.outer(joint.sum(axis=1), joint.sum(axis=0))
    present = joint > 0.0
    return float(np.sum(joint[present] * np.log2(joint[present] / expected[present])))
