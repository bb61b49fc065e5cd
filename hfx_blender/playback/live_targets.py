# SPDX-License-Identifier: GPL-3.0-or-later
"""What a device is connected to, and how strongly it plays: the user's choice as plain data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..errors import DeviceError
from .live_settings import LiveSettings

if TYPE_CHECKING:
    from ..devices.live.haptics import F64
    from ..engine.rendering.device import DeviceConfig


def target_of(device: DeviceConfig, settings: LiveSettings) -> dict[str, Any]:
    """What the output process is to open.

    Raises
    ------
    DeviceError
        Nothing drives this device live, or it is not there.
    """
    from ..devices.live import opening
    from ..devices.live.discovery import port_of, serial_ports

    if settings.kind == "SIMULATOR":
        path = bpy.path.abspath(settings.path)
        return {"kind": "simulator", **({"path": path} if path else {})}
    if settings.kind == "CSV":
        if not settings.path:
            raise DeviceError(f"Device '{device.id}': name the log's file.")
        return {"kind": "csv", "path": str(Path(bpy.path.abspath(settings.path)))}
    if settings.kind == "AUDIO":
        return {"kind": "audio", "interface": settings.port}
    kind = opening.kind_of(device)
    if kind is None:
        raise DeviceError(
            f"Device '{device.id}': its configuration names no output; nothing drives it live."
        )
    if kind == "serial":
        return {"kind": kind, "port": settings.port or port_of(device, serial_ports())}
    target: dict[str, Any] = {"kind": kind}
    if settings.host:
        target["host"] = settings.host
    if settings.port:
        if not settings.port.isdecimal():
            raise DeviceError(f"Device '{device.id}': '{settings.port}' is no network port.")
        target["port"] = int(settings.port)
    return target


def with_gain(values: F64, device: DeviceConfig, gain: float) -> F64:
    """Values (columns,) with every strength's way from silence times ``gain``."""
    if gain == 1.0:
        return values
    values = values.copy()
    first = 0
    for actuator in device.actuators:
        neutral = actuator.type.strength.neutral
        values[first] = neutral + gain * (values[first] - neutral)
        first += len(actuator.type.controls)
    return values


def neutral_of(device: DeviceConfig) -> list[float]:
    return [c.neutral for actuator in device.actuators for c in actuator.type.controls]
