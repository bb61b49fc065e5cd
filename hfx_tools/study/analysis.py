# SPDX-License-Identifier: GPL-3.0-or-later
"""Analysis of a study's answers by design, as plain data for the report and for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.errors import InputError

from .design import FIRST, SECOND
from .folder import Study
from .plan import Conditions, Plan, Value, as_text
from .psychometric import Fit, PsychometricGrid, counted
from .session import TLX, event_columns
from .statistics import bradley_terry, compared, holm, information_bits, mean_interval, share_of
from .tables import NOTHING, Row, read_table

Answers = Mapping[str, Sequence[Row]]
"""Rows of the trials of each participant, without training, catch trials and questions."""


def analysed(study: Study) -> dict[str, Any]:
    """Results of a study: counts of the answers, results of the design, and of the questionnaire.

    Raises InputError for a study without answers, or for a table with impossible values.
    """
    plan = study.plan
    rows = {
        label: read_table(study.data_file(label), event_columns(plan))
        for label in study.participants()
    }
    answers = {
        label: [row for row in table if row["trial_type"] == "trial"]
        for label, table in rows.items()
    }
    if not any(answers.values()):
        raise InputError(f"{study.folder}: has no answers; 'hfx study run' stores them.")
    every = [row for table in answers.values() for row in table]
    times = [_number(study, row, "response_time") for row in every]
    results: dict[str, Any] = {
        "plan": plan.name,
        "title": plan.title,
        "design": plan.design,
        "participants": len(answers),
        "trials": len(every),
        "response_time_s": float(np.median(times)),
        "catch": _catch(plan, [row for table in rows.values() for row in table]),
    }
    results |= _DESIGNS[plan.design](study, answers)
    if plan.questionnaire:
        results["nasa_tlx"] = _tlx(study, rows)
    return results


def _number(study: Study, row: Row, column: str) -> float:
    """Number of a column; InputError for other texts."""
    try:
        value = float(row[column])
        if math.isfinite(value):
            return value
    except ValueError:
        pass
    raise InputError(
        f"{study.folder}: trial {row['trial']}: {column} is '{row[column][:60]}', allowed is a "
        "number."
    )


def _one_of(study: Study, row: Row, column: str, allowed: Sequence[str]) -> str:
    """Text of a column among the allowed texts; InputError for others."""
    if row[column] not in allowed:
        raise InputError(
            f"{study.folder}: trial {row['trial']}: {column} is '{row[column][:60]}', allowed is "
            f"one of {', '.join(allowed)}."
        )
    return row[column]


def _catch(plan: Plan, rows: Sequence[Row]) -> dict[str, Any]:
    """Catch trials: number, and the share of right answers, or of the answer "first" of pairs."""
    catches = [row for row in rows if row["trial_type"] == "catch"]
    if plan.design == "paired":
        return asdict(share_of(sum(row["response"] == FIRST for row in catches), len(catches)))
    right = [row for row in catches if row.get("correct", NOTHING) != NOTHING]
    return asdict(share_of(sum(row["correct"] == "1" for row in right), len(right)))


def name_of(plan: Plan, conditions: Conditions) -> str:
    """Name of a combination of factors: their values, joined by commas; "all" without factors."""
    return ", ".join(plan.label(value) for value in conditions.values()) or "all"


def _matches(row: Row, conditions: Mapping[str, Value], suffix: str = "") -> bool:
    return all(row[f"{name}{suffix}"] == as_text(value) for name, value in conditions.items())


# Paired comparisons


def _paired(study: Study, answers: Answers) -> dict[str, Any]:
    plan = study.plan
    alternatives = plan.alternatives
    by_participant = {label: _wins(study, rows, alternatives) for label, rows in answers.items()}
    wins = sum(by_participant.values(), np.zeros((len(alternatives),) * 2, np.int64))
    names = [name_of(plan, one) for one in alternatives]
    pairs = [(a, b) for a in range(len(names)) for b in range(a + 1, len(names))]
    shares = [share_of(int(wins[a, b]), int(wins[a, b] + wins[b, a])) for a, b in pairs]
    model = bradley_terry(wins)
    every = [row for rows in answers.values() for row in rows]
    return {
        "alternatives": names,
        "wins": wins.tolist(),
        "pairs": [
            {
                "first": names[a],
                "second": names[b],
                **asdict(share),
                "p_holm": p,
                "participants": _preferring(by_participant, a, b),
            }
            for (a, b), share, p in zip(pairs, shares, holm([s.p for s in shares]), strict=True)
        ],
        "order": asdict(share_of(sum(r["response"] == FIRST for r in every), len(every))),
        "bradley_terry": {
            "strengths": model.strengths.tolist(),
            "errors": model.errors.tolist(),
            "low": (model.strengths - 1.959964 * model.errors).tolist(),
            "high": (model.strengths + 1.959964 * model.errors).tolist(),
            "statistic": model.statistic,
            "p": model.p,
            "is_finite": model.is_finite,
        },
        "by_factor": [
            {
                "factor": name,
                "value": as_text(value),
                "first": names[a],
                "second": names[b],
                **_factor_share(study, every, alternatives, (a, b), name, value),
            }
            for name, values in plan.factors.items()
            for value in values
            for a, b in pairs
        ],
    }


def _wins(study: Study, rows: Sequence[Row], alternatives: Sequence[Conditions]) -> Any:
    """Preferences (n, n) of the row over the column."""
    wins = np.zeros((len(alternatives),) * 2, np.int64)
    for row in rows:
        response = _one_of(study, row, "response", (FIRST, SECOND))
        sides = [
            next((k for k, one in enumerate(alternatives) if _matches(row, one, f"_{side}")), -1)
            for side in (FIRST, SECOND)
        ]
        if -1 in sides:
            raise InputError(
                f"{study.folder}: trial {row['trial']} compares values that are not in the plan."
            )
        winner, loser = sides if response == FIRST else sides[::-1]
        wins[winner, loser] += 1
    return wins


def _preferring(by_participant: Mapping[str, Any], a: int, b: int) -> dict[str, int]:
    """Participants who preferred either alternative with p below 0.05, corrected by Holm."""
    shares = [share_of(int(w[a, b]), int(w[a, b] + w[b, a])) for w in by_participant.values()]
    counts = {"first": 0, "second": 0, "neither": 0}
    for share, p in zip(shares, holm([share.p for share in shares]), strict=True):
        is_clear = p < 0.05
        counts[("first" if share.share > 0.5 else "second") if is_clear else "neither"] += 1
    return counts


def _factor_share(
    study: Study,
    rows: Sequence[Row],
    alternatives: Sequence[Conditions],
    pair: tuple[int, int],
    name: str,
    value: Value,
) -> dict[str, Any]:
    chosen = [row for row in rows if row[name] == as_text(value)]
    wins = _wins(study, chosen, alternatives)
    first, second = int(wins[pair]), int(wins[pair[::-1]])
    return asdict(share_of(first, first + second))


# Thresholds


def _thresholds(study: Study, answers: Answers) -> dict[str, Any]:
    plan = study.plan
    levels = [float(level) for level in plan.levels]
    grid = PsychometricGrid(levels, is_logarithmic=plan.scale == "log", guess=plan.guess)
    cells = plan.cells
    fits: list[dict[str, Any]] = []
    table = np.full((len(answers), len(cells)), np.nan)
    for p, (label, rows) in enumerate(answers.items()):
        for c, cell in enumerate(cells):
            chosen = [row for row in rows if _matches(row, cell)]
            if not chosen:
                continue
            fit, counts = _fitted(study, grid, levels, chosen)
            table[p, c] = fit.threshold if fit.is_bounded else np.nan
            fits.append(
                {
                    "participant": label,
                    "condition": name_of(plan, cell),
                    **asdict(fit),
                    "counts": counts,
                }
            )
    return {
        "conditions": [name_of(plan, cell) for cell in cells],
        "level": plan.level_factor,
        "fits": fits,
        "groups": _groups(plan, table, is_logarithmic=plan.scale == "log"),
        "comparison": _comparison(table),
    }


def _fitted(
    study: Study, grid: PsychometricGrid, levels: Sequence[float], rows: Sequence[Row]
) -> tuple[Fit, list[list[float]]]:
    """Fit of rows, and [level, answers for the target, all answers] of each level."""
    name = study.plan.level_factor
    texts = [as_text(level) for level in study.plan.levels]
    pairs = []
    for row in rows:
        response = _one_of(study, row, "response", (FIRST, SECOND))
        target = _one_of(study, row, "target", (FIRST, SECOND))
        level = levels[texts.index(_one_of(study, row, name, texts))]
        pairs.append((level, response == target))
    yes, total = counted(pairs, levels)
    counts = [[x, int(y), int(n)] for x, y, n in zip(levels, yes, total, strict=True) if n]
    return grid.fit(yes, total), counts


def _groups(plan: Plan, table: F64, *, is_logarithmic: bool) -> list[dict[str, Any]]:
    """Mean over participants of each condition with its interval; geometric for logarithms."""
    groups = []
    for cell, column in zip(plan.cells, table.T, strict=True):
        values = column[np.isfinite(column)]
        ends = mean_interval(np.log(values) if is_logarithmic else values)
        mean, low, high = (math.exp(v) if is_logarithmic else v for v in ends)
        spread = float(values.std(ddof=1)) if len(values) > 1 else math.nan
        groups.append(
            {
                "condition": name_of(plan, cell),
                "participants": len(values),
                "mean": mean,
                "low": low,
                "high": high,
                "deviation": spread,
            }
        )
    return groups


def _comparison(table: F64) -> dict[str, Any] | None:
    """Tests between the conditions; None for a single one."""
    return asdict(compared(table)) if table.shape[1] > 1 else None


# Adjustment, rating, identification


def _adjustment(study: Study, answers: Answers) -> dict[str, Any]:
    plan = study.plan
    table = _means(answers, plan.cells, lambda row: _number(study, row, "response"))
    return {
        "conditions": [name_of(plan, cell) for cell in plan.cells],
        "level": plan.level_factor,
        "groups": _groups(plan, table, is_logarithmic=False),
        "comparison": _comparison(table),
    }


def _means(answers: Answers, cells: Sequence[Conditions], value_of: Callable[[Row], float]) -> F64:
    """Mean value (participants, cells) of the rows of each cell; NaN without rows."""
    table = np.full((len(answers), len(cells)), np.nan)
    for p, rows in enumerate(answers.values()):
        for c, cell in enumerate(cells):
            values = [value_of(row) for row in rows if _matches(row, cell)]
            if values:
                table[p, c] = float(np.mean(values))
    return table


def _rating(study: Study, answers: Answers) -> dict[str, Any]:
    plan, scales = study.plan, []
    for scale in plan.scales:
        column = f"rating_{scale.id}"
        steps = [str(k) for k in range(1, scale.steps + 1)]

        def value_of(row: Row, column: str = column, steps: Sequence[str] = steps) -> float:
            return float(_one_of(study, row, column, steps))

        table = _means(answers, plan.cells, value_of)
        conditions = []
        for cell in plan.cells:
            values = [
                value_of(row) for rows in answers.values() for row in rows if _matches(row, cell)
            ]
            quartiles = np.percentile(values, [25, 50, 75]).tolist() if values else [math.nan] * 3
            conditions.append(
                {
                    "condition": name_of(plan, cell),
                    "answers": len(values),
                    "mean": float(np.mean(values)) if values else math.nan,
                    "low": quartiles[0],
                    "median": quartiles[1],
                    "high": quartiles[2],
                }
            )
        scales.append(
            {
                "scale": scale.id,
                "text": scale.text,
                "steps": scale.steps,
                "conditions": conditions,
                "comparison": _comparison(table),
            }
        )
    return {"scales": scales}


def _identification(study: Study, answers: Answers) -> dict[str, Any]:
    plan = study.plan
    names = [as_text(value) for value in plan.answers]
    table = np.zeros((len(names), len(names)), np.int64)
    for rows in answers.values():
        for row in rows:
            shown = names.index(_one_of(study, row, plan.identify, names))
            table[shown, names.index(_one_of(study, row, "response", names))] += 1
    right, total = int(np.trace(table)), int(table.sum())
    chance = 1.0 / len(names)
    others = {name: values for name, values in plan.factors.items() if name != plan.identify}
    cells = [{name: value for name, value in cell.items() if name in others} for cell in plan.cells]
    unique = [cell for k, cell in enumerate(cells) if cell not in cells[:k]]
    shares = _means(answers, unique, lambda row: float(row["response"] == row[plan.identify]))
    return {
        "answers": [plan.label(value) for value in plan.answers],
        "confusion": table.tolist(),
        "correct": asdict(share_of(right, total, chance)),
        "chance": chance,
        "by_answer": [
            asdict(share_of(int(row[k]), int(row.sum()), chance)) for k, row in enumerate(table)
        ],
        "information_bits": information_bits(table),
        "conditions": [name_of(plan, cell) for cell in unique],
        "comparison": _comparison(shares),
    }


def _tlx(study: Study, rows: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """Mean of each scale of the NASA-TLX, and each participant's sum and mean (raw TLX)."""
    scores = {
        label: {
            _one_of(study, row, "item", tuple(TLX)): _number(study, row, "score")
            for row in table
            if row["trial_type"] == "questionnaire"
        }
        for label, table in rows.items()
    }
    complete = {label: items for label, items in scores.items() if len(items) == len(TLX)}
    sums = {label: sum(items.values()) for label, items in complete.items()}
    return {
        "participants": len(complete),
        "scales": {
            item: mean_interval(np.array([items[item] for items in complete.values()]))
            for item in TLX
        },
        "sums": sums,
        "raw_tlx": mean_interval(np.array(list(sums.values())) / len(TLX)),
    }


_DESIGNS: dict[str, Callable[[Study, Answers], dict[str, Any]]] = {
    "paired": _paired,
    "2afc": _thresholds,
    "staircase": _thresholds,
    "adjustment": _adjustment,
    "rating": _rating,
    "identification": _identification,
}
