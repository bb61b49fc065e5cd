# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a participant: the cells of a plan in a balanced order that depends on the seed only.

Orders are Williams squares (Williams, Aust. J. Sci. Res. 1949): every condition stands once at each
position, and follows every other condition equally often, over the participants of a full square.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from itertools import combinations as pairs_of
from typing import TypeVar

from .plan import Conditions, Plan, Value

Trial = dict[str, Value]
"""Row of the table of trials: value by column."""

T = TypeVar("T")

FIRST, SECOND = "first", "second"


def columns_of(plan: Plan) -> list[str]:
    """Columns of the table of trials, in order."""
    columns = ["trial", "kind", *plan.factors, *plan.random]
    if plan.design == "paired":
        return columns + [f"{name}_{side}" for name in plan.compare for side in (FIRST, SECOND)]
    if plan.design == "adjustment":
        return [*columns, "start"]
    if plan.design == "staircase":
        columns.append("staircase")
    return [*columns, plan.level_factor, "target"] if plan.level_factor else columns


def trials_of(plan: Plan, participant: int) -> list[Trial]:
    """Trials of a participant, counted from 1, with catch trials of the kind "catch" between."""
    rng = _Shuffler(f"{plan.seed}/{participant}")
    rows = _rows(plan, participant, rng)
    rows = _ordered(plan, rows, participant, rng)
    _draw(plan, rows, rng)
    for number in rng.sample(range(len(rows)), plan.catch)[::-1]:
        rows.insert(number + 1, _catch(plan, rows[number]))
    return [{"trial": k, "kind": "trial", **row} for k, row in enumerate(rows, 1)]


def training_of(plan: Plan, participant: int) -> list[Trial]:
    """Trials of the training, of the kind "training": a random choice of a participant's trials."""
    rng = _Shuffler(f"{plan.seed}/{participant}/training")
    rows: list[Trial] = []
    while len(rows) < plan.training:
        trials = [row for row in _rows(plan, participant, rng) if row.get("kind") != "catch"]
        rows += rng.shuffled(trials)
    rows = rows[: plan.training]
    _draw(plan, rows, rng)
    return [{**row, "trial": k, "kind": "training"} for k, row in enumerate(rows, 1)]


