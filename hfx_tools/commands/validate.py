# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx validate``: checks files against the rules of their formats."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json, expanded
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError

from .info import is_known, kind_of
from .size_option import add_largest

SOME_FAILED = 5


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "validate",
        help="check files of any format",
        description=(
            "Check files strictly against the rules of their formats, in folders all files of "
            "known formats. Each finding has a stable code, a place and a message. The exit code "
            "is 3 if all files have errors, and 5 if some files have errors."
        ),
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files or folders")
    parser.add_argument("--strict", action="store_true", help="treat warnings as errors")
    add_largest(parser)
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Check each file and report all findings; returns 0, 3 if all files have errors, else 5."""
    results = [
        _check(path, options.strict, console)
        for given in expanded(options.files)
        for path in (_known_in(given) if given.is_dir() else (given,))
    ]
    console.result(results if len(results) > 1 else results[0])
    failed = sum(not result["is_valid"] for result in results)
    if not failed:
        return 0
    return SOME_FAILED if 0 < failed < len(results) else InputError.exit_code


def _known_in(folder: Path) -> list[Path]:
    """Visible files of known formats in a folder and its subfolders, sorted; InputError without."""
    from hfx_blender.formats.registry import FORMATS

    read_whole = tuple(info.suffix for info in FORMATS.values() if info.read)
    # Hidden files are caches and unfinished results.
    files = [
        path
        for path in sorted(folder.rglob("[!.]*"))
        if (path.is_file() or not path.exists())  # a broken link does not exist
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
        and (kind_of(path) or path.name.lower().endswith(read_whole) or is_known(path))
    ]
    if not files:
        raise InputError(f"{folder}: holds no file of a format that is known here.")
    return files


def _check(path: Path, strict: bool, console: Console) -> dict[str, Any]:
    """Check a file and print its findings and verdict, or the reason why it cannot be read; of a
    report also the listed files. Returns the result for ``--json``."""
    from hfx_blender.files.findings import Finding

    from ..formats.validation import validate

    own = kind_of(path)
    try:
        if own is not None:
            id, title, unchecked = own.name, own.title, ""
            findings = [
                Finding("REPORT-FILE", f"files[{k}]", f"'{entry['name']}' is {entry['state']}")
                for k, entry in enumerate(own.facts(path).get("files", ()))
                if entry["state"] != "there"
            ]
        else:
            with console.reading(path):
                info, findings = validate(path)
            id, title, unchecked = info.id, info.title, info.unchecked
    except InputError as error:
        console.warn(f"hfx: {error}")
        id = None if own is None else own.name
        result = {"file": str(path), "format": id, "is_valid": False, "findings": []}
        return result | {"error": str(error)}
    for finding in findings:
        console.say(f"{path}: {finding}")
    # Warnings count as faults with --strict only.
    is_valid = not any(strict or finding.severity == "error" for finding in findings)
    details = f", {len(findings)} findings" if findings and own is None else ""
    details += f"; {unchecked}" if unchecked and is_valid else ""
    console.say(f"{path}: {title}, {'valid' if is_valid else 'not valid'}{details}")
    return {
        "file": str(path),
        "format": id,
        "is_valid": is_valid,
        "findings": [vars(finding) for finding in findings],
    }
