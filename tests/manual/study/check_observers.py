# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated observers of studies: thresholds, coverage of intervals, false alarms.

``python tests/manual/study/check_observers.py --observers 1000 --studies 2000`` takes ten minutes.
With the package choix installed, Bradley-Terry strengths are compared with its results.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable
from itertools import combinations

import numpy as np
from scipy.special import expit

from hfx_tools.study.design import trials_of
from hfx_tools.study.plan import read_plan
from hfx_tools.study.psychometric import Fit, PsychometricGrid, staircase
from hfx_tools.study.statistics import bradley_terry, compared, friedman, mean_interval, share_of

LEVELS = np.geomspace(0.01, 1.0, 21)
GRID_LEVELS = LEVELS.tolist()


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


class Observer:
    """Observer with a logistic psychometric function on decades, or on plain levels."""

    def __init__(self, rng: np.random.Generator, guess: float) -> None:
        self._rng, self._guess = rng, guess
        self.threshold = float(rng.uniform(-1.6, -0.4))  # decades
        self._spread = float(rng.uniform(0.06, 0.16))
        self._lapse = float(rng.choice([0.0, 0.01, 0.02, 0.03]))

    def answers(self, level: float) -> bool:
        share = expit((np.log10(level) - self.threshold) / self._spread)
        if self._guess:
            chance = self._guess + (1.0 - self._guess - self._lapse) * share
        else:
            chance = 0.5 * self._lapse + (1.0 - self._lapse) * share
        return bool(self._rng.random() < chance)


def adaptive(observer: Observer, trials: int, guess: float, grid: PsychometricGrid) -> Fit:
    """Threshold of a staircase, fitted as the report does."""
    stairs = staircase(GRID_LEVELS, is_logarithmic=True, guess=guess)
    yes, total = np.zeros(len(LEVELS), np.int64), np.zeros(len(LEVELS), np.int64)
    for _ in range(trials):
        level = stairs.next_level()
        is_yes = observer.answers(LEVELS[level])
        stairs.observe(level, is_yes)
        yes[level] += is_yes
        total[level] += 1
    return grid.fit(yes, total)


def constant(observer: Observer, repetitions: int, guess: float, grid: PsychometricGrid) -> Fit:
    """Threshold of constant levels, every third of them."""
    yes, total = np.zeros(len(LEVELS), np.int64), np.zeros(len(LEVELS), np.int64)
    for level in range(0, len(LEVELS), 3):
        total[level] = repetitions
        yes[level] = sum(observer.answers(LEVELS[level]) for _ in range(repetitions))
    return grid.fit(yes, total)


def check_thresholds(count: int) -> None:
    """Print median factor and coverage of each method."""
    methods: tuple[tuple[str, float, Callable[..., Fit], int], ...] = (
        ("staircase of 40, guess 0.5", 0.5, adaptive, 40),
        ("staircase of 80, guess 0.5", 0.5, adaptive, 80),
        ("staircase of 40, equality", 0.0, adaptive, 40),
        ("constant, 7 x 20, guess 0.5", 0.5, constant, 20),
        ("constant, 7 x 12, equality", 0.0, constant, 12),
    )
    for title, guess, method, number in methods:
        rng = np.random.default_rng(7)
        grid = PsychometricGrid(GRID_LEVELS, is_logarithmic=True, guess=guess)
        factors, covered = [], 0
        for _ in range(count):
            observer = Observer(rng, guess)
            fit = method(observer, number, guess, grid)
            factors.append(fit.threshold / 10.0**observer.threshold)
            covered += fit.low <= 10.0**observer.threshold <= fit.high
        _say(
            f"{title}: median factor {np.median(factors):.3f}, quartiles "
            f"{np.percentile(factors, 25):.2f} to {np.percentile(factors, 75):.2f}, "
            f"95 % intervals cover {100.0 * covered / count:.1f} %"
        )


def _null_wins(rows: list[tuple[int, int]], rng: np.random.Generator) -> np.ndarray:
    wins = np.zeros((3, 3), np.int64)
    for first, second in rows:
        winner, loser = (first, second) if rng.random() < 0.5 else (second, first)
        wins[winner, loser] += 1
    return wins


