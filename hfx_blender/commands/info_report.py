# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx info`` of an export's report: files, samples, and parts left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from ..errors import InputError
from ..export.result_files import listed
from ..files.kinds import refuse_another
from ..files.strict_json import Node, read

SUFFIX: Final = ".report.json"
_MOST_BYTES: Final = 64 << 20
_LISTS: Final = ("files", "felt", "effects", "unrendered", "warnings", "notes")


def facts_of_report(path: Path) -> dict[str, Any]:
    """Content of a report, and whether the files that it names are still beside it.

    Raises
    ------
    InputError
        It is none.
    """
    document = read(path, _MOST_BYTES)
    refuse_another(document.value, document.file, "report")
    members = document.entries(allowed="an export's report")
    if "scene" not in members or "files" not in members:
        raise InputError(f"{path}: is not a report of an export: it has no 'scene' or no 'files'.")
    lists = {key: members[key] for key in _LISTS if key in members}
    files = [_file(each, path.parent) for each in lists["files"].items(least=0, most=1 << 20)]
    facts: dict[str, Any] = {
        "file": str(path),
        "scene": members["scene"].value,
        "complete": "yes" if all(each["state"] == "there" for each in files) else "no",
        "files": files,
    }
    for key in _LISTS[1:]:
        for each in lists[key].items(least=0, most=1 << 20) if key in lists else ():
            is_sentence = key in ("warnings", "notes")
            found = each.text(r"[^\x00-\x1f]*") if is_sentence else _plain(each)
            facts.setdefault(key, []).append(found)
        facts.setdefault(key, [])
    return facts


def _plain(node: Node) -> dict[str, Any]:
    members = node.entries(allowed="an object with at least one member", least=1)
    return {key: each.value for key, each in members.items()}


def _file(node: Node, folder: Path) -> dict[str, Any]:
    members = node.entries(allowed="an object with 'name' and 'bytes'")
    if "name" not in members or "bytes" not in members:
        node.fail("an object with 'name' and 'bytes'")
    name = members["name"].text()
    path = listed(folder, name)
    if path is None:
        members["name"].fail("the name of a file in its folder, or in folders below")
    size = members["bytes"].integer(0, 1 << 50)
    if not path.is_file():
        state = "missing"
    else:
        state = "there" if path.stat().st_size == size else "of another size"
    return {"name": name, "bytes": size, "state": state}
