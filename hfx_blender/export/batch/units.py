# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of work: a scene, a part of its samples, or the parts to be put together, with options.

Parts are what one command hands to its workers. Pieces are the same for a farm: each is a command
of its own, and what it recorded lies beside the results until a last one puts them together.

A unit and its outcome are JSON, so that a worker can be another process.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from ...engine.tolerance import parse as parse_tolerance
from ...engine.track.layout import SAMPLES_PER_CHUNK
from ...formats.clip import DETAIL


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; None stands for the scene's own setting."""

    formats: tuple[str, ...] | None = None
    devices: tuple[str, ...] | None = None  # names or files
    frames: tuple[int, int] | None = None  # both included
    rate: str | None = None  # samples a second, a fraction
    tolerance: str | None = None
    full_precision: bool = False
    record: tuple[str, ...] = ()
    strict: bool = False
    scene: str | None = None
    per_clip: bool = False
    clip_detail: int = DETAIL

    def __post_init__(self) -> None:
        if self.rate is not None:
            Fraction(self.rate)
        if self.tolerance is not None:
            parse_tolerance(self.tolerance)

    def as_json(self) -> dict[str, Any]:
        """Plain data for :meth:`from_json`; options with default values are left out."""
        default = ExportOptions()
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
            if value != getattr(default, name)
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Options from :meth:`as_json` data."""
        unknown = set(data) - {each.name for each in fields(cls)}
        if unknown:
            raise ValueError(f"unknown options: {', '.join(sorted(unknown))}")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in data.items()
        }
        return cls(**values)


Outcome = dict[str, Any]
"""``report`` and ``text`` of a finished scene, ``split`` into parts, a finished ``part``, a
finished ``piece`` and ``text``, or ``error`` and ``exit_code``."""


@dataclass(frozen=True)
class Unit:
    """Unit of work; a scene is exported to ``folder/stem.*``."""

    kind: Literal["scene", "part", "merge", "piece", "join"]
    input: str | None  # a .blend; None: the file that is open in this process
    folder: str
    stem: str
    stage: str  # a folder for unfinished files; its creator removes it
    options: ExportOptions
    parts: int = 1  # of a scene: largest number of parts, if it is long
    part_frames: int | None = None  # of a scene: approximate frames of a part
    part: tuple[int, int] | None = None  # of a part: first sample, and the first beyond it
    done: tuple[dict[str, Any], ...] = ()  # of a merge: the outcomes of all parts
    cores: int = 1  # of the worker; the result does not depend on it
    piece: tuple[int, int] | None = None  # of a piece: its number, from 1, and the number of pieces

    @property
    def title(self) -> str:
        """Name of the unit for the user."""
        return "the open file" if self.input is None else Path(self.input).name

    def in_stage(self, stage: Path) -> Unit:
        """Copy of the unit with another folder for unfinished files."""
        return replace(self, stage=str(stage))

    def as_json(self) -> dict[str, Any]:
        """Plain data, for :meth:`from_json`."""
        return {**asdict(self), "options": self.options.as_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        return cls(
            **{
                **data,
                "options": ExportOptions.from_json(data["options"]),
                "part": None if data["part"] is None else tuple(data["part"]),
                "done": tuple(data["done"]),
                "piece": None if data["piece"] is None else tuple(data["piece"]),
            }
        )


def failure(unit: Unit, error: str, exit_code: int, **more: Any) -> Outcome:
    """Outcome of a unit that failed."""
    return {"input": unit.title, "error": error, "exit_code": exit_code, **more}


SHORTEST = 8 * SAMPLES_PER_CHUNK
"""Samples at which something may be felt in a part that is cut off to keep workers busy: with
fewer, opening the scene once more costs more than it saves."""


def even_parts(
    samples: npt.NDArray[np.int64], count: int, parts: int, shortest: int = SHORTEST
) -> list[tuple[int, int]]:
    """Cut so that each part has about as many samples to work on.

    Parameters
    ----------
    samples : (n,) int64
        At which something may be felt, ascending.
    count : int
        Of all samples; the parts cover them.
    parts : int
        At most so many.
    shortest : int
        Least samples to work on in a part, about.

    Returns
    -------
    list of (first, stop)
        Whole chunks of a track, but for the last.
    """
    parts = max(min(parts, len(samples) // max(shortest, 1)), 1)
    cuts = [int(samples[len(samples) * k // parts]) for k in range(1, parts)]
    return _between(cuts, count)


def parts_of(size: int, count: int) -> list[tuple[int, int]]:
    """Cut into parts of ``size`` samples, rounded up to whole chunks of a track."""
    whole = -(-max(size, 1) // SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK
    return _between(list(range(whole, count, whole)), count)


def _between(cuts: list[int], count: int) -> list[tuple[int, int]]:
    rounded = {round(cut / SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK for cut in cuts}
    edges = sorted({0, count, *(cut for cut in rounded if 0 < cut < count)})
    return list(pairwise(edges))
