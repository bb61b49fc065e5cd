# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptions of HJIF from places and their envelopes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ...engine.modality import MODALITIES
from ...engine.rendering.device import DeviceConfig
from ...files.strict_json import clean
from ..registry import FORMATS
from ..signals.signals import MAX_HZ, Transient
from .body_parts import place_mask
from .document import (
    Avatar,
    Band,
    Channel,
    Effect,
    Hjif,
    Keyframe,
    Perception,
    ReferenceDevice,
    Vector,
)
from .envelopes import Dense, Library, curve_band, curve_effects, wave_band, wave_bursts
from .semantics import MAX_CHANNELS

SUFFIX: Final = FORMATS["hjif"].suffix
DATE: Final = "2024-01-01T00:00:00+00:00"  # the same scene gives the same bytes

PITCH_HZ: Final = 1.0

TOO_WEAK: Final = "too weak beside the strongest of its kind for the tolerance: silent"
"""Remark on :func:`too_weak_places` places."""


@dataclass(eq=False)
class Place:
    """Channel in the making."""

    title: str
    gain: float
    mask: int
    vertices: set[int] = field(default_factory=set)
    dense: Dense | None = None
    direction: Vector | None = None
    transients: tuple[Transient, ...] = ()  # amplitudes are shares of full scale


def document_of(
    description: str,
    perceptions: Sequence[Perception],
    timescale: int,
    avatars: tuple[Avatar, ...] = (),
) -> Hjif:
    """A whole document, of the lowest level that allows so many channels.

    Channels are numbered over the whole file: decoders look them up so.
    """
    numbers = itertools.count()
    perceptions = [
        replace(
            each, channels=tuple(replace(channel, id=next(numbers)) for channel in each.channels)
        )
        for each in perceptions
    ]
    count = sum(len(each.channels) for each in perceptions)
    return Hjif(
        date=DATE,
        description=description,
        level=1 if count <= MAX_CHANNELS[1] else 2,
        timescale=timescale,
        avatars=avatars,
        perceptions=tuple(perceptions),
    )


def perception_of(
    id: int,
    modality: str,
    places: Sequence[Place],
    devices: Sequence[DeviceConfig],
    timescale: int,
    tolerance: float,
    *,
    has_units: bool = True,
) -> Perception:
    """A perception whose full scale is the strongest of its channels.

    Without units the strengths are shares of a full scale that nobody knows.
    """
    full = (max(_peak(place) for place in places) or 1.0) if has_units else 1.0
    library = Library()
    bands: list[list[Band]] = []
    waves = []
    for place in places:
        assert place.dense is not None
        dense = replace(place.dense, strength=np.clip(place.dense.strength / full, -1.0, 1.0))
        if modality == "vibration":
            waves.append(library.band(wave_bursts(dense, timescale, tolerance, PITCH_HZ)))
            bands.append([])
        else:
            bands.append([curve_band(curve_effects(dense, timescale, tolerance))])
    effects = library.settle()
    for band, wave in zip(bands, waves, strict=False):  # curves have no waves
        band.append(wave_band(wave))
    for band, place in zip(bands, places, strict=True):
        if place.transients:
            band.append(_transient_band(place.transients, timescale))
    reference = []
    if has_units:
        title = f"full scale: {full:.6g} {MODALITIES[modality].hjif_unit}"
        reference.append(ReferenceDevice(1, title, maximum_amplitude=full))
    reference += _devices(devices, modality, len(reference))
    return Perception(
        id=id,
        avatar_id=0,
        description=modality,
        perception_modality=MODALITIES[modality].hjif,
        effect_library=effects,
        reference_devices=tuple(reference),
        unit_exponent=-3,
        perception_unit_exponent=0,  # players multiply by its power of ten, and cut at 1
        channels=tuple(
            Channel(
                id=k,
                description=clean(place.title),
                gain=place.gain,
                mixing_coefficient=1.0,
                body_part_mask=place.mask,
                reference_device_id=1 if has_units else None,
                vertices=tuple(sorted(place.vertices)) or None,
                direction=place.direction,
                bands=tuple(bands[k]),
            )
            for k, place in enumerate(places)
        ),
    )


def too_weak_places(perception: Perception, places: Sequence[Place]) -> list[str]:
    """Places of a perception so weak beside the strongest that nothing is left of them."""
    library = {each.id: each for each in perception.effect_library}

    def sounds(effect: Effect) -> bool:
        effect = library[effect.id] if effect.effect_type == "Reference" else effect
        return any(each.amplitude_modulation for each in effect.keyframes or ())

    return [
        place.title
        for place, channel in zip(places, perception.channels, strict=True)
        if _peak(place) > 0.0
        and not any(sounds(effect) for band in channel.bands for effect in band.effects)
    ]


def _transient_band(transients: Sequence[Transient], timescale: int) -> Band:
    effects = tuple(
        Effect(
            "Basis",
            position=round(each.time_s * timescale),
            base_signal="Sine",
            keyframes=(
                Keyframe(0, round(each.amplitude, 6), round(min(each.frequency_hz, MAX_HZ))),
            ),
        )
        for each in sorted(transients, key=lambda each: each.time_s)
    )
    return Band("Transient", 0, int(MAX_HZ), effects)


def _peak(place: Place) -> float:
    assert place.dense is not None
    return float(np.abs(place.dense.strength).max(initial=0.0))


def _devices(
    devices: Sequence[DeviceConfig], modality: str, first: int
) -> Iterator[ReferenceDevice]:
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
            yield ReferenceDevice(
                number,
                clean(f"{device.name}: {kind.name}"),
                body_part_mask=mask,
                minimum_frequency=pitch.lowest if pitch else None,
                maximum_frequency=pitch.highest if pitch else None,
                maximum_amplitude=max(kind.strength.highest, 0.0),
                type="Unknown",
            )
