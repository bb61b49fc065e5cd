# SPDX-License-Identifier: GPL-3.0-or-later
"""Safety: time until a device is silent after any failure, and events that must never happen.

Maxima count. A round is repeated, and counted as repeated, if the device was not playing at the
fault. A device playing on after a fault is counted as never silent, not as a long time. POSIX
only: Windows has no signal for freezing a process.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.processes import start

from ... import processes
from ...command_process.temporary_folder import temporary_folder
from . import safety_borders, safety_silences, safety_stops, safety_values

LIMITS_MS: Final = {
    "operator stops": 50.0,
    "script raises": 1000.0 / safety_stops.RATE_HZ + 20.0,
    "script hangs": 150.0,
    "Blender killed": 50.0,
    "Blender frozen": 300.0,
    "pause, a script is late": 50.0,
    "offset is over": 50.0,
    "nothing new": 300.0,
    "computer slept": 50.0,
    "mute": 50.0,
    "cable lost": 300.0,
    "gap beside hostile scripts": 50.0,
}
"""Longest allowed time from fault to silence, milliseconds."""

P99_LIMITS_MS: Final = {"gap beside hostile scripts": 25.0}

_GAP_SECONDS: Final = 20.0
_VALUES_A_ROUND: Final = 100_000
"""Values through the limiter per round: 100 million in 1,000 rounds."""

Progress = Callable[[float], None]

KINDS: Final = {**safety_stops.KINDS, **safety_silences.KINDS, **safety_borders.KINDS}
"""Class of rounds, and number of parallel runs, by row."""

ROWS: Final = (*LIMITS_MS, "limiter", "opened files")


def measure(
    *,
    short: bool = False,
    rounds: int = 1000,
    busy: bool = False,
    only: Sequence[str] = ROWS,
    progress: Progress = lambda share: None,
) -> dict[str, Any]:
    """Measure milliseconds from fault to silence, over ``rounds`` trials of each kind.

    The result is plain data; each row also has its duration in seconds and the machine's load.

    Parameters
    ----------
    short : bool
        At most ten rounds.
    busy : bool
        Keep every processor busy during the trials.
    only : sequence of str
        Names from :data:`ROWS`.

    Raises
    ------
    InputError
        The system has no POSIX signals, or devices do not play at all.
    """
    if not hasattr(signal, "SIGSTOP"):
        raise InputError("'hfx bench safety' needs POSIX signals.")
    rounds = min(rounds, 10) if short else rounds
    gap_s = 2.0 if short else max(_GAP_SECONDS, rounds / safety_stops.RATE_HZ)
    rows: dict[str, Any] = {}
    names = [name for name in ROWS if name in only]
    with _own_data(), _load(os.cpu_count() or 1 if busy else 0):
        for k, name in enumerate(names):
            share = lambda part, k=k: progress((k + part) / len(names))  # noqa: E731
            began_s = time.monotonic()
            with temporary_folder() as folder:
                row = _measure_row(name, Path(folder), rounds, gap_s, share)
            seconds = round(time.monotonic() - began_s, 1)
            load = round(os.getloadavg()[0], 2)
            rows[name] = {**row, "seconds": seconds, "load": load, "busy": busy}
    progress(1.0)
    return rows


def _measure_row(
    name: str, folder: Path, rounds: int, gap_s: float, progress: Progress
) -> dict[str, Any]:
    if name == "limiter":
        return safety_values.limiter(rounds * _VALUES_A_ROUND)
    if name == "opened files":
        return safety_values.opened_files(folder, rounds)
    if name == "gap beside hostile scripts":
        return result_row(name, safety_stops.gaps(folder, gap_s))
    make, at_a_time = KINDS[name]
    at_a_time = min(at_a_time, rounds)
    return result_row(name, safety_stops.run(name, make, at_a_time, folder, rounds, progress))


def result_row(name: str, trials: safety_stops.Trials) -> dict[str, Any]:
    """Row of the table of silence: counts, and milliseconds (None without any trial)."""
    times = 1000.0 * np.array(trials.times_s)
    row = {
        "trials": len(times) + trials.never_silent,
        "median_ms": round(float(np.median(times)), 3) if len(times) else None,
        "p99_ms": round(float(np.percentile(times, 99)), 3) if len(times) else None,
        "max_ms": round(float(times.max()), 3) if len(times) else None,
        "limit_ms": round(LIMITS_MS[name], 1),
        "never_silent": trials.never_silent,
        "repeated": trials.not_played,
    }
    if name in P99_LIMITS_MS:
        row["p99_limit_ms"] = P99_LIMITS_MS[name]
    return row


def is_within(row: dict[str, Any]) -> bool:
    """Test a row against its limits: maximum, 99th percentile, never silent, faults."""
    if "faults" in row:
        return not row["faults"]
    return (
        not row["never_silent"]
        and row["max_ms"] is not None
        and row["max_ms"] <= row["limit_ms"]
        and row["p99_ms"] <= row.get("p99_limit_ms", np.inf)
    )


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` as a table for a terminal."""
    lines = [f"{'silence after':<28}{'trials':>8}{'median':>10}{'p99':>10}{'max':>10}{'limit':>10}"]
    for name, row in result.items():
        over = "" if is_within(row) else "  over"
        if "faults" in row:
            lines.append(f"{name}: {row['trials']:,} {row['what']}: {row['faults']}{over}")
            continue
        figures = "".join(
            f"{'-':>10}" if row[key] is None else f"{row[key]:>7.1f} ms"
            for key in ("median_ms", "p99_ms", "max_ms")
        )
        notes = [f"{row['never_silent']} never silent"] if row["never_silent"] else []
        notes += [f"{row['repeated']} repeated: did not play"] if row["repeated"] else []
        note = "  (" + ", ".join(notes) + ")" if notes else ""
        lines.append(f"{name:<28}{row['trials']:>8}{figures}{row['limit_ms']:>7.0f} ms{over}{note}")
    return "\n".join(lines)


