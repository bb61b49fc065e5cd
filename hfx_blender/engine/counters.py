# SPDX-License-Identifier: GPL-3.0-or-later
"""Counters of the engine's work, so that "only what a scene requires" can be tested and
reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Final

from .modality import MODALITIES, neutral_temperature_c


@dataclass
class Counters:
    """Work done since the engine was made."""

    models_loaded: list[str] = field(default_factory=list)
    bodies_reached: list[str] = field(
        default_factory=list
    )  # ids; a volume came near, skin was looked at
    meshes_searched: int = 0  # (mesh volume, body, time) in blocks where skin was looked at
    times_evaluated: int = 0  # rows of blocks that held an active effect
    times_skipped: int = 0  # rows in which nothing was active
    volume_tests: int = 0  # (volume, body, time) whose boxes were compared
    clusters_tested: int = 0  # (cluster, volume, time) whose bounds were compared
    vertices_posed: int = 0  # positions computed
    contacts: int = 0  # (vertex, effect, time) felt
    warnings: dict[str, int] = field(default_factory=dict)  # message -> how often

    def warn(self, message: str, count: int = 1) -> None:
        """Count a warning; each message is reported once, with how often it occurred."""
        self.warnings[message] = self.warnings.get(message, 0) + count

    def clear(self) -> None:
        """Forget what was counted; which models were loaded, and bodies reached, stays."""
        models, bodies = self.models_loaded, self.bodies_reached
        self.__dict__.update(vars(Counters(models_loaded=models, bodies_reached=bodies)))

    def copy(self) -> Counters:
        """The same, now."""
        return replace(
            self,
            models_loaded=[*self.models_loaded],
            bodies_reached=[*self.bodies_reached],
            warnings={**self.warnings},
        )

    def since(self, before: Counters) -> Counters:
        """Work counted since the snapshot ``before``."""
        changes: dict[str, int] = {
            name: getattr(self, name) - getattr(before, name) for name in _NUMBERS
        }
        new = self.models_loaded[len(before.models_loaded) :]
        reached = self.bodies_reached[len(before.bodies_reached) :]
        warnings = {
            text: count - before.warnings.get(text, 0)
            for text, count in self.warnings.items()
            if count != before.warnings.get(text, 0)
        }
        return Counters(models_loaded=new, bodies_reached=reached, warnings=warnings, **changes)

    def reach(self, body_id: str) -> None:
        """Count a body whose skin was looked at."""
        if body_id not in self.bodies_reached:
            self.bodies_reached.append(body_id)

    def add(self, more: Counters) -> None:
        """Add the counts of other counters."""
        for name in _NUMBERS:
            setattr(self, name, getattr(self, name) + getattr(more, name))
        known = {*self.models_loaded}
        self.models_loaded += [model for model in more.models_loaded if model not in known]
        for body_id in more.bodies_reached:
            self.reach(body_id)
        for text, count in more.warnings.items():
            self.warn(text, count)

    def go_back(self, before: Counters) -> None:
        """Restore the snapshot ``before``."""
        self.__dict__.update(vars(before.copy()))

    def as_dict(self) -> dict[str, object]:
        """Plain data for a report."""
        return asdict(self)


_NUMBERS: Final = tuple(each.name for each in fields(Counters) if each.type == "int")


@dataclass(frozen=True)
class Unfelt:
    """Reason why nothing is felt of an effect; it goes on after the effect's name."""

    reason: str
    is_expected: bool = False  # the user asked for it: no warning


def powerless_reason(modality: str, is_contact: bool) -> str:
    """Reason why an effect without strength is not felt; it goes on after the effect's name."""
    if modality == "temperature":
        return f"has the neutral temperature, {neutral_temperature_c(is_contact):g} °C"
    strength = MODALITIES[modality].strength_parameter
    return f"has {strength.prop.replace('_', ' ')} 0"


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
    on: dict[str, bool] = field(default_factory=dict)  # ids of those that were on there, once
    skipped: dict[str, str] = field(default_factory=dict)  # effect: why nothing of it was read

    def add(self, more: ReadingCounters) -> None:
        """Count what was counted where another part of the scene was read."""
        for name in _READING_NUMBERS:
            setattr(self, name, getattr(self, name) + getattr(more, name))
        self.instances = max(self.instances, more.instances)
        for name, blocks in more.far.items():
            self.far.setdefault(name, {}).update(blocks)
        self.on |= more.on
        self.skipped |= more.skipped

    def as_dict(self) -> dict[str, Any]:
        """Plain data, which stays as it is while more is counted."""
        far = {name: {**blocks} for name, blocks in self.far.items()}
        return {**vars(self), "far": far, "on": {**self.on}, "skipped": {**self.skipped}}


def as_reported(counters: Mapping[str, Any]) -> dict[str, Any]:
    """Counters, as plain data, that are the same however a scene is split into parts."""
    far = {name: sum(blocks.values()) for name, blocks in sorted(counters.get("far", {}).items())}
    return {"far": far, "skipped": counters.get("skipped", {})}


_READING_NUMBERS: Final = tuple(
    each.name for each in fields(ReadingCounters) if each.type == "int" and each.name != "instances"
)
