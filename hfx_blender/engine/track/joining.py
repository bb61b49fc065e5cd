# SPDX-License-Identifier: GPL-3.0-or-later
"""Concatenation of successive runs of streams."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..samples import ENTRIES, ROWS, Drive, Impact, SampleRun, Stream


def joined(blocks: Iterable[Sequence[SampleRun]], streams: Sequence[Stream]) -> list[SampleRun]:
    """Join the runs of successive blocks into one run per stream.

    Parameters
    ----------
    streams : sequence of Stream
        Possible streams, in the order of the result; streams without samples are omitted.

    Raises
    ------
    ValueError
        Runs of a stream have different optional columns.
    """
    runs_by_stream: dict[Stream, list[SampleRun]] = {}
    for block in blocks:
        for run in block:
            if len(run):
                runs_by_stream.setdefault(run.stream, []).append(run)
    return [_one(runs_by_stream[stream]) for stream in streams if stream in runs_by_stream]


def _one(runs: list[SampleRun]) -> SampleRun:
    """Concatenate the runs of a stream; a single run is returned unchanged."""
    first = runs[0]
    if len(runs) == 1:
        return first
    set_counts = np.cumsum([0, *(len(run.offsets) - 1 for run in runs)])
    entries = np.cumsum([0, *(len(run.vertices) for run in runs)])
    sets = None
    if any(run.sets is not None for run in runs):
        sets = np.concatenate([run.set_of + n for run, n in zip(runs, set_counts, strict=False)])
    tails = [run.offsets[1:] + n for run, n in zip(runs, entries, strict=False)]
    impacts = [run.impact for run in runs if run.impact is not None]
    drives = [run.drive for run in runs if run.drive is not None]
    if len(impacts) not in (0, len(runs)) or len(drives) not in (0, len(runs)):
        raise ValueError(_differing(first))
    columns: dict[str, Any] = {name: _column(runs, name) for name in (*ROWS, *ENTRIES)}
    return replace(
        first,
        **columns,
        offsets=np.concatenate([first.offsets[:1], *tails]),
        sets=sets,
        impact=_impact(impacts) if impacts else None,
        drive=_drive(drives, first) if drives else None,
    )


def _column(runs: list[SampleRun], name: str) -> npt.NDArray[Any] | None:
    """Concatenated column; None if no run has the column, ValueError if only some have."""
    parts = [getattr(run, name) for run in runs]
    if all(part is None for part in parts):
        return None
    if any(part is None for part in parts):
        raise ValueError(_differing(runs[0]))
    return np.concatenate(parts)


def _impact(parts: list[Impact]) -> Impact:
    """Concatenated impacts."""
    return Impact(
        np.concatenate([part.times_s for part in parts]),
        np.concatenate([part.speeds_m_s for part in parts]),
        np.concatenate([part.normals for part in parts]),
    )


def _drive(parts: list[Drive], run: SampleRun) -> Drive:
    """Concatenated drives of a device; raises ValueError for several devices."""
    if len({(part.device_id, part.actuators) for part in parts}) > 1:
        raise ValueError(_differing(run))
    return replace(parts[0], values=np.concatenate([part.values for part in parts]))


def _differing(run: SampleRun) -> str:
    """Message about runs with different columns."""
    return f"effect '{run.stream.effect_id}': what its samples carry changes"
