# SPDX-License-Identifier: GPL-3.0-or-later
"""Joins successive runs of the same streams into one of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..samples import ENTRIES, ROWS, Drive, Impact, SampleRun, Stream


def joined(blocks: Iterable[Sequence[SampleRun]], streams: Sequence[Stream]) -> list[SampleRun]:
    """Join the runs of successive blocks into one run for each stream.

    Parameters
    ----------
    streams : sequence of Stream
        All that there may be, in the order of the runs that are returned.

    Raises
    ------
    ValueError
        Runs of a stream differ in what they carry.
    """
    found: dict[Stream, list[SampleRun]] = {}
    for block in blocks:
        for run in block:
            if len(run):
                found.setdefault(run.stream, []).append(run)
    return [_one(found[stream]) for stream in streams if stream in found]


def _one(runs: list[SampleRun]) -> SampleRun:
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
    parts = [getattr(run, name) for run in runs]
    if all(part is None for part in parts):
        return None
    if any(part is None for part in parts):
        raise ValueError(_differing(runs[0]))
    return np.concatenate(parts)


def _impact(parts: list[Impact]) -> Impact:
    return Impact(
        np.concatenate([part.times_s for part in parts]),
        np.concatenate([part.speeds_m_s for part in parts]),
        np.concatenate([part.normals for part in parts]),
    )


def _drive(parts: list[Drive], run: SampleRun) -> Drive:
    if len({(part.device_id, part.actuators) for part in parts}) > 1:
        raise ValueError(_differing(run))
    return replace(parts[0], values=np.concatenate([part.values for part in parts]))


def _differing(run: SampleRun) -> str:
    return f"effect '{run.stream.effect_id}': what its samples carry changes"