def as_markdown(records: Sequence[dict[str, Any]]) -> str:
    """Format records as a Markdown table, one line for each row and load (idle, busy).

    ``records``: output of ``hfx bench safety --json``, idle or busy, with all rows or a part; the
    last record of a row and load counts.
    """
    lines = [
        "| silence after | machine | trials | median | p99 | max | at most |",
        "|---" * 7 + "|",
    ]
    rows = {(n, row["busy"]): row for record in records for n, row in record["safety"].items()}
    for name in ROWS:
        for busy in (False, True):
            row = rows.get((name, busy))
            if row is None:
                continue
            machine = f"{'busy' if busy else 'idle'}, load {row['load']:.1f}"
            if "faults" in row:
                figures = f"| | {row['faults']} {row['what']} | 0"
            else:
                times = (row[key] for key in ("median_ms", "p99_ms", "max_ms"))
                text = " | ".join(
                    "-" if time_ms is None else f"{time_ms:.1f} ms" for time_ms in times
                )
                never = f", {row['never_silent']} never silent" if row["never_silent"] else ""
                figures = f"{text}{never} | {row['limit_ms']:.0f} ms"
            lines.append(f"| {name} | {machine} | {row['trials']:,} | {figures} |")
    return "\n".join(lines)


@contextmanager
def _own_data() -> Iterator[None]:
    """Context with an empty folder of user data, for approved scripts and settings of devices."""
    before = os.environ.get(resources.USER_DATA_VARIABLE)
    with temporary_folder() as folder:
        os.environ[resources.USER_DATA_VARIABLE] = str(folder)
        try:
            yield
        finally:
            if before is None:
                del os.environ[resources.USER_DATA_VARIABLE]
            else:
                os.environ[resources.USER_DATA_VARIABLE] = before


@contextmanager
def _load(count: int) -> Iterator[None]:
    """Context with ``count`` busy processes."""
    busy = [start.start(processes.program("while True: pass")) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()
