# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic samples, the engine's output: which vertices feel which effect, when and how strongly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from .arrays import F32, F64, I32, I64


@dataclass(frozen=True)
class Stream:
    """Effect on a body: the identity that a run of samples belongs to."""

    effect_id: str
    body_id: str
    modality: str
    model_id: str


@dataclass(frozen=True, eq=False)
class Impact:
    """Beginnings of contacts; NaN for contacts that did not begin since the sample before."""

    times_s: F64  # (n,)
    speeds_m_s: F32  # (n,) of skin and volume towards each other, along the normal
    normals: F32  # (n, 3) of the volume, outwards, world space

    def part(self, chosen: slice) -> Impact:
        """Impacts of some vertices."""
        return Impact(self.times_s[chosen], self.speeds_m_s[chosen], self.normals[chosen])


@dataclass(frozen=True, eq=False)
class Drive:
    """Values of an effect for single actuators of one device."""

    device_id: str
    actuators: tuple[str, ...]
    values: F32  # (n, A) 0..1, a row for each sample

    def part(self, chosen: slice) -> Drive:
        """Values of some samples."""
        return Drive(self.device_id, self.actuators, self.values[chosen])

    def gains(self, device_id: str, actuators: Sequence[str]) -> F64:
        """Values (n, A) for A actuators of a device; 0 for other actuators and devices."""
        gains = np.zeros((len(self.values), len(actuators)))
        if self.device_id == device_id:
            columns = {actuator: k for k, actuator in enumerate(self.actuators)}
            for a, actuator in enumerate(actuators):
                if actuator in columns:
                    gains[:, a] = self.values[:, columns[actuator]]
        return gains


@dataclass(frozen=True, eq=False)
class Sample:
    """Sample of one effect on one body at one time."""

    time_s: float
    stream: Stream
    vertices: I32  # (n,) ascending ids of the stream's model
    weights: F32  # (n,) space only, in (0, 1]
    level: float  # time only, in (0, 1]
    parameters: F64  # (P,) in the order of the modality's parameters
    positions: F32 | None = None  # (n, 3) world space, metres
    velocities: F32 | None = None  # (n, 3) world space, m/s
    depth_m: F32 | None = None  # (n,) distance to the volume's boundary
    surface: F32 | None = None  # (n, 3) nearest place on that boundary, world space, metres
    surface_normals: F32 | None = None  # (n, 3) outwards there
    impact: Impact | None = None
    focus: F32 | None = None  # (4,) see SampleRun
    drive: Drive | None = None  # of one row


@dataclass(frozen=True, eq=False)
class SampleRun:
    """The samples of one stream over a block of times, in columns.

    A vertex set that stays is held once: set ``j`` has the vertices ``slice(offsets[j],
    offsets[j + 1])``, and sample ``k`` has set ``sets[k]`` (None: each sample has its own).
    Only times at which something is felt have a sample.

    A spot has its exact centre beside its vertices: what is between them is not lost on a device
    that pans. An effect that drives single actuators has no vertices at all.
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
    positions: F32 | None = None  # (total, 3); only where each sample has a set of its own
    velocities: F32 | None = None  # (total, 3)
    depth_m: F32 | None = None  # (total,)
    surface: F32 | None = None  # (total, 3)
    surface_normals: F32 | None = None  # (total, 3)
    impact: Impact | None = None  # (total,)
    focus: F32 | None = None  # (n, 4) a spot's centre, rest space, and half-strength radius, m
    drive: Drive | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def set_of(self) -> I64:
        """The set of each sample, (n,)."""
        return np.arange(len(self.indices)) if self.sets is None else self.sets

    @property
    def sizes(self) -> I64:
        """Number of vertices of each sample, (n,)."""
        sizes: I64 = np.diff(self.offsets)[self.set_of]
        return sizes

    @property
    def contact_count(self) -> int:
        """Number of vertices of all samples together."""
        if self.sets is None or len(self.sets) == len(self.offsets) - 1:
            return len(self.vertices)  # each sample has a set of its own
        return int(self.sizes.sum())

    def one(self, k: int) -> SampleRun:
        """Sample ``k`` as a run of its own."""
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
        """Part of those of some columns that are there."""
        columns = {name: getattr(self, name) for name in names}
        return {name: column[part] for name, column in columns.items() if column is not None}


ROWS: Final = ("indices", "times_s", "levels", "parameters", "focus")
"""Columns of a run with a row for each sample."""

ENTRIES: Final = (
    *("vertices", "weights", "positions", "velocities", "depth_m", "surface", "surface_normals"),
)
"""Columns of a run with an entry for each vertex of each set."""
