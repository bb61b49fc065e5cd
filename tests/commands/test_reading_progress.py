# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that read large files show progress, and hold a part of the file in memory."""

from __future__ import annotations

import io
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.cli import build_parser
from hfx_blender.commands.console import Console
from hfx_tools.formats.validation import validate

HEADER = {
    "type": "header",
    "format": "hfx-samples",
    "version": 1,
    "rate_hz": 100.0,
    "duration_s": 1.0,
    "models": [{"id": "m", "modality": "pressure", "hash": "0", "vertex_count": 50_000}],
    "bodies": [{"id": "b", "name": "B"}],
    "effects": [
        {"id": "e", "name": "E", "modality": "pressure", "kind": "volume", "model": "m",
         "is_contact": False},
    ],
}  # fmt: skip


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def _samples(folder: Path, sets: int = 4) -> Path:
    """File of ``sets`` lines with 40,000 vertices each, 0.5 MB a line."""
    weights = [round((k % 10_000) / 10_000, 4) for k in range(40_000)]
    lines: list[dict[str, Any]] = [HEADER]
    lines += [
        {"type": "set", "set": k, "vertices": [*range(40_000)], "weights": weights}
        for k in range(sets)
    ]
    path = folder / "x.samples.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def _table(folder: Path) -> Path:
    path = folder / "x.csv"
    rows = "".join(f"{k / 100.0},0.5\r\n" for k in range(9000))
    path.write_text("time_s,a.amplitude [m/s^2]\r\n" + rows)
    return path


@pytest.mark.parametrize("make", [_samples, _table])
@pytest.mark.parametrize("command", ["validate", "info"])
def test_a_large_file_is_read_with_progress(
    tmp_path: Path, make: Callable[[Path], Path], command: str
) -> None:
    path = make(tmp_path)
    err = Terminal()
    options = build_parser().parse_args([command, str(path)])
    assert options.run(options, Console(out=io.StringIO(), err=err)) == 0
    assert path.name in err.getvalue() and "%" in err.getvalue()


def test_samples_are_read_line_by_line(tmp_path: Path) -> None:
    """6 MB of text, which take 40 MB as lists of numbers; a line takes 6."""
    validate(_samples(tmp_path, 1))  # fills caches of numbers
    path = _samples(tmp_path, 12)
    tracemalloc.start()
    try:
        _, findings = validate(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert findings == [] and path.stat().st_size > 5e6 and peak < 15e6
