# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of work of an export: scenes, parts of scenes, pieces, and merges, with options.

Workers of a command share the *parts* of a scene. Jobs of a render farm share *pieces*: each piece
is recorded by a separate command and stored in the output folder until a last command joins them.
Units and outcomes are JSON, for worker processes.
"""

from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ...engine.tolerance import parse as parse_tolerance
from ...engine.track.layout import SAMPLES_PER_CHUNK
from ...formats.clip import DETAIL


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; None for the setting of the scene. Raises ValueError for bad text."""

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
    profile: tuple[str, str] = ("", "")  # name of a person's profile, and hash of the file

    def __post_init__(self) -> None:
        if self.rate is not None:
            Fraction(self.rate)
        if self.tolerance is not None:
            parse_tolerance(self.tolerance)

    # Defaults are left out, so that an option added later does not void earlier exports.
    def as_json(self) -> dict[str, Any]:
        """Unit as plain data, without options that have their default values."""
        default = ExportOptions()
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
            if value != getattr(default, name)
        }


Outcome = dict[str, Any]
"""``report`` and ``text`` of a finished scene, ``split`` into parts, a finished ``part``, a
finished ``piece`` and ``text``, or ``error`` and ``exit_code``."""


@dataclass(frozen=True)
class Unit:
    """Unit of work; a scene is exported to ``folder/stem.*``."""

    kind: Literal["scene", "part", "merge", "piece", "join"]
    input: str | None  # path of a .blend; None: the file open in this process
    folder: str
    stem: str
    stage: str  # folder of unfinished files, removed by its creator
    options: ExportOptions
    parts: int = 1  # of a scene: largest number of parts, if it is long
    part_frames: int | None = None  # of a scene: approximate frames of a part
    part: tuple[int, int] | None = None  # of a part: samples first <= index < stop
    done: tuple[dict[str, Any], ...] = ()  # of a merge: the outcomes of all parts
    cores: int = 1  # of the worker, without effect on results
    piece: tuple[int, int] | None = None  # of a piece: number from 1, and count of pieces

    @property
    def title(self) -> str:
        """Name of the scene's file in messages."""
        return "the open file" if self.input is None else Path(self.input).name


def failure(unit: Unit, error: str, exit_code: int, **more: Any) -> Outcome:
    """Outcome of a failed unit."""
    return {"input": unit.title, "error": error, "exit_code": exit_code, **more}


SHORTEST = 8 * SAMPLES_PER_CHUNK
"""Smallest number of active samples of an automatic part; shorter parts save less time than a
second opening of the scene costs."""


def even_parts(
    samples: npt.NDArray[np.int64], count: int, parts: int, shortest: int = SHORTEST
) -> list[tuple[int, int]]:
    """Cut ``count`` samples into at most ``parts`` ranges with equal numbers of active samples.
    ``samples`` (n,) are the active ones (an effect may be felt), ascending. A range has about
    ``shortest`` of them or more. Returns ascending (first, stop), at multiples of
    ``SAMPLES_PER_CHUNK`` except for the end."""
    # Silent samples cost little, so parts have equal numbers of active samples instead of equal
    # lengths.
    parts = max(min(parts, len(samples) // max(shortest, 1)), 1)
    cuts = [int(samples[len(samples) * k // parts]) for k in range(1, parts)]
    return _between(cuts, count)


def parts_of(size: int, count: int) -> list[tuple[int, int]]:
    """Cut ``count`` samples into (first, stop) of ``size``, rounded up to whole chunks."""
    # Round up to whole chunks: a chunk is compressed as a unit and belongs to one part.
    whole = -(-max(size, 1) // SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK
    return _between(list(range(whole, count, whole)), count)


def _between(cuts: list[int], count: int) -> list[tuple[int, int]]:
    rounded = {round(cut / SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK for cut in cuts}
    # Rounded cuts may coincide: a set holds each edge once, so no part is empty.
    edges = sorted({0, count, *(cut for cut in rounded if 0 < cut < count)})
    return list(pairwise(edges))
