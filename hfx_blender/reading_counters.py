# SPDX-License-Identifier: GPL-3.0-or-later
"""Counters of reading a scene: "only what a scene requires" is tested and reported by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

from .engine.modality import neutral_temperature_c


@dataclass(frozen=True)
class Unfelt:
    """Reason why nothing is felt of an effect; it goes on after the effect's name."""

    reason: str
    is_expected: bool = False  # the user asked for it: no warning


_STRENGTHS: Final = {"vibration": "amplitude", "pressure": "pressure", "wind": "wind speed"}


def powerless_reason(modality: str, is_contact: bool) -> str:
    """Reason why an effect without strength is not felt; it goes on after the effect's name."""
    if modality == "temperature":
        return f"has the neutral temperature, {neutral_temperature_c(is_contact):g} °C"
    return f"has {_STRENGTHS[modality]} 0"


@dataclass
class ReadingCounters:
    """Work done since a scene's reader was made."""

    times_stepped: int = 0  # Blender was set to a time, and evaluated what is stepped
    frames_played: int = 0  # of simulations, before anything was read
    effects_read: int = 0  # (effect, time) of which all was read from Blender
    places_read: int = 0  # (volume, time) of which only the place and a box were read
    poses_read: int = 0  # (body, time) read from Blender
    meshes_read: int = 0  # (mesh, time) whose vertices were read
    meshes_made: int = 0  # meshes made into closed surfaces
    instances: int = 0  # volumes that are shown as instances
    # Volume: number of its samples in blocks of which only its place was needed, by their first.
    far: dict[str, dict[str, int]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)  # effect: why nothing of it was read

    def add(self, more: ReadingCounters) -> None:
        """Count what was counted where another part of the scene was read."""
        for name in _NUMBERS:
            setattr(self, name, getattr(self, name) + getattr(more, name))
        self.instances = max(self.instances, more.instances)
        for name, blocks in more.far.items():
            self.far.setdefault(name, {}).update(blocks)
        self.skipped |= more.skipped

    def as_dict(self) -> dict[str, Any]:
        """Plain data, which stays as it is while more is counted."""
        far = {name: {**blocks} for name, blocks in self.far.items()}
        return {**vars(self), "far": far, "skipped": {**self.skipped}}


def as_reported(counters: Mapping[str, Any]) -> dict[str, Any]:
    """Counters, as plain data, that are the same however a scene is split into parts."""
    far = {name: sum(blocks.values()) for name, blocks in sorted(counters.get("far", {}).items())}
    return {"far": far, "skipped": counters.get("skipped", {})}


_NUMBERS: Final = tuple(
    each.name for each in fields(ReadingCounters) if each.type == "int" and each.name != "instances"
)
