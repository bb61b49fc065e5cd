# SPDX-License-Identifier: GPL-3.0-or-later
"""The devices of an export: those that a scene names, and what is left where some play nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from .devices.configuration import load_device, refuse_file
from .engine.rendering.device import DeviceConfig
from .errors import InputError
from .formats import registry

if TYPE_CHECKING:
    import bpy


def scene_devices(scene: bpy.types.Scene) -> tuple[tuple[DeviceConfig, ...], dict[str, str]]:
    """Load the devices that a scene names; returns them, and a sentence for each that is unusable.

    Raises
    ------
    InputError
        It names a file.
    """
    found: list[DeviceConfig] = []
    missing: dict[str, str] = {}
    for name in dict.fromkeys(device.name for device in scene.hfx.devices):
        refuse_file(name)
        try:
            found.append(load_device(name))
        except InputError as error:
            missing[name] = f"device '{name}' plays nothing: {error}".removesuffix(".")
    return tuple(found), missing


def formats_without(
    missing: Mapping[str, str], formats: Sequence[str], devices: Sequence[DeviceConfig]
) -> tuple[str, ...]:
    """The formats that there is something for, though some devices are missing.

    Raises
    ------
    InputError
        There is nothing for any.
    """
    kept = registry.usable(formats, devices) if missing else tuple(formats)
    if formats and not kept:
        raise InputError("; ".join(missing.values()) + ".")
    return kept
