# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries of JSON Lines of samples: vertex sets and samples, before they become text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...engine.arrays import F32, I32
from ...engine.modality import MODALITIES
from ...engine.samples import SampleRun, Stream
from ...files.json_shapes import clean


@dataclass(frozen=True, eq=False)
class SetEntry:
    """Vertices and weights that samples of one stream refer to."""

    number: int
    stream: Stream
    vertices: I32  # (n,) ascending
    weights: F32  # (n,) in (0, 1]


@dataclass(frozen=True, eq=False)
class SampleEntry:
    """Sample ``k`` of a run."""

    run: SampleRun
    k: int
    set_number: int

    @property
    def parameters(self) -> dict[str, float]:
        """Physical parameters by name."""
        names = MODALITIES[self.run.stream.modality].parameter_names
        values = self.run.parameters[self.k].tolist()
        return {name: round(value, 6) for name, value in zip(names, values, strict=True)}

    def felt(self) -> dict[str, Any]:
        """Members that both encodings have alike: a spot's exact place, values of actuators."""
        run, k = self.run, self.k
        found: dict[str, Any] = {"level": round(float(run.levels[k]), 6)}
        if run.focus is not None:
            *centre, radius = (round(each, 6) for each in run.focus[k].astype(float).tolist())
            found["spot"] = {"centre_m": centre, "radius_m": radius}
        if run.drive is not None:
            values = run.drive.values[k].astype(float).tolist()
            found["actuators"] = [round(each, 4) for each in values]
        return found

    def line(self) -> dict[str, Any]:
        """The sample as a line of the plain encoding."""
        return {
            "type": "sample",
            "t": self.time_s,
            "effect": clean(self.run.stream.effect_id),
            "body": clean(self.run.stream.body_id),
            "set": self.set_number,
            **self.felt(),
            "parameters": self.parameters,
        }

    @property
    def time_s(self) -> float:
        """Time since the scene's first frame, to a nanosecond."""
        return round(float(self.run.times_s[self.k]), 9)


def set_of(run: SampleRun, k: int) -> tuple[I32, F32]:
    """Vertices and weights of sample ``k``."""
    j = k if run.sets is None else int(run.sets[k])
    part = slice(int(run.offsets[j]), int(run.offsets[j + 1]))
    return run.vertices[part], run.weights[part]
