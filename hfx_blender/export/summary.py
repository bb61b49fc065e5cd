# SPDX-License-Identifier: GPL-3.0-or-later
"""Text of an export's report, for the terminal and the popup."""

from __future__ import annotations

from ..text import MOST_LINES, named, printable, shortened
from .report import REPORT_SUFFIX, ExportReport

_FILES = 12
"""Largest number of files that are listed line by line."""


def describe(report: ExportReport) -> str:
    """Describe an export in a few lines: files, warnings, and last what is felt of effects."""
    lines = [f"Scene '{report.scene}'", *(f"  {text}" for text in _written_lines(report))]
    already_said = set(report.silent_devices)  # by the command, on its own
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
    """A line for each file; of many, their number, and where they are listed."""
    sizes = [path.stat().st_size for path in report.files]
    if len(sizes) <= _FILES:
        pairs = zip(report.files, sizes, strict=True)
        return [f"wrote {path} ({_size(size)})" for path, size in pairs]
    lists = (path for path in report.files if path.name.endswith(REPORT_SUFFIX))
    where = "".join(f", listed in {path}" for path in lists)
    return [f"wrote {len(sizes)} files ({_size(sum(sizes))}) to {report.folder}{where}"]


def felt_lines(report: ExportReport, most: int = MOST_LINES) -> tuple[str, ...]:
    """Times of effects that are felt, for each body; effects that no body feels are left out."""
    unfelt = {each["effect"] for each in report.effects if not each["felt"]}
    texts = []
    for felt in report.felt:
        title = f"{felt['effect']} ({felt['modality']})"
        if felt["effect"] in unfelt:
            continue
        if not felt["seconds"]:
            texts.append(f"{title} was not felt by {felt['body']}")
            continue
        texts.append(
            f"{title} felt by {felt['body']} from {felt['first_s']:.2f} to {felt['last_s']:.2f} s, "
            f"for {felt['seconds']:.2f} s, on {felt['mean_vertices']:.0f} vertices on average"
        )
    return shortened(texts, most)


def unfelt_lines(
    report: ExportReport, most: int | None = None, *, is_expected: bool = False
) -> tuple[str, ...]:
    """Effects that no body feels, and why: one line for each reason, with ``most`` names.

    ``is_expected``: without those that a warning names already.
    """
    reasons: dict[str, list[str]] = {}
    for each in report.effects:
        if not each["felt"] and (each.get("expected") or not is_expected):
            title = f"{each['effect']} ({each['modality']})" if "modality" in each else None
            reasons.setdefault(each["reason"], []).append(title or each["effect"])
    return tuple(
        f"{names[0]} was not felt: it {why}"
        if len(names) == 1
        else f"{len(names)} effects were not felt: each {why}: {named(names, most or len(names))}"
        for why, names in reasons.items()
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"
