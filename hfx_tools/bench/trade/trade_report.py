# SPDX-License-Identifier: GPL-3.0-or-later
"""The trade as a table for a terminal and for the documentation, and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from hfx_blender.files.atomic import atomic_file

_Row = dict[str, Any]

_COLUMNS: Final[tuple[tuple[str, Callable[[_Row], str]], ...]] = (
    ("setting", lambda row: ("*" if row["on_front"] else " ") + row["setting"]),
    ("ms/frame", lambda row: f"{row['ms_per_frame']:.2f}"),
    (
        "read+engine+devices",
        lambda row: f"{row['read_ms']:.2f}+{row['engine_ms']:.2f}+{row['render_ms']:.2f}",
    ),
    ("missed", lambda row: _share(row["missed"], row["contacts"])),
    ("extra", lambda row: _share(row["extra"], row["contacts"])),
    ("skin cm2", lambda row: f"-{row['missed_cm2']:.2f} +{row['extra_cm2']:.2f}"),
    ("from edge mm", lambda row: f"{row['distance_mean_mm']:.1f} ({row['distance_p95_mm']:.1f})"),
    (
        "actuators %",
        lambda row: f"{100 * row['amplitude_mean']:.2f} ({100 * row['amplitude_largest']:.0f})",
    ),
    ("onset ms", lambda row: f"{row['onset_mean_ms']:.1f} ({row['onset_largest_ms']:.0f})"),
    ("lost", lambda row: f"{row['events_missed']}/{row['events']}"),
    ("MB", lambda row: f"{row['memory_mb']:.0f}"),
)

LEGEND: Final = """\
Times are processor time of the fastest run, in ms per frame of the scene: reading + engine +
rendering for devices. Missed and extra: contacts (vertex, effect, sample) only in the exact
reference, or only at the setting, as shares of the reference's contacts. Skin: area with too weak
and too strong contact, mean over samples with contact. From edge: distance of wrong contacts to
the boundary, mean (95 %). Actuators: error at the devices as share of full scale, mean of driven
actuators (largest, shifts within the setting's time excluded). Onset: begin of contacts against
the reference at a higher rate, mean (largest). Lost: missed contact events, of all. MB: peak
memory.
*: on the Pareto front: no setting with a bounded error is faster and as exact in every column.
'paper' bounds no error and serves for comparison."""


def _share(count: int, of: int) -> str:
    return f"{100 * count / of:.2f} %" if of else str(count)


def title(result: dict[str, Any]) -> str:
    """Title of a result of :func:`trade.measure`, one line."""
    return (
        f"{result['scene']}: {result['frames']} frames, {result['samples']} samples at "
        f"{result['rate_hz']:g} Hz, {result['bodies']} bodies, {result['effects']} effects "
        f"({result['volumes']} volumes), {len(result['devices'])} devices, "
        f"{result['contacts']} contacts"
    )


def as_text(result: dict[str, Any]) -> str:
    """Format the trade as a table for a terminal."""
    lines = [[name for name, _ in _COLUMNS]]
    lines += [[show(row) for _, show in _COLUMNS] for row in result["settings"]]
    widths = [max(len(line[k]) for line in lines) for k in range(len(_COLUMNS))]
    table = [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
    return "\n".join([title(result), "", *table])


def as_markdown(result: dict[str, Any]) -> str:
    """Format the trade as a Markdown table."""
    head = [name for name, _ in _COLUMNS]
    lines = [head, ["---", *["---:"] * (len(head) - 1)]]
    for row in result["settings"]:
        cells = [show(row).strip() for _, show in _COLUMNS]
        name = row["setting"]
        mark = " \\*" if row["on_front"] else ""
        cells[0] = (f"**{name}**" if row["is_preset"] else name) + mark
        lines.append(cells)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def as_csv(result: dict[str, Any]) -> str:
    """Format every number of every setting as CSV."""
    out = io.StringIO()
    writer = csv.DictWriter(out, list(result["settings"][0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(result["settings"])
    return out.getvalue()


def write(result: dict[str, Any], folder: Path) -> tuple[Path, Path]:
    """Write ``trade-SCENE.csv`` and ``trade-SCENE.svg`` into a folder; returns both paths.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    from . import trade_chart

    stem = "trade-" + "".join(c if c.isalnum() else "_" for c in result["name"].lower())
    table, chart = folder / f"{stem}.csv", folder / f"{stem}.svg"
    with atomic_file(table) as file:
        file.write(as_csv(result).encode())
    trade_chart.draw(result, chart)
    return table, chart