def check_false_alarms(count: int) -> None:
    """Print the share of null studies with p below 0.05, by test."""
    rng = np.random.default_rng(11)
    plan = read_plan("mango96")
    schemes = list(plan.compare["scheme"])
    rows = [
        (schemes.index(row["scheme_first"]), schemes.index(row["scheme_second"]))
        for row in trials_of(plan, 1)
    ]
    alarms = dict.fromkeys(
        (
            "Bradley-Terry, mango96 with 18",
            "binomial, a pair of mango96 with 18",
            "binomial, board with 30",
            "Friedman, 5 steps, 18 x 3",
            "Friedman, 7 steps, 12 x 4",
            "Friedman, adjustment, 13 x 6",
            "Wilcoxon, adjustment, 20 x 2",
            "interval of Student, 13",
        ),
        0,
    )
    for _ in range(count):
        wins = _null_wins(rows * 18, rng)
        ratings = [
            friedman(np.clip(np.round(rng.normal(0.5 * steps, 1.4, shape)), 1, steps))
            for steps, shape in ((5, (18, 3)), (7, (12, 4)))
        ]
        values = (
            bradley_terry(wins).p,
            share_of(int(wins[0, 1]), int(wins[0, 1] + wins[1, 0])).p,
            share_of(int(rng.binomial(480, 0.25)), 480, 0.25).p,
            ratings[0][1],
            ratings[1][1],
            friedman(rng.normal(0.0, 1.0, (13, 6)))[1],
            compared(rng.normal(0.0, 1.0, (20, 2))).pairs[0].p,
        )
        for name, p in zip(alarms, values, strict=False):
            alarms[name] += p < 0.05
        _, low, high = mean_interval(rng.normal(0.0, 1.0, 13))
        alarms["interval of Student, 13"] += not low <= 0.0 <= high
    for name, number in alarms.items():
        _say(f"false alarms, {name}: {100.0 * number / count:.2f} %")


def check_intervals(count: int) -> None:
    """Print the coverage of Bradley-Terry strengths and of shares."""
    rng = np.random.default_rng(13)
    strengths = np.array([-0.6, 0.1, 0.5])
    covered = shares_covered = 0
    for _ in range(count):
        wins = np.zeros((3, 3), np.int64)
        for a, b in combinations(range(3), 2):
            wins[a, b] = rng.binomial(64, expit(strengths[a] - strengths[b]))
            wins[b, a] = 64 - wins[a, b]
        model = bradley_terry(wins)
        covered += int(np.sum(np.abs(model.strengths - strengths) <= 1.959964 * model.errors))
        share = share_of(int(rng.binomial(96, 0.7)), 96)
        shares_covered += share.low <= 0.7 <= share.high
    _say(f"Bradley-Terry intervals cover {100.0 * covered / (3 * count):.1f} %")
    _say(f"Wilson intervals of 96 trials cover {100.0 * shares_covered / count:.1f} %")


def check_choix(count: int) -> None:
    """Print the largest difference from choix over random tables of 3 to 8 items."""
    if importlib.util.find_spec("choix") is None:
        _say("choix is not installed")
        return
    import choix

    rng, largest = np.random.default_rng(17), 0.0
    for _ in range(count):
        items = int(rng.integers(3, 9))
        strengths = rng.normal(0.0, 1.0, items)
        data = []
        for a, b in combinations(range(items), 2):
            for _ in range(int(rng.integers(4, 40))):
                is_first = rng.random() < expit(strengths[a] - strengths[b])
                data.append((a, b) if is_first else (b, a))
        wins = np.zeros((items, items), np.int64)
        for winner, loser in data:
            wins[winner, loser] += 1
        model = bradley_terry(wins)
        if model.is_finite:
            reference = choix.opt_pairwise(items, data, alpha=0.0, method="Newton-CG", tol=1e-10)
            difference = np.abs(model.strengths - (reference - reference.mean())).max()
            largest = max(largest, float(difference))
    _say(f"largest difference from choix: {largest:.1e}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--observers", type=int, default=1000)
    parser.add_argument("--studies", type=int, default=2000)
    options = parser.parse_args()
    check_choix(options.studies // 10)
    check_intervals(options.studies)
    check_false_alarms(options.studies)
    check_thresholds(options.observers)


if __name__ == "__main__":
    main()
