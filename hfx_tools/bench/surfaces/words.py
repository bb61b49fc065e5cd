# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from words: recognized kinds, comparatives, and classified strokes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hfx_blender.engine.texture.procedural import KINDS
from hfx_blender.errors import InputError
from hfx_blender.generation import library_search
from hfx_blender.generation.interpretation import read_words
from hfx_tools.roughness import roughness_of_surface

from . import classify, texture
from .word_prompts import COMPARATIVES, PROMPTS

TEXELS: Final = 384
_JUDGED: Final = ("gravel", "metal", "fabric", "wood")
_DIRECTIONS: Final = (0.2, 1.0, 2.2)
_SPEEDS_M_S: Final = (0.03, 0.06, 0.1)


def measure(*, short: bool, progress: Callable[[float], None]) -> dict[str, Any]:
    """Run all measurements of prompts; plain data."""
    result: dict[str, Any] = {"kinds": kinds()}
    progress(0.1)
    result["comparatives"] = comparatives()
    progress(0.5)
    result["judge"] = judge(1 if short else 3, PROMPTS if not short else None)
    progress(1.0)
    return result


def kinds() -> dict[str, Any]:
    """Compare the recognized kind with the true kind of each prompt; "none": no match."""
    wrong, unknown = [], set()
    for kind, prompts in PROMPTS.items():
        for prompt in prompts:
            wish = read_words(prompt)
            unknown |= set(wish.unknown)
            try:
                kind_ = wish.choose()[0].kind
            except InputError:
                kind_ = "none"
            if kind_ != kind:
                wrong.append({"words": prompt, "is": kind, "found": kind_})
    count = sum(map(len, PROMPTS.values()))
    return {
        "asked": count,
        "right": count - len(wrong),
        "wrong": wrong,
        "unknown_words": sorted(unknown),
    }


def comparatives() -> list[dict[str, Any]]:
    """Measure the change of each comparative as a ratio, and test its direction."""
    rows = []
    for plain, steered, name, sign in COMPARATIVES:
        before, after = (_measure_words(words, name) for words in (plain, steered))
        rows.append(
            {
                "plain": plain,
                "steered": steered,
                "measure": name,
                "ratio": after / before,
                "is_right": bool(sign * (after - before) > 0.0),
            }
        )
    return rows


def _measure_words(words: str, name: str) -> float:
    """RSm or Ra in metres (mean of both axes; an unknown RSm is 0), or the map's mean intensity."""
    surface = library_search.generate(words, texels=TEXELS)
    if name == "level":
        return float(surface.map.intensity.mean())
    values_m = []
    for direction in (0.0, np.pi / 2.0):
        measured = roughness_of_surface(
            surface.height, surface.height.size_m[0] / 10.0, direction_rad=direction
        )
        values_m.append(measured.ra_m if name == "ra" else measured.rsm_m or 0.0)
    return float(np.mean(values_m))


def judge(train: int, prompts: dict[str, tuple[str, ...]] | None) -> dict[str, Any]:
    """Confusion of strokes over generated surfaces, classified by strokes over the library's maps.

    Prompts without a match are skipped. ``prompts`` None: the names of four kinds.
    """
    prompts_of_kinds = prompts or {kind: (kind,) for kind in _JUDGED}
    known = classify.NearestNeighbour.of(texture.library_strokes(train, TEXELS))
    truth, signals = [], []
    for kind, wishes in prompts_of_kinds.items():
        for number, words in enumerate(wishes):
            try:
                surface = library_search.generate(words, seed=100 + number, texels=TEXELS)
            except InputError:
                continue  # counted in kinds()
            strokes = texture.strokes_over(surface.map, _DIRECTIONS, _SPEEDS_M_S, number)
            truth += [kind] * len(strokes)
            signals += strokes
    table = classify.confusion(truth, known.classify(signals), KINDS)
    return {
        "names": list(KINDS),
        "confusion": table.tolist(),
        "share": float(np.trace(table) / table.sum()),
    }


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    kinds_ = result["kinds"]
    lines = [f"Kind of material: {kinds_['right']} of {kinds_['asked']} wishes right"]
    lines += [f"  {row['words']}: {row['is']}, found {row['found']}" for row in kinds_["wrong"]]
    lines.append(f"  words that are not known: {', '.join(kinds_['unknown_words'])}")
    rows = result["comparatives"]
    right = sum(row["is_right"] for row in rows)
    lines.append(f"Comparatives: {right} of {len(rows)} move their measure the right way")
    lines += [
        f"  {row['steered']:36} {row['measure']:6} x {row['ratio']:.2f}"
        + ("" if row["is_right"] else "  wrong")
        for row in rows
    ]
    judged = result["judge"]
    lines.append(
        "Strokes over generated surfaces, judged by the library's: "
        f"{100 * judged['share']:.1f} % "
        "right; rows are, columns were found:"
    )
    return "\n".join(lines + texture.confusion_lines(judged))


def as_markdown() -> str:
    """Measure all; returns the table of ``docs/surfaces-from-words.md``."""
    kinds_, rows, few, many = kinds(), comparatives(), judge(1, None), judge(3, PROMPTS)
    strokes = [int(np.sum(judged["confusion"])) for judged in (few, many)]
    lines = [
        "| what | right |",
        "|---|---|",
        f"| kind of material of {kinds_['asked']} wishes | {kinds_['right']} |",
        f"| comparatives that move RSm, Ra or the map's level, of {len(rows)} | "
        f"{sum(row['is_right'] for row in rows)} |",
        f"| strokes over {', '.join(_JUDGED)}, named by the judge of the library's own strokes, of "
        f"{strokes[0]} | {round(few['share'] * strokes[0])} |",
        f"| {strokes[1]} strokes over all those wishes, at whatever size and depth they ask for | "
        f"{100 * many['share']:.0f} % |",
    ]
    return "\n".join(lines)
