# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF documents and perceptions from places with dense envelopes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ...engine.modality import MODALITIES
from ...engine.rendering.device_config import DeviceConfig
from ...files.strict_json import clean
from ..registry import FORMATS
from ..signals.signals import MAX_HZ, Transient
from .body_parts import place_mask
from .envelopes import Dense, Keyframe, band, curve_effects, keyframes_of, shared_waves, wave_bursts
from .semantics import MAX_CHANNELS

SUFFIX: Final = FORMATS["hjif"].suffix
DATE: Final = "2024-01-01T00:00:00+00:00"  # constant, so equal scenes give equal bytes

TOO_WEAK: Final = "silent, as too weak for the tolerance"
"""Note on the places of :func:`too_weak_places`."""


@dataclass(eq=False)
class Place:
    """Content of a channel: envelope, body part mask, vertices and ticks."""

    title: str
    gain: float
    mask: int
    dense: Dense
    vertices: set[int] = field(default_factory=set)
    direction: dict[str, int] | None = None  # X, Y, Z up to 127; of a wind
    transients: tuple[Transient, ...] = ()  # amplitudes 0..1 of full scale


def document_of(
    description: str,
    perceptions: Sequence[dict[str, Any]],
    timescale: int,
    avatars: Sequence[dict[str, Any]] = (),
    date: str = DATE,
) -> dict[str, Any]:
    """Compose a document at the lowest sufficient level; channels are numbered in place, from 0.
    Channel ids are unique in the whole file, as decoders require."""
    channels = [channel for perception in perceptions for channel in perception["channels"]]
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
        # Required by the reference software, though not by the schema.
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
    """Compose a perception; full scale is the strongest value of its channels, one per place.

    Strengths of ``places`` are in the modality's unit, or, without ``has_units``, shares of an
    unknown full scale, without reference device. Vibrations are waves between silences, other
    modalities curves, within ``tolerance``. ``devices`` give further reference devices.
    """
    # HJIF stores shares of full scale: the strongest value of all channels uses the whole range.
    full = (max(_peak(content) for content in places) or 1.0) if has_units else 1.0
    dense = [
        replace(content.dense, strength=np.clip(content.dense.strength / full, -1.0, 1.0))
        for content in places
    ]
    # Vibration: waves between silences, repeated ones in the library. Otherwise a curve over
    # the whole time.
    library: list[dict[str, Any]] = []
    if modality == "vibration":
        library, waves = shared_waves(
            [wave_bursts(envelope, timescale, tolerance) for envelope in dense]
        )
        bands = [[band("VectorialWave", wave)] for wave in waves]
    else:
        curves = [curve_effects(d, timescale, tolerance) for d in dense]
        bands = [[band("Curve", curve, curve_type="Linear")] for curve in curves]
    for place_bands, content in zip(bands, places, strict=True):
        if content.transients:
            place_bands.append(_transient_band(content.transients, timescale))
    reference: list[dict[str, Any]] = []
    if has_units:
        title = f"full scale: {full:.6g} {MODALITIES[modality].hjif_unit}"
        reference.append({"id": 1, "name": title, "maximum_amplitude": full})
    reference += _devices(devices, modality, len(reference))
    return {
        "id": id,
        # No avatar; the writer of tracks sets the number of the mesh afterwards.
        "avatar_id": 0,
        "description": modality,
        "perception_modality": MODALITIES[modality].hjif,
        "channels": [
            _channel(k, content, place_bands, has_units=has_units)
            for k, (content, place_bands) in enumerate(zip(places, bands, strict=True))
        ],
        "effect_library": library,
        "reference_devices": reference,
        "unit_exponent": -3,
        "perception_unit_exponent": 0,  # players multiply by its power of ten, and cut at 1
    }


def _channel(
    id: int, place: Place, bands: list[dict[str, Any]], *, has_units: bool
) -> dict[str, Any]:
    """Compose a channel; ``has_units`` refers to reference device 1, the full scale."""
    channel: dict[str, Any] = {
        "id": id,
        "description": clean(place.title),
        "gain": place.gain,
        "mixing_coefficient": 1.0,
        "bands": bands,
        "body_part_mask": place.mask,
    }
    if has_units:
        channel["reference_device_id"] = 1
    if place.vertices:
        channel["vertices"] = sorted(place.vertices)
    if place.direction is not None:
        channel["direction"] = place.direction
    return channel


def too_weak_places(perception: dict[str, Any], places: Sequence[Place]) -> list[str]:
    """Titles of places with a strength other than 0, but only zero keyframes in the perception."""
    library = {effect["id"]: effect for effect in perception["effect_library"]}
    titles = []
    for content, channel in zip(places, perception["channels"], strict=True):
        effects = [effect for band in channel["bands"] for effect in band["effects"]]
        effects = [library[e["id"]] if e["effect_type"] == "Reference" else e for e in effects]
        frames = (frame for effect in effects for frame in effect["keyframes"])
        if _peak(content) > 0.0 and not any(frame["amplitude_modulation"] for frame in frames):
            titles.append(content.title)
    return titles


def _transient_band(transients: Sequence[Transient], timescale: int) -> dict[str, Any]:
    """Transient band with an effect of one keyframe per tick in time order; frequencies above 1000
    Hz become 1000."""
    effects = []
    for tick in sorted(transients, key=lambda each: each.time_s):
        frame = Keyframe(0, round(tick.amplitude, 6), round(min(tick.frequency_hz, MAX_HZ)))
        effects.append(
            {
                "effect_type": "Basis",
                "position": round(tick.time_s * timescale),
                "base_signal": "Sine",
                "keyframes": keyframes_of([frame]),
            }
        )
    return band("Transient", effects)


def _peak(place: Place) -> float:
    """Largest absolute strength of a place; 0 without rows."""
    return float(np.abs(place.dense.strength).max(initial=0.0))


def _devices(
    devices: Sequence[DeviceConfig], modality: str, first: int
) -> Iterator[dict[str, Any]]:
    """Yield a reference device for each actuator type of a modality; ids from ``first`` + 1."""
    number = first
    for device in devices:
        for kind in device.actuator_types.values():
            actuators = [actuator for actuator in device.actuators if actuator.type == kind]
            if kind.modality != modality or not actuators:
                continue
            number += 1
            # A reference device covers the body parts of all its actuators of this type.
            mask = 0
            for actuator in actuators:
                mask |= place_mask(actuator.place, is_mirrored=device.is_mirrored)
            pitch = next(
                (control for control in kind.controls if control.name == "frequency_hz"), None
            )
            yield {
                "id": number,
                "name": clean(f"{device.name}: {kind.name}"),
                "body_part_mask": mask,
                **({"maximum_frequency": pitch.highest} if pitch else {}),
                **({"minimum_frequency": pitch.lowest} if pitch else {}),
                "maximum_amplitude": max(kind.strength.highest, 0.0),
                "type": "Unknown",
            }