def williams_row(count: int, number: int) -> list[int]:
    """Row of a Williams square of ``count`` conditions, which has ``count`` rows, or twice as many
    for an odd count; rows repeat after that."""
    # 0, n-1, 1, n-2, ...: differences of neighbours are all different.
    base = [k // 2 if k % 2 == 0 else count - 1 - k // 2 for k in range(count)]
    row = [(k + number) % count for k in base]
    return row[::-1] if count % 2 and (number // count) % 2 else row


class _Shuffler(random.Random):
    """Random numbers of a text; equal texts give equal orders in every version of Python."""

    def shuffled(self, items: Sequence[T]) -> list[T]:
        # ``random`` is reproducible by Python's documentation; ``shuffle`` is not.
        keys = [self.random() for _ in items]
        return [items[k] for k in sorted(range(len(items)), key=keys.__getitem__)]

    def sample(self, items: Sequence[T], count: int) -> list[T]:  # type: ignore[override]
        """Items at ``count`` random places, in their order."""
        return [items[k] for k in sorted(self.shuffled(range(len(items)))[:count])]

    def balanced(self, values: Sequence[T], count: int) -> list[T]:
        """List of ``count`` values, each as often as the next within 1, in random order."""
        drawn = list(values) * (count // len(values))
        return self.shuffled(drawn + self.shuffled(values)[: count - len(drawn)])


def _rows(plan: Plan, participant: int, rng: _Shuffler) -> list[Trial]:
    """Rows of all cells, in the order of the plan, without random factors."""
    cells = [cell for _ in range(plan.repetitions) for cell in plan.cells]
    match plan.design:
        case "paired":
            return _pairs(plan, cells, participant)
        case "2afc":
            rows: list[Trial] = [
                {**cell, plan.level_factor: level} for cell in cells for level in plan.levels
            ]
            return _with_targets(rows, rng)
        case "staircase":
            # A staircase for each cell; trials of all staircases are mixed.
            return [
                {"staircase": number, **row, plan.level_factor: "n/a"}
                for number, cell in enumerate(cells, 1)
                for row in _with_targets([dict(cell) for _ in range(plan.trials)], rng)
            ]
        case "adjustment":
            # Half of the trials begin below, half above, at the ends of the levels.
            starts = rng.balanced((plan.levels[0], plan.levels[-1]), len(cells))
            return [{**cell, "start": start} for cell, start in zip(cells, starts, strict=True)]
        case _:
            return [dict(cell) for cell in cells]


def _pairs(plan: Plan, cells: list[Conditions], participant: int) -> list[Trial]:
    """Pairs of alternatives for each cell, in both orders, or in one order that is balanced within
    one for each pair, and is the opposite for the next participant."""
    rows: list[tuple[int, Trial]] = []
    for k, (one, two) in enumerate(pairs_of(plan.alternatives, 2)):
        # Participants 1 and 2, 3 and 4, ... share the shuffle, so that each cell is balanced too.
        rng = _Shuffler(f"{plan.seed}/pair {k}/{(participant - 1) // 2}")
        flips = rng.balanced((False, True), len(cells))
        for number, (cell, is_flipped) in enumerate(zip(cells, flips, strict=True)):
            is_reversed = is_flipped != (participant % 2 == 0)
            orders = [(two, one), (one, two)] if is_reversed else [(one, two), (two, one)]
            for first, second in orders if plan.orders == "both" else orders[:1]:
                sides: Trial = {}
                for name in plan.compare:
                    sides[f"{name}_{FIRST}"], sides[f"{name}_{SECOND}"] = first[name], second[name]
                rows.append((number // len(plan.cells), {**cell, **sides}))
    # All pairs of a repetition come before the next repetition.
    return [row for _, row in sorted(rows, key=lambda item: item[0])]


def _with_targets(rows: list[Trial], rng: _Shuffler) -> list[Trial]:
    """Rows with the interval of the level, first or second, balanced within one."""
    targets = rng.balanced((FIRST, SECOND), len(rows))
    return [{**row, "target": target} for row, target in zip(rows, targets, strict=True)]


def _ordered(plan: Plan, rows: list[Trial], participant: int, rng: _Shuffler) -> list[Trial]:
    """Rows in the plan's sequence, grouped by ``blocks_by``."""
    if not plan.blocks_by:
        return _sequence(plan, rows, participant, rng)
    values = plan.factors[plan.blocks_by]
    ordered: list[Trial] = []
    for k in williams_row(len(values), participant - 1):
        block = [row for row in rows if row[plan.blocks_by] == values[k]]
        ordered += _sequence(plan, block, participant, rng)
    return ordered


def _sequence(plan: Plan, rows: list[Trial], participant: int, rng: _Shuffler) -> list[Trial]:
    if plan.sequence == "random":
        return rng.shuffled(rows)
    # Each repetition is a row of the square of its own.
    size = len(rows) // plan.repetitions
    ordered: list[Trial] = []
    for repetition in range(plan.repetitions):
        part = rows[repetition * size : (repetition + 1) * size]
        ordered += [part[k] for k in williams_row(size, participant - 1 + repetition)]
    return ordered


def _draw(plan: Plan, rows: list[Trial], rng: _Shuffler) -> None:
    """Add a balanced random value of each factor of ``random`` to the rows, in place."""
    for name, values in plan.random.items():
        for row, value in zip(rows, rng.balanced(values, len(rows)), strict=True):
            row[name] = value


def _catch(plan: Plan, row: Trial) -> Trial:
    """Catch trial of a row: a pair of equal stimuli, the strongest level, or the row again."""
    trial = {**row, "kind": "catch"}
    for name in plan.compare:
        trial[f"{name}_{SECOND}"] = trial[f"{name}_{FIRST}"]
    if plan.design in ("2afc", "staircase"):
        trial[plan.level_factor] = plan.levels[-1]
    if plan.design == "staircase":
        trial["staircase"] = "n/a"
    return trial
