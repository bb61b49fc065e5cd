# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic samples, the engine's output: which vertices feel which effect, when and how strongly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
        j = k if self.sets is None else int(self.sets[k])
        entries = slice(int(self.offsets[j]), int(self.offsets[j + 1]))
        row = slice(k, k + 1)

        def part(values: F32 | None) -> F32 | None:
            return None if values is None else values[entries]

        return SampleRun(
            stream=self.stream,
            indices=self.indices[row],
            times_s=self.times_s[row],
            levels=self.levels[row],
            parameters=self.parameters[row],
            offsets=np.array([0, entries.stop - entries.start]),
            vertices=self.vertices[entries],
            weights=self.weights[entries],
            positions=part(self.positions),
            velocities=part(self.velocities),
            depth_m=part(self.depth_m),
            surface=part(self.surface),
            surface_normals=part(self.surface_normals),
            impact=None if self.impact is None else self.impact.part(entries),
            focus=None if self.focus is None else self.focus[row],
            drive=None if self.drive is None else self.drive.part(row),
        )

    def __iter__(self) -> Iterator[Sample]:
        for k, j in enumerate(self.set_of.tolist()):
            part = slice(int(self.offsets[j]), int(self.offsets[j + 1]))
            yield Sample(
                time_s=float(self.times_s[k]),
                stream=self.stream,
                vertices=self.vertices[part],
                weights=self.weights[part],
                level=float(self.levels[k]),
                parameters=self.parameters[k],
                positions=None if self.positions is None else self.positions[part],
                velocities=None if self.velocities is None else self.velocities[part],
                depth_m=None if self.depth_m is None else self.depth_m[part],
                surface=None if self.surface is None else self.surface[part],
                surface_normals=(
                    None if self.surface_normals is None else self.surface_normals[part]
                ),
                impact=None if self.impact is None else self.impact.part(part),
                focus=None if self.focus is None else self.focus[k],
                drive=None if self.drive is None else self.drive.part(slice(k, k + 1)),
            )
