# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic samples, the engine's output: vertices, effect, time and strength."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np

from .arrays import F32, F64, I32, I64


@dataclass(frozen=True)
class Stream:
    """Identity of a run of samples: an effect on a body."""

    effect_id: str
    body_id: str
    modality: str
    model_id: str


@dataclass(frozen=True, eq=False)
class Impact:
    """Beginnings of contacts; NaN for contacts not begun since the previous sample."""

    times_s: F64  # (n,)
    speeds_m_s: F32  # (n,) approach of skin and volume along the normal
    normals: F32  # (n, 3) outward normals of the volume, world space

    def part(self, chosen: slice) -> "Impact":
        """Impacts of a slice ``chosen`` of the vertices."""
        return Impact(self.times_s[chosen], self.speeds_m_s[chosen], self.normals[chosen])


@dataclass(frozen=True, eq=False)
class Drive:
    """Values of an effect for individual actuators of a device."""

    device_id: str
    actuators: tuple[str, ...]
    values: F32  # (n, A) 0..1, one row per sample

    def part(self, chosen: slice) -> "Drive":
        """Values of a slice ``chosen`` of the samples."""
        return Drive(self.device_id, self.actuators, self.values[chosen])

    def gains(self, device_id: str, actuators: Sequence[str]) -> F64:
        """Values (n, A) for the named actuators of a device; 0 for unknown actuators and another
        device."""
        gains = np.zeros((len(self.values), len(actuators)))
        if self.device_id == device_id:
            # An effect may drive actuators in another order than the device's, or missing ones.
            columns = {actuator: k for k, actuator in enumerate(self.actuators)}
            for a, actuator in enumerate(actuators):
                if actuator in columns:
                    gains[:, a] = self.values[:, columns[actuator]]
        return gains


@dataclass(frozen=True, eq=False)
class Sample:
    """Sample of an effect on a body at a time."""

    time_s: float
    stream: Stream
    vertices: I32  # (n,) ascending ids of the stream's model
    weights: F32  # (n,) spatial strength, in (0, 1]
    level: float  # temporal strength, in (0, 1]
    parameters: F64  # (P,) in the order of the modality's parameters
    positions: F32 | None = None  # (n, 3) world space, metres
    velocities: F32 | None = None  # (n, 3) world space, m/s
    depth_m: F32 | None = None  # (n,) distance to the volume's boundary
    forces_n: F32 | None = None  # (n, 3) on the skin, world space, newtons
    surface: F32 | None = None  # (n, 3) nearest boundary point, world space, metres
    surface_normals: F32 | None = None  # (n, 3) outward normals at the boundary points
    impact: Impact | None = None
    focus: F32 | None = None  # (4,) see SampleRun
    drive: Drive | None = None  # one row


@dataclass(frozen=True, eq=False)
class SampleRun:
    """Samples of a stream over a block of times, in columns.

    Vertex sets are shared: set ``j`` has the vertices ``slice(offsets[j], offsets[j + 1])``, sample
    ``k`` has set ``sets[k]`` (None: set ``k``). Times without sensation have no sample.

    A spot also has its exact centre, for devices with panning. Effects on individual actuators have
    no vertices.
    """

    stream: Stream
    indices: I64  # (n,) sample indices of the time base, ascending
    times_s: F64  # (n,)
    levels: F64  # (n,) in (0, 1]
    parameters: F64  # (n, P)
    offsets: I64  # (m + 1,)
    vertices: I32  # (total,) ascending within a set
    weights: F32  # (total,) in (0, 1]
    sets: I64 | None = None  # (n,) from 0, rising by 0 or 1
    positions: F32 | None = None  # (total, 3); only without shared sets
    velocities: F32 | None = None  # (total, 3)
    depth_m: F32 | None = None  # (total,)
    forces_n: F32 | None = None  # (total, 3) only of volumes with a contact law
    surface: F32 | None = None  # (total, 3)
    surface_normals: F32 | None = None  # (total, 3)
    impact: Impact | None = None  # (total,)
    focus: F32 | None = None  # (n, 4) spot centre, rest space, and half-strength radius, metres
    drive: Drive | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def set_of(self) -> I64:
        """Set number (n,) of each sample; 0 to n - 1 without shared sets."""
        return np.arange(len(self.indices)) if self.sets is None else self.sets

    @property
    def sizes(self) -> I64:
        """Number of vertices (n,) of each sample."""
        return np.asarray(np.diff(self.offsets)[self.set_of])

    @property
    def contact_count(self) -> int:
        """Number of (sample, vertex) pairs; a shared set counts for each of its samples."""
        if self.sets is None or len(self.sets) == len(self.offsets) - 1:
            return len(self.vertices)  # no shared sets
        return int(self.sizes.sum())

    def one(self, k: int) -> "SampleRun":
        """Run with sample ``k`` alone, with its own vertex set, impacts and drive."""
        # Row k of the samples, but the entries of its set, which other samples may share.
        j = int(self.set_of[k])
        row, entries = slice(k, k + 1), slice(int(self.offsets[j]), int(self.offsets[j + 1]))
        return replace(
            self,
            **self._cut(ROWS, row),
            **self._cut(ENTRIES, entries),
            offsets=np.array([0, entries.stop - entries.start]),
            sets=None,
            impact=None if self.impact is None else self.impact.part(entries),
            drive=None if self.drive is None else self.drive.part(row),
        )

    def __iter__(self) -> Iterator[Sample]:
        # Entries are per set, rows per sample.
        for k, j in enumerate(self.set_of.tolist()):
            entries = slice(int(self.offsets[j]), int(self.offsets[j + 1]))
            yield Sample(
                time_s=float(self.times_s[k]),
                stream=self.stream,
                level=float(self.levels[k]),
                parameters=self.parameters[k],
                **self._cut(ENTRIES, entries),
                impact=None if self.impact is None else self.impact.part(entries),
                focus=None if self.focus is None else self.focus[k],
                drive=None if self.drive is None else self.drive.part(slice(k, k + 1)),
            )

    def _cut(self, names: tuple[str, ...], part: slice) -> dict[str, Any]:
        """Slice ``part`` of the named columns, by name; absent columns are left out."""
        columns = {name: getattr(self, name) for name in names}
        return {name: column[part] for name, column in columns.items() if column is not None}


