# SPDX-License-Identifier: GPL-3.0-or-later
"""Journal of earlier exports: each scene's own report is its entry.

A report gets its name after all files that it lists, and says with sizes and hashes what was
written and what it was made from. So an interrupted batch needs no repair: what has a report
that still holds is complete, whichever machine made it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...files.hashes import sha256_of
from ..report import REPORT_SUFFIX, read
from ..result_files import listed
from . import inputs
from .units import Unit


def finished(unit: Unit) -> dict[str, Any] | None:
    """The report of an earlier export of ``unit``, if nothing has changed since.

    None if there is none, an input, an option or a version is another one, one of the files is
    missing or is not what was written, or a device was left out as its script did not run.
    """
    folder = Path(unit.folder)
    report = read(folder / (unit.stem + REPORT_SUFFIX))
    if report is None or not inputs.is_still(report.get("made_from"), unit):
        return None
    if report.get("silent_devices"):
        return None
    return report if has_files(report, folder) else None


def has_files(report: dict[str, Any], folder: Path) -> bool:
    """Test that all files that a report lists are present and unchanged."""
    try:
        return all(
            (path := listed(folder, each["name"])) is not None
            and path.stat().st_size == each["bytes"]
            and sha256_of(path) == each["sha256"]
            for each in report["files"]
        )
    except (KeyError, TypeError, ValueError, OSError):
        return False
