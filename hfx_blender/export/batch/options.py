# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of an export, as plain data that any worker understands."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from fractions import Fraction
from typing import Any, Self

from ...engine.tolerance import parse as parse_tolerance
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
