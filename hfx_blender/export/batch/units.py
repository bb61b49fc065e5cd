# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of work: a scene, a part of its samples, or the parts to be put together.

Parts are what one command hands to its workers. Pieces are the same for a farm: each is a command
of its own, and what it recorded lies beside the results until a last one puts them together.

A unit and its outcome are JSON, so that a worker can be another process.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

from .options import ExportOptions

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
