# SPDX-License-Identifier: GPL-3.0-or-later
"""Counters of work by the engine and the reader, for tests and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Final

from .modality import MODALITIES, neutral_temperature_c


@dataclass
class Counters:
    """Work of an engine since its creation."""

    models_loaded: list[str] = field(default_factory=list)
    bodies_reached: list[str] = field(default_factory=list)  # ids of bodies with a narrow phase
    meshes_searched: int = 0  # (mesh volume, body, time) in blocks with a narrow phase
    times_evaluated: int = 0  # rows with an active effect
    times_skipped: int = 0  # rows without
    volume_tests: int = 0  # (volume, body, time) box comparisons
    clusters_tested: int = 0  # (cluster, volume, time) bounds comparisons
    vertices_posed: int = 0  # computed positions
    contacts: int = 0  # (vertex, effect, time) with a sample
    warnings: dict[str, int] = field(default_factory=dict)  # message -> number
    # Effect name -> number of samples at which its volume is flattened, infinite or not a number.
    flattened: dict[str, int] = field(default_factory=dict)

    def warn(self, message: str, count: int = 1) -> None:
        """Add ``count`` occurrences of a warning."""
        self.warnings[message] = self.warnings.get(message, 0) + count

    def clear(self) -> None:
        """Reset all counts except loaded models and reached bodies."""
        # The same object is emptied, as many parts of the engine hold a reference.
        models, bodies = self.models_loaded, self.bodies_reached
        self.__dict__.update(vars(Counters(models_loaded=models, bodies_reached=bodies)))

    def copy(self) -> Counters:
        """Snapshot for :meth:`since` and :meth:`go_back`; lists and warnings are copied, so later
        changes leave the snapshot as it is."""
        return Counters(**self.as_dict())

    def since(self, before: Counters) -> Counters:
        """Counters of the time since an earlier copy: differences of numbers, new list entries,
        changed warnings."""
        changes: dict[str, Any] = {
            name: getattr(self, name) - getattr(before, name) for name in _NUMBERS
        }
        # Lists and warnings only grow, so their new part is at the end, or a higher count.
        for name in ("models_loaded", "bodies_reached"):
            changes[name] = getattr(self, name)[len(getattr(before, name)) :]
        for name in ("warnings", "flattened"):
            earlier = getattr(before, name)
            counts = {key: n - earlier.get(key, 0) for key, n in getattr(self, name).items()}
            changes[name] = {key: n for key, n in counts.items() if n}
        return Counters(**changes)

    def reach(self, body_id: str) -> None:
        """Record that a body had a narrow phase, each id once."""
        if body_id not in self.bodies_reached:
            self.bodies_reached.append(body_id)

    def add(self, more: Counters) -> None:
        """Add the counts of other counters, in place; loaded models and reached bodies once."""
        for name in _NUMBERS:
            setattr(self, name, getattr(self, name) + getattr(more, name))
        models = {*self.models_loaded}
        self.models_loaded += [model for model in more.models_loaded if model not in models]
        for body_id in more.bodies_reached:
            self.reach(body_id)
        for text, count in more.warnings.items():
            self.warn(text, count)
        for name, count in more.flattened.items():
            self.flattened[name] = self.flattened.get(name, 0) + count

    def go_back(self, before: Counters) -> None:
        """Restore all counts from a snapshot of :meth:`copy`."""
        self.__dict__.update(vars(before.copy()))

    def as_dict(self) -> dict[str, Any]:
        """All counts by name as plain data, copied."""
        return asdict(self)


OF_HISTORY: Final = frozenset({"bodies_reached", "meshes_searched", "vertices_posed"})
"""Counters that depend on skin cached by earlier blocks, so on the division of a scene into parts:
bounds of a cluster are narrower once its neighbours are known, and fewer positions are needed."""

_NUMBERS: Final = tuple(column.name for column in fields(Counters) if column.type == "int")


@dataclass(frozen=True)
class Unfelt:
    """Reason for an effect without samples, as text after the name of the effect."""

    reason: str
    is_expected: bool = False  # requested by the user, so no warning
    is_warned: bool = False  # named by another warning, so no second one


def powerless_reason(modality: str, is_contact: bool) -> str:
    """Reason for an effect of strength 0 or neutral temperature, as a predicate ("has amplitude
    0")."""
    if modality == "temperature":
        return f"has the neutral temperature, {neutral_temperature_c(is_contact):g} °C"
    strength = MODALITIES[modality].strength_parameter
    return f"has {strength.prop.replace('_', ' ')} 0"


@dataclass
class ReadingCounters:
    """Work of a scene reader since its creation."""

    times_stepped: int = 0  # times evaluated by Blender
    frames_played: int = 0  # frames of simulations before the range
    effects_read: int = 0  # (effect, time) read in full
    places_read: int = 0  # (volume, time) read as placement and box only
    poses_read: int = 0  # (body, time)
    meshes_read: int = 0  # (mesh, time) with vertices read
    meshes_made: int = 0  # closed surfaces made of meshes
    instances: int = 0  # volumes shown as instances
    # Volume name to number of samples in blocks far from all bodies, by first sample.
    far: dict[str, dict[str, int]] = field(default_factory=dict)
    on: dict[str, bool] = field(default_factory=dict)  # ids of far volumes on at any sample
    skipped: dict[str, str] = field(default_factory=dict)  # effect -> reason for not reading
    # (volume, time) left unread, as no skin meets a box known before, by first sample of the block.
    out_of_reach: dict[str, int] = field(default_factory=dict)

    def add(self, more: ReadingCounters) -> None:
        """Add the counts of another part of the scene, in place; ``instances`` is the larger of
        both."""
        for name in _READING_NUMBERS:
            setattr(self, name, getattr(self, name) + getattr(more, name))
        # Each part of a scene sees all instances, so their numbers do not add.
        self.instances = max(self.instances, more.instances)
        for name, blocks in more.far.items():
            self.far.setdefault(name, {}).update(blocks)
        self.on |= more.on
        self.skipped |= more.skipped
        self.out_of_reach |= more.out_of_reach

    def as_dict(self) -> dict[str, Any]:
        """Plain data, independent of later counts."""
        far = {name: {**blocks} for name, blocks in self.far.items()}
        copies = {name: {**getattr(self, name)} for name in ("on", "skipped", "out_of_reach")}
        return {**vars(self), "far": far, **copies}


def as_reported(counters: Mapping[str, Any]) -> dict[str, Any]:
    """Counters independent of the division of a scene into parts: "far", with total samples by
    volume name, sorted, "skipped", and the total "out_of_reach". ``counters`` are plain data."""
    far = {name: sum(blocks.values()) for name, blocks in sorted(counters.get("far", {}).items())}
    unread = sum(counters.get("out_of_reach", {}).values())
    return {"far": far, "skipped": counters.get("skipped", {}), "out_of_reach": unread}


_READING_NUMBERS: Final = tuple(
    column.name
    for column in fields(ReadingCounters)
    if column.type == "int" and column.name != "instances"
)
