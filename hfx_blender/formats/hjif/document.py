# SPDX-License-Identifier: GPL-3.0-or-later
"""Content of an HJIF file, as plain data; names are those of the standard.

Times are ticks, ``timescale`` of them a second. A member that is None is not in the file.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Final


@dataclass(frozen=True)
class Vector:
    """Three whole numbers: right, up and forward."""

    X: int
    Y: int
    Z: int


@dataclass(frozen=True, slots=True)
class Keyframe:
    """Point of an envelope."""

    relative_position: int | None = None  # ticks since the effect's position
    amplitude_modulation: float | None = None  # -1..1
    frequency_modulation: float | None = None  # Hz


@dataclass(frozen=True)
class Effect:
    """An envelope, a reference to one of the library, or several together."""

    effect_type: str
    id: int | None = None
    position: int | None = None
    phase: float | None = None
    base_signal: str | None = None
    semantic_keywords: str | None = None
    composition: tuple[Effect, ...] | None = None
    keyframes: tuple[Keyframe, ...] | None = None
    wavelet_stream: str | None = None


@dataclass(frozen=True)
class Band:
    """Effects of one kind within limits of frequency."""

    band_type: str
    lower_frequency_limit: float
    upper_frequency_limit: float
    effects: tuple[Effect, ...] = ()
    curve_type: str | None = None
    block_length: int | None = None
    priority: int | None = None


@dataclass(frozen=True)
class Channel:
    """Channel: the effects at one place."""

    id: int
    description: str
    gain: float
    mixing_coefficient: float
    bands: tuple[Band, ...] = ()
    body_part_mask: int | None = None
    priority: int | None = None
    reference_device_id: int | None = None
    actuator_resolution: Vector | None = None
    body_part_target: tuple[str, ...] | None = None
    actuator_target: tuple[Vector, ...] | None = None
    frequency_sampling: int | None = None
    sample_count: int | None = None
    vertices: tuple[int, ...] | None = None
    direction: Vector | None = None


@dataclass(frozen=True)
class ReferenceDevice:
    """An actuator that the author had in mind."""

    id: int
    name: str
    body_part_mask: int | None = None
    maximum_frequency: float | None = None
    minimum_frequency: float | None = None
    resonance_frequency: float | None = None
    maximum_amplitude: float | None = None
    impedance: float | None = None
    maximum_voltage: float | None = None
    maximum_current: float | None = None
    maximum_displacement: float | None = None
    weight: float | None = None
    size: float | None = None
    custom: float | None = None
    type: str | None = None


@dataclass(frozen=True)
class Perception:
    """All channels of one kind of touch."""

    id: int
    avatar_id: int
    description: str
    perception_modality: str
    channels: tuple[Channel, ...]
    effect_library: tuple[Effect, ...] = ()
    reference_devices: tuple[ReferenceDevice, ...] | None = None
    priority: int | None = None
    unit_exponent: int | None = None
    perception_unit_exponent: int | None = None
    semantic_scheme: str | None = None


@dataclass(frozen=True)
class Avatar:
    """Avatar that vertices refer to."""

    id: int
    lod: int
    type: str
    mesh: str | None = None


@dataclass(frozen=True)
class Sync:
    """Time that playing may be aligned with."""

    timestamp: int
    timescale: int | None = None


@dataclass(frozen=True)
class Hjif:
    """A whole file."""

    date: str
    description: str
    perceptions: tuple[Perception, ...]
    avatars: tuple[Avatar, ...] = ()
    version: str = "2023"
    profile: str = "Main"
    level: int = 1
    timescale: int | None = 1000
    syncs: tuple[Sync, ...] | None = field(default=(Sync(0, 1000),))


_PARTS: Final[dict[tuple[type, str], Any]] = {
    (Hjif, "perceptions"): Perception,
    (Hjif, "avatars"): Avatar,
    (Hjif, "syncs"): Sync,
    (Perception, "channels"): Channel,
    (Perception, "effect_library"): Effect,
    (Perception, "reference_devices"): ReferenceDevice,
    (Channel, "bands"): Band,
    (Channel, "actuator_resolution"): Vector,
    (Channel, "actuator_target"): Vector,
    (Channel, "direction"): Vector,
    (Band, "effects"): Effect,
    (Effect, "composition"): Effect,
    (Effect, "keyframes"): Keyframe,
}
MEMBERS: Final[dict[type, tuple[str, ...]]] = {
    kind: tuple(each.name for each in fields(kind))
    for kind in (
        Vector,
        Keyframe,
        Effect,
        Band,
        Channel,
        ReferenceDevice,
        Perception,
        Avatar,
        Sync,
        Hjif,
    )
}
"""Names of a part's members, in the order of a file."""


def from_json(value: Any, kind: type = Hjif) -> Any:
    """Convert a checked JSON value to a dataclass; unknown members are left out."""
    if kind is Keyframe:  # most of a file
        return Keyframe(*map(value.get, MEMBERS[Keyframe]))
    members: dict[str, Any] = {}
    for name in MEMBERS[kind]:
        if name not in value:
            if name in ("timescale", "syncs"):
                members[name] = None
            continue
        found = value[name]
        part = _PARTS.get((kind, name))
        if part is not None:
            is_list = isinstance(found, list)
            found = (
                tuple(from_json(each, part) for each in found)
                if is_list
                else from_json(found, part)
            )
        elif isinstance(found, list):
            found = tuple(found)
        members[name] = found
    return kind(**members)
