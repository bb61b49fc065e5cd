# SPDX-License-Identifier: GPL-3.0-or-later
"""An export's report in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from .printable import printable

if TYPE_CHECKING:
    from .export_report import ExportReport


MOST_LINES: Final = 40
"""Warnings, and notes, that are shown; the report's file has more."""

MOST_KEPT: Final = 1000
"""Warnings that a report's file and a track keep."""


def shortened(texts: Iterable[str], most: int = MOST_KEPT) -> tuple[str, ...]:
    """Distinct texts, at most ``most``, and a count of the others."""
    found = tuple(dict.fromkeys(texts))
    left = len(found) - most
    return found if left <= 0 else (*found[:most], f"... and {left} more")


def describe(report: ExportReport) -> str:
    """Describe an export in a few lines: samples, effects without a device, files."""
    lines = [f"Scene '{report.scene}'"]
    for felt in report.felt:
        if felt["seconds"]:
            lines.append(
                f"  {felt['effect']} ({felt['modality']}) felt by {felt['body']} for "
                f"{felt['seconds']:.2f} s from {felt['first_s']:.2f} s, on "
                f"{felt['mean_vertices']:.0f} vertices on average"
            )
        else:
            lines.append(f"  {felt['effect']} ({felt['modality']}) was not felt by {felt['body']}")
    lines += [
        f"  {lost['effect']}: {lost['seconds']:.2f} s of it ({lost['share']:.0%}) felt by "
        f"{lost['body']} but played by no device"
        for lost in report.unrendered
    ]
    already_said = set(report.silent_devices)  # by the command, on its own
    warnings = (text for text in report.warnings if text not in already_said)
    lines += [f"  warning: {text}" for text in shortened(warnings, MOST_LINES)]
    lines += [f"  note: {text}" for text in shortened(report.notes, MOST_LINES)]
    lines += [f"  wrote {path} ({_size(path.stat().st_size)})" for path in report.files]
    return "\n".join(map(printable, lines))


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"
