# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptions of HJIF from places and their envelopes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ...engine.modality import MODALITIES
from ...engine.rendering.device import DeviceConfig
from ...files.strict_json import clean
from ..registry import FORMATS
from ..signals.signals import MAX_HZ, Transient
from .body_parts import place_mask
from .envelopes import (
    Dense,
    Keyframe,
    band,
    curve_effects,
    keyframes_of,
    shared_waves,
    wave_bursts,
)
from .semantics import MAX_CHANNELS

SUFFIX: Final = FORMATS["hjif"].suffix
DATE: Final = "2024-01-01T00:00:00+00:00"  # the same scene gives the same bytes

TOO_WEAK: Final = "too weak beside the strongest of its kind for the tolerance: silent"
"""Remark on :func:`too_weak_places` places."""


@dataclass(eq=False)
class Place:
    """Channel in the making."""

    title: str
    gain: float
    mask: int
    dense: Dense
    vertices: set[int] = field(default_factory=set)
    direction: dict[str, int] | None = None
    transients: tuple[Transient, ...] = ()  # amplitudes are shares of full scale


def document_of(
    description: str,
    perceptions: Sequence[dict[str, Any]],
    timescale: int,
    avatars: Sequence[dict[str, Any]] = (),
    date: str = DATE,
) -> dict[str, Any]:
    """A whole document, of the lowest level that allows so many channels.

    Channels are numbered over the whole file: decoders look them up so.
    """
    channels = [channel for each in perceptions for channel in each["channels"]]
    for number, channel in enumerate(channels):
        channel["id"] = number
    return {
        "date": date,
        "description": description,
        "perceptions": perceptions,
        "avatars": avatars,
        "version": "2023",
        "profile": "Main",
        "level": 1 if len(channels) <= MAX_CHANNELS[1] else 2,
        "timescale": timescale,
        "syncs": [{"timestamp": 0, "timescale": 1000}],
    }


def perception_of(
    id: int,
    modality: str,
    places: Sequence[Place],
    devices: Sequence[DeviceConfig],
    timescale: int,
    tolerance: float,
    *,
    has_units: bool = True,
) -> dict[str, Any]:
    """A perception whose full scale is the strongest of its channels.

    Without units the strengths are shares of a full scale that nobody knows.
    """
    full = (max(_peak(place) for place in places) or 1.0) if has_units else 1.0
    dense = [
        replace(each.dense, strength=np.clip(each.dense.strength / full, -1.0, 1.0))
        for each in places
    ]
    library: list[dict[str, Any]] = []
    if modality == "vibration":
        library, waves = shared_waves([wave_bursts(each, timescale, tolerance) for each in dense])
        bands = [[band("VectorialWave", each)] for each in waves]
    else:
        curves = [curve_effects(each, timescale, tolerance) for each in dense]
        bands = [[band("Curve", each, curve_type="Linear")] for each in curves]
    for of_place, place in zip(bands, places, strict=True):
        if place.transients:
            of_place.append(_transient_band(place.transients, timescale))
    reference: list[dict[str, Any]] = []
    if has_units:
        title = f"full scale: {full:.6g} {MODALITIES[modality].hjif_unit}"
        reference.append({"id": 1, "name": title, "maximum_amplitude": full})
    reference += _devices(devices, modality, len(reference))
    return {
        "id": id,
        "avatar_id": 0,
        "description": modality,
        "perception_modality": MODALITIES[modality].hjif,
        "channels": [
            _channel(k, place, of_place, has_units=has_units)
            for k, (place, of_place) in enumerate(zip(places, bands, strict=True))
        ],
        "effect_library": library,
        "reference_devices": reference,
        "unit_exponent": -3,
        "perception_unit_exponent": 0,  # players multiply by its power of ten, and cut at 1
    }


def _channel(
    id: int, place: Place, bands: list[dict[str, Any]], *, has_units: bool
) -> dict[str, Any]:
    found: dict[str, Any] = {
        "id": id,
        "description": clean(place.title),
        "gain": place.gain,
        "mixing_coefficient": 1.0,
        "bands": bands,
        "body_part_mask": place.mask,
    }
    if has_units:
        found["reference_device_id"] = 1
    if place.vertices:
        found["vertices"] = sorted(place.vertices)
    if place.direction is not None:
        found["direction"] = place.direction
    return found


def too_weak_places(perception: dict[str, Any], places: Sequence[Place]) -> list[str]:
    """Places of a perception so weak beside the strongest that nothing is left of them."""
    library = {each["id"]: each for each in perception["effect_library"]}

    def sounds(effect: dict[str, Any]) -> bool:
        effect = library[effect["id"]] if effect["effect_type"] == "Reference" else effect
        return any(each["amplitude_modulation"] for each in effect["keyframes"])

    return [
        place.title
        for place, channel in zip(places, perception["channels"], strict=True)
        if _peak(place) > 0.0
        and not any(sounds(effect) for each in channel["bands"] for effect in each["effects"])
    ]


def _transient_band(transients: Sequence[Transient], timescale: int) -> dict[str, Any]:
    effects = []
    for each in sorted(transients, key=lambda each: each.time_s):
        frame = Keyframe(0, round(each.amplitude, 6), round(min(each.frequency_hz, MAX_HZ)))
        effects.append(
            {
                "effect_type": "Basis",
                "position": round(each.time_s * timescale),
                "base_signal": "Sine",
                "keyframes": keyframes_of([frame]),
            }
        )
    return band("Transient", effects)


def _peak(place: Place) -> float:
    return float(np.abs(place.dense.strength).max(initial=0.0))


def _devices(
    devices: Sequence[DeviceConfig], modality: str, first: int
) -> Iterator[dict[str, Any]]:
    """Reference devices: one for each type of actuator of this modality."""
    number = first
    for device in devices:
        for kind in device.actuator_types.values():
            here = [each for each in device.actuators if each.type == kind]
            if kind.modality != modality or not here:
                continue
            number += 1
            mask = 0
            for actuator in here:
                mask |= place_mask(actuator.place, is_mirrored=device.is_mirrored)
            pitch = next((each for each in kind.controls if each.name == "frequency_hz"), None)
            limits = (
                {"maximum_frequency": pitch.highest, "minimum_frequency": pitch.lowest}
                if pitch
                else {}
            )
            yield {
                "id": number,
                "name": clean(f"{device.name}: {kind.name}"),
                "body_part_mask": mask,
                **limits,
                "maximum_amplitude": max(kind.strength.highest, 0.0),
                "type": "Unknown",
            }
