# SPDX-License-Identifier: GPL-3.0-or-later
"""The devices of an export: those that a scene names, and what is left where some play nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...devices.configuration import load_device, named_in_blend
from ...engine.rendering.device_config import DeviceConfig
from ...errors import InputError
from ...formats.writing import usable

if TYPE_CHECKING:
    import bpy


def scene_devices(scene: bpy.types.Scene) -> tuple[tuple[DeviceConfig, ...], dict[str, str]]:
    """Load the devices that a scene is exported for; returns them, and why others are unusable.

    Raises
    ------
    InputError
        It names a file.
    """
    chosen = {item.name: item for item in scene.hfx.devices if item.is_exported}
    found: list[DeviceConfig] = []
    missing: dict[str, str] = {}
    for name, item in chosen.items():
        named_in_blend(name)
        try:
            found.append(load_scene_device(item))
        except InputError as error:
            missing[name] = f"device '{name}' plays nothing: {error}".removesuffix(".")
    return tuple(found), missing


def load_scene_device(item: bpy.types.PropertyGroup) -> DeviceConfig:
    """Load a device that a scene names, with the rendering scheme that the scene chooses.

    Raises
    ------
    InputError
        It names a file, or the device cannot be read.
    """
    return load_device(named_in_blend(item.name)).rendered_by(scheme_of(item))


def scheme_of(item: bpy.types.PropertyGroup) -> str:
    """Rendering scheme that a scene chooses for a device; empty: the device's own."""
    return "" if item.scheme == "CONFIGURED" else str(item.scheme)


def formats_without(
    missing: Mapping[str, str], formats: Sequence[str], devices: Sequence[DeviceConfig]
) -> tuple[str, ...]:
    """The formats that there is something for, though some devices are missing.

    Raises
    ------
    InputError
        There is nothing for any.
    """
    kept = usable(formats, devices) if missing else tuple(formats)
    if formats and not kept:
        raise InputError("; ".join(missing.values()) + ".")
    return kept
