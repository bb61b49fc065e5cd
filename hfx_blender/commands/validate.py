# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx validate``: whether files keep the rules of their formats."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import InputError
from .arguments import add_largest, expanded
from .console import Console
from .own_files import OwnFile, kind_of

SOME_FAILED = 5


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "validate",
        help="check files of any format",
        description=(
            "Check files strictly against the rules of their formats; of a folder, all that are "
            "known. Each finding has a code that stays the same, a place and a message. Ends with "
            "3 if all have errors, with 5 if some have."
        ),
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files or folders")
    parser.add_argument("--strict", action="store_true", help="warnings are errors")
    add_largest(parser)
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Check each file; report every finding."""
    results = [
        _check(path, options.strict, console)
        for given in expanded(options.files)
        for path in (_known_in(given) if given.is_dir() else (given,))
    ]
    console.result(results if len(results) > 1 else results[0])
    failed = sum(not each["is_valid"] for each in results)
    if not failed:
        return 0
    return SOME_FAILED if 0 < failed < len(results) else InputError.exit_code


def _known_in(folder: Path) -> list[Path]:
    """Files in a folder and those below it that can be checked, but for hidden ones.

    Raises
    ------
    InputError
        There is none.
    """
    from ..formats.files import can_validate

    found = [
        path
        for path in sorted(folder.rglob("[!.]*"))
        if (path.is_file() or not path.exists())  # the latter: a link to nothing
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
        and (kind_of(path) or can_validate(path))
    ]
    if not found:
        raise InputError(f"{folder}: holds no file of a format that is known here.")
    return found


def _check(path: Path, strict: bool, console: Console) -> dict[str, Any]:
    from ..formats.files import validate

    if own := kind_of(path):
        return _check_own(path, own, console)
    try:
        found, findings = validate(path)
    except InputError as error:
        console.warn(f"hfx: {error}")
        return {"file": str(path), "format": None, "is_valid": False, "error": str(error)}
    for each in findings:
        console.say(f"{path}: {each}")
    is_valid = not any(strict or each.severity == "error" for each in findings)
    verdict = "valid" if is_valid else "not valid"
    count = len(findings)
    told = f", {count} findings" if count else ""
    told += f"; {found.unchecked}" if found.unchecked and is_valid else ""
    console.say(f"{path}: {found.title}, {verdict}{told}")
    return {
        "file": str(path),
        "format": found.id,
        "is_valid": is_valid,
        "findings": [vars(each) for each in findings],
    }


def _check_own(path: Path, kind: OwnFile, console: Console) -> dict[str, Any]:
    """Check a file of ours; of a report also that the files that it names are beside it."""
    from ..files.findings import Finding

    try:
        facts = kind.facts(path)
    except InputError as error:
        console.warn(f"hfx: {error}")
        return {"file": str(path), "format": kind.name, "is_valid": False, "error": str(error)}
    findings = [
        Finding("REPORT-FILE", f"files[{k}]", f"'{each['name']}' is {each['state']}")
        for k, each in enumerate(facts.get("files", ()))
        if each["state"] != "there"
    ]
    for each in findings:
        console.say(f"{path}: {each}")
    console.say(f"{path}: {kind.title}, {'not valid' if findings else 'valid'}")
    found = [vars(each) for each in findings]
    return {"file": str(path), "format": kind.name, "is_valid": not findings, "findings": found}
