# SPDX-License-Identifier: GPL-3.0-or-later
"""Text of an export's report, for the terminal and the popup."""

from __future__ import annotations

from ..text import MOST_LINES, named, printable, shortened
from .report import REPORT_SUFFIX, ExportReport

_FILES = 12
"""Largest number of files that are listed line by line."""


def describe(report: ExportReport) -> str:
    """Describe an export: files, warnings, notes, felt effects, unplayed and unfelt effects."""
    lines = [f"Scene '{report.scene}'", *(f"  {text}" for text in _written_lines(report))]
    already_said = set(report.silent_devices)  # printed by the command separately
    warnings = (text for text in report.warnings if text not in already_said)
    lines += [f"  warning: {text}" for text in shortened(warnings, MOST_LINES)]
    lines += [f"  note: {text}" for text in shortened(report.notes, MOST_LINES)]
    lines += [f"  {text}" for text in felt_lines(report)]
    lines += [
        f"  {lost['effect']}: {lost['seconds']:.2f} s of it ({lost['share']:.0%}) felt by "
        f"{lost['body']} but played by no device"
        for lost in report.unrendered
    ]
    lines += [f"  {text}" for text in unfelt_lines(report)]
    return "\n".join(map(printable, lines))


def _written_lines(report: ExportReport) -> list[str]:
    """One line per file; above ``_FILES`` files one line with their number, size and list."""
    sizes = [path.stat().st_size for path in report.files]
    if len(sizes) <= _FILES:
        pairs = zip(report.files, sizes, strict=True)
        return [f"wrote {path} ({_size(size)})" for path, size in pairs]
    lists = (path for path in report.files if path.name.endswith(REPORT_SUFFIX))
    where = "".join(f", listed in {path}" for path in lists)
    return [f"wrote {len(sizes)} files ({_size(sum(sizes))}) to {report.folder}{where}"]


def felt_lines(report: ExportReport, most: int = MOST_LINES) -> tuple[str, ...]:
    """Lines with the times of felt effects for each body; effects without any body are left out."""
    unfelt = {line["effect"] for line in report.effects if not line["felt"]}
    texts = []
    for line in report.felt:
        title = f"{line['effect']} ({line['modality']})"
        if line["effect"] in unfelt:
            continue
        if not line["seconds"]:
            texts.append(f"{title} was not felt by {line['body']}")
            continue
        texts.append(
            f"{title} felt by {line['body']} from {line['first_s']:.2f} to {line['last_s']:.2f} s, "
            f"for {line['seconds']:.2f} s, on {line['mean_vertices']:.0f} vertices on average"
        )
    return shortened(texts, most)


def unfelt_lines(
    report: ExportReport, most: int | None = None, *, is_expected: bool = False
) -> tuple[str, ...]:
    """Lines on effects that no body feels: one line per reason, with ``most`` names (None: all).

    ``is_expected`` leaves out effects named in warnings.
    """
    reasons: dict[str, list[str]] = {}
    for line in report.effects:
        if not line["felt"] and (line.get("expected") or not is_expected):
            title = f"{line['effect']} ({line['modality']})" if "modality" in line else None
            reasons.setdefault(line["reason"], []).append(title or line["effect"])
    return tuple(
        f"{names[0]} was not felt: it {why}"
        if len(names) == 1
        else f"{len(names)} effects were not felt: each {why}: {named(names, most or len(names))}"
        for why, names in reasons.items()
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"
