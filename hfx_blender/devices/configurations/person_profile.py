# SPDX-License-Identifier: GPL-3.0-or-later
"""Profiles of persons: strengths that a person felt on a device, stored in the user's data folder.

*Set Up Person* and ``hfx profile make`` write one. A profile narrows limits, never widens one.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from ...engine.rendering.device_config import DeviceConfig
from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json
from ...files.json_shapes import Number, Table, Text, read, strict
from .device_shape import ID

SCHEMA: Final = "hfx-profile/1"
_STRENGTH: Final = Number(0.0, 1000.0)
_MARKS: Final = strict(dict.fromkeys(("first_felt", "strong_enough", "too_strong"), _STRENGTH))
PROFILE: Final = strict(
    {"schema": Text((SCHEMA,)), "devices": Table(Table(_MARKS, key=ID), key=ID)}
)
"""Strengths in the unit of each actuator's modality, by device and actuator."""


def names() -> list[str]:
    """Names of the user's profiles, sorted."""
    folder = resources.profiles()
    return sorted(path.stem for path in folder.glob("*.json")) if folder.is_dir() else []


def load(name: str) -> dict[str, Any]:
    """Marks of a profile by device and actuator. InputError for an unknown or invalid profile."""
    if name not in names():
        known = ", ".join(names()) or "none"
        raise InputError(f"Profile '{name[:100]}' is unknown; there are: {known}.")
    document = read(resources.profiles() / f"{name}.json").hold(PROFILE)
    for device, actuators in document.value["devices"].items():
        for actuator, marks in actuators.items():
            if not marks["first_felt"] <= marks["strong_enough"] <= marks["too_strong"]:
                node = document["devices"][device][actuator]
                node.fail("first_felt up to strong_enough up to too_strong")
    return dict(document.value["devices"])


def store(name: str, device_id: str, marks: Mapping[str, Mapping[str, float]]) -> Path:
    """Write the marks of a device's actuators to a profile, whose other devices stay; returns the
    file. InputError for an invalid name or file, OutputError for an unwritable file."""
    if not re.fullmatch(ID.pattern, name):
        raise InputError(f"Profile '{name[:100]}': expected {ID.note}.")
    path = resources.profiles() / f"{name}.json"

    def document() -> dict[str, Any]:
        known = load(name) if path.exists() else {}
        return {"schema": SCHEMA, "devices": {**known, device_id: marks}}

    path.parent.mkdir(parents=True, exist_ok=True)
    amend_json(path, document)
    return path


def personal(device: DeviceConfig, name: str) -> DeviceConfig:
    """Device with the marks of a profile; unchanged for "". Strengths above 0 are rendered from
    "first felt" to "strong enough", and "too strong" is a limit of each actuator. An actuator
    without marks has those of the nearest in the device's order, of its modality, in proportion to
    the limits of both. InputError for a profile without this device."""
    if not name:
        return device
    marks = load(name).get(device.id)
    if marks is None:
        raise InputError(
            f"Profile '{name}' has no device '{device.id}'; add the device with 'hfx profile make "
            f"{name} --device {device.id}'."
        )
    actuators = []
    measured = [(k, x) for k, x in enumerate(device.actuators) if x.id in marks]
    for k, actuator in enumerate(device.actuators):
        kind, strength = actuator.type, actuator.type.strength
        alike = [pair for pair in measured if pair[1].type.modality == kind.modality]
        if alike:
            _, nearest = min(alike, key=lambda pair: abs(pair[0] - k))
            highest = nearest.type.strength.highest
            scale = 1.0 if nearest is actuator or not highest else strength.highest / highest
            own = {mark: scale * value for mark, value in marks[nearest.id].items()}
            top = min(max(own["too_strong"], strength.lowest), strength.highest)
            controls = (replace(strength, highest=top), *kind.controls[1:])
            marked = own["first_felt"], own["strong_enough"], strength.highest
            actuator = replace(actuator, type=replace(kind, controls=controls, marks=marked))
        actuators.append(actuator)
    return replace(device, actuators=tuple(actuators))
