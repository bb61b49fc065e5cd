# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts about reports, effects and paths for ``hfx info`` and ``hfx validate``.

Other formats are in :mod:`hfx_blender.formats.files`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ..export.result_files import listed
from ..files import suffixes
from ..files.json_shapes import PRINTABLE, Anything, Items, Node, Number, Record, Table, Text, read
from ..files.kinds import refuse_another

_REPORT_SUFFIX: Final = ".report.json"
_MOST_BYTES: Final = 64 << 20
_LISTS: Final = ("felt", "effects", "unrendered", "warnings", "notes")
_MOST: Final = 1 << 20  # of a list
_FILE: Final = Record(
    {"name": PRINTABLE, "bytes": Number(0, 1 << 50, is_whole=True)},
    unknown="ignore",
    title="an object with 'name' and 'bytes'",
)
_PLAIN: Final = Items(Table(Anything(), 1, title="an object with at least one member"), 0, _MOST)
_SENTENCES: Final = Items(Text(pattern=r"[^\x00-\x1f]*", note="a sentence"), 0, _MOST)
_REPORT: Final = Record(
    {"scene": Anything(), "files": Items(_FILE, 0, _MOST)},
    {key: _SENTENCES if key in ("warnings", "notes") else _PLAIN for key in _LISTS},
    unknown="ignore",
    title="an export's report",
)


@dataclass(frozen=True)
class OwnFile:
    """Kind of file; ``facts`` reads a file and raises ``InputError`` for the first fault."""

    name: str
    title: str
    facts: Callable[[Path], dict[str, Any]]


def kind_of(path: Path) -> OwnFile | None:
    """Kind of a file by name; None for unknown names."""
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
                "effect": effect.name,
                "modality": effect.modality,
                "where": effect_file.where_of(effect),
                "clips": len(effect.clips),
            }
            for effect in sensation.effects
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


def facts_of_report(path: Path) -> dict[str, Any]:
    """Content of an export's report, with the state of each listed file.

    A state is "there", "missing" or "of another size". Raises InputError for an invalid report.
    """
    document = read(path, _MOST_BYTES)
    refuse_another(document.value, document.file, "report")
    report = document.hold(_REPORT)
    files = [_file(file, path.parent) for file in report["files"].items()]
    return {
        "file": str(path),
        "scene": report.get("scene"),
        "complete": "yes" if all(file["state"] == "there" for file in files) else "no",
        "files": files,
        **{key: report.get(key, []) for key in _LISTS},
    }


def _file(node: Node, folder: Path) -> dict[str, Any]:
    name, size = node.get("name"), node.get("bytes")
    path = listed(folder, name)
    if path is None:
        node["name"].fail("the name of a file in its folder, or in folders below")
    if not path.is_file():
        state = "missing"
    else:
        state = "there" if path.stat().st_size == size else "of another size"
    return {"name": name, "bytes": size, "state": state}


_KINDS = {
    _REPORT_SUFFIX: OwnFile("report", "report of an export", facts_of_report),
    suffixes.EFFECT: OwnFile("effect", "effects", _effect),
    suffixes.PATH: OwnFile("path", "path on the skin", _path),
}
