# SPDX-License-Identifier: GPL-3.0-or-later
"""What a device is connected to: the user's choice as plain data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..errors import DeviceError
from .live_settings import LiveSettings

if TYPE_CHECKING:
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


def neutral_of(device: DeviceConfig) -> list[float]:
    return [c.neutral for actuator in device.actuators for c in actuator.type.controls]