ROWS: Final = ("indices", "times_s", "levels", "parameters", "focus")
"""Columns of a run with one row per sample."""

ENTRIES: Final = (
    *("vertices", "weights", "positions", "velocities", "depth_m", "forces_n"),
    *("surface", "surface_normals"),
)
"""Columns of a run with one entry per vertex of each set."""


def joined_runs(
    blocks: Iterable[Sequence[SampleRun]], streams: Sequence[Stream]
) -> list[SampleRun]:
    """Join the runs of successive blocks into one run per stream, in the order of ``streams``.
    Streams without samples are omitted, as are runs of other streams. Raises ValueError if runs of
    a stream have different optional columns."""
    # Blocks come in order of time, so the runs of a stream do, too.
    runs_by_stream: dict[Stream, list[SampleRun]] = {}
    for block in blocks:
        for run in block:
            if len(run):
                runs_by_stream.setdefault(run.stream, []).append(run)
    return [_joined(runs_by_stream[stream]) for stream in streams if stream in runs_by_stream]


def _joined(runs: list[SampleRun]) -> SampleRun:
    """Concatenate the runs of a stream, in order; a single run is returned unchanged. Raises
    ValueError if only some have an optional column, or for drives of several devices."""
    first = runs[0]
    if len(runs) == 1:
        return first
    fault = f"effect '{first.stream.effect_id}': what its samples carry changes"

    def parts_of(name: str) -> list[Any]:
        parts = [part for run in runs if (part := getattr(run, name)) is not None]
        if len(parts) not in (0, len(runs)):
            raise ValueError(fault)
        return parts

    # Sets and entries of a run are counted from 0, so later runs are shifted by those before.
    set_counts = np.cumsum([0, *(len(run.offsets) - 1 for run in runs)])
    entries = np.cumsum([0, *(len(run.vertices) for run in runs)])
    tails = [run.offsets[1:] + n for run, n in zip(runs, entries, strict=False)]
    columns: dict[str, Any] = {"offsets": np.concatenate([first.offsets[:1], *tails])}
    if any(run.sets is not None for run in runs):
        sets = [run.set_of + n for run, n in zip(runs, set_counts, strict=False)]
        columns["sets"] = np.concatenate(sets)
    for name in (*ROWS, *ENTRIES):
        parts = parts_of(name)
        columns[name] = np.concatenate(parts) if parts else None
    if impacts := parts_of("impact"):
        values = ([getattr(part, item.name) for part in impacts] for item in fields(Impact))
        columns["impact"] = Impact(*map(np.concatenate, values))
    if drives := parts_of("drive"):
        if len({(part.device_id, part.actuators) for part in drives}) > 1:
            raise ValueError(fault)
        strengths = [part.values for part in drives]
        columns["drive"] = replace(drives[0], values=np.concatenate(strengths))
    return replace(first, **columns)
