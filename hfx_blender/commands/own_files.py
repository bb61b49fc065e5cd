# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of this program for ``hfx info`` and ``hfx validate``: reports, effects, paths.

Files that other programs read are in :mod:`hfx_blender.formats.files`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..files import suffixes
from .info_report import SUFFIX, facts_of_report


@dataclass(frozen=True)
class OwnFile:
    """Kind of file; ``facts`` raises ``InputError`` for the first fault of a file."""

    name: str
    title: str
    facts: Callable[[Path], dict[str, Any]]


def kind_of(path: Path) -> OwnFile | None:
    """Kind of a file, by its name; None if it is none of these."""
    name = path.name.lower()
    return next((kind for suffix, kind in _KINDS.items() if name.endswith(suffix)), None)


def _effect(path: Path) -> dict[str, Any]:
    from ..authoring.effects import effect_file

    sensation = effect_file.load(path)
    return {
        "file": str(path),
        "sensation": sensation.name,
        "description": sensation.description,
        "effects": [
            {
                "effect": each.name,
                "modality": each.modality,
                "where": effect_file.where_of(each),
                "clips": len(each.clips),
            }
            for each in sensation.effects
        ],
    }


def _path(path: Path) -> dict[str, Any]:
    from ..authoring.paths import path_file

    recipe = path_file.load(path)
    return {
        "file": str(path),
        "path": recipe.name,
        "description": recipe.description,
        "kind": recipe.kind,
        "closed": "yes" if recipe.is_closed else "no",
        "points": len(recipe.points_m),
        "motion_s": recipe.motion[-1][0] if recipe.motion else 0.0,
    }


_KINDS = {
    SUFFIX: OwnFile("report", "report of an export", facts_of_report),
    suffixes.EFFECT: OwnFile("effect", "effects", _effect),
    suffixes.PATH: OwnFile("path", "path on the skin", _path),
}
