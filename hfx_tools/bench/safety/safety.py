# SPDX-License-Identifier: GPL-3.0-or-later
"""Safety: time until a device is silent after any failure, and events that must never happen.

Maxima count. A round in which the device did not play when the fault came says nothing about
silence: it is repeated and counted. A device that plays on after a fault is a failure of its
own, never a long time. POSIX only: Windows has no signal that freezes.
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
from hfx_blender.files.staging import temporary_folder
from hfx_blender.processes import start

from ... import processes
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
"""The longest allowed."""

P99_LIMITS_MS: Final = {"gap beside hostile scripts": 25.0}

_GAP_SECONDS: Final = 20.0
_VALUES_A_ROUND: Final = 100_000
"""1,000 rounds push 100 million values through the limiter."""

Progress = Callable[[float], None]

KINDS: Final = {**safety_stops.KINDS, **safety_silences.KINDS, **safety_borders.KINDS}
"""Runner of the rounds of rows, and how many of them at a time."""

ROWS: Final = (*LIMITS_MS, "limiter", "opened files")


def measure(
    *,
    short: bool = False,
    rounds: int = 1000,
    busy: bool = False,
    only: Sequence[str] = ROWS,
    progress: Progress = lambda share: None,
) -> dict[str, Any]:
    """Milliseconds from fault to silence, over ``rounds`` trials of each kind; plain data.

    Each row says how long it took and how busy the machine was.

    Parameters
    ----------
    short : bool
        At most ten rounds.
    rounds : int
    busy : bool
        Keep every processor busy meanwhile.
    only : sequence of str
        Of :data:`ROWS`.
    progress : callable

    Raises
    ------
    InputError
        This system has no signals to freeze a process with, or devices do not play at all.
    """
    if not hasattr(signal, "SIGSTOP"):
        raise InputError("'hfx bench safety' needs POSIX signals.")
    rounds = min(rounds, 10) if short else rounds
    gap_s = 2.0 if short else max(_GAP_SECONDS, rounds / safety_stops.RATE_HZ)
    found: dict[str, Any] = {}
    names = [name for name in ROWS if name in only]
    with _own_data(), _load(os.cpu_count() or 1 if busy else 0):
        for k, name in enumerate(names):
            share = lambda part, k=k: progress((k + part) / len(names))  # noqa: E731
            began_s = time.monotonic()
            with temporary_folder() as folder:
                row = _measured(name, Path(folder), rounds, gap_s, share)
            seconds = round(time.monotonic() - began_s, 1)
            load = round(os.getloadavg()[0], 2)
            found[name] = {**row, "seconds": seconds, "load": load, "busy": busy}
    progress(1.0)
    return found


def _measured(
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
    """Row of the table of silence: counts, and times in milliseconds."""
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
    """Test a figure against its limit."""
    if "faults" in row:
        return not row["faults"]
    return (
        not row["never_silent"]
        and row["max_ms"] is not None
        and row["max_ms"] <= row["limit_ms"]
        and row["p99_ms"] <= row.get("p99_limit_ms", np.inf)
    )


def as_text(result: dict[str, Any]) -> str:
    """A table for people."""
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
    """A table for a page.

    Parameters
    ----------
    records : sequence of dict
        As ``hfx bench safety --json`` prints them, idle or busy, of all rows or of some; of two
        that measured the same, the last counts.
    """
    lines = [
        "| silence after | machine | trials | median | p99 | max | at most |",
        "|---" * 7 + "|",
    ]
    rows = {(n, row["busy"]): row for each in records for n, row in each["safety"].items()}
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
                told = " | ".join("-" if each is None else f"{each:.1f} ms" for each in times)
                never = f", {row['never_silent']} never silent" if row["never_silent"] else ""
                figures = f"{told}{never} | {row['limit_ms']:.0f} ms"
            lines.append(f"| {name} | {machine} | {row['trials']:,} | {figures} |")
    return "\n".join(lines)


@contextmanager
def _own_data() -> Iterator[None]:
    """User data of the bench's own: its scripts are approved and its devices are on there."""
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
    """Context with processes that keep processors busy."""
    busy = [start.start(processes.program("while True: pass")) for _ in range(count)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()
