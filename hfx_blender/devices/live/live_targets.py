# SPDX-License-Identifier: GPL-3.0-or-later
"""Connection targets and output limits of devices: the user's choice as plain data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ...errors import DeviceError, InputError
from ...files import resources
from .live_settings import LiveSettings

if TYPE_CHECKING:
    from ...engine.rendering.device_config import DeviceConfig
    from .approval import DeviceScript


LEAST_LATENCY_MS: Final = 5.0
"""Shortest latency that is compensated, ms: a picture itself is shown later than that."""


class UnapprovedScriptError(InputError):
    """Raised for a device's script that the user has not approved in its present state."""


def named(name: str) -> tuple[DeviceConfig, DeviceScript | None]:
    """Device by its name in the user's own registry, or by its file, and the script it brings.

    Raises
    ------
    InputError
        There is no such device.
    UnapprovedScriptError
        Its script is to be read first.
    """
    from ..configuration import load_device
    from . import approval

    folder = resources.user_devices()
    device = load_device(name, folder)
    script = approval.script_of(name, folder)
    if script is not None and not script.is_approved:
        raise UnapprovedScriptError(
            f"Device '{name}' has the script {script.path}; {approval.how_to_approve(name)}."
        )
    return device, script


def target_of(device: DeviceConfig, settings: LiveSettings) -> dict[str, Any]:
    """Target that the output process is to open.

    Raises
    ------
    DeviceError
        Nothing drives this device live, or it is not there.
    """
    from ..host import opening
    from .discovery import port_of, same_port, serial_ports

    if settings.kind == "SIMULATOR":
        return {"kind": "simulator", **({"path": settings.path} if settings.path else {})}
    if settings.kind == "CSV":
        if not settings.path:
            raise DeviceError(f"Device '{device.id}': choose a file for the log.")
        return {"kind": "csv", "path": str(Path(settings.path))}
    if settings.kind == "AUDIO":
        return {"kind": "audio", "interface": settings.port}
    kind = opening.kind_of(device)
    if kind is None:
        raise DeviceError(
            f"Device '{device.id}': its configuration has no output, so it cannot be driven live."
        )
    if kind == "serial":
        ports = serial_ports()
        if not settings.port:
            return {"kind": kind, "port": port_of(device, ports)}
        return {"kind": kind, "port": same_port(device, settings.port, settings.unit, ports)}
    target: dict[str, Any] = {"kind": kind}
    if settings.host:
        target["host"] = settings.host
    if settings.port:
        if not settings.port.isdecimal():
            raise DeviceError(f"Device '{device.id}': '{settings.port}' is no network port.")
        target["port"] = int(settings.port)
    if settings.unit:
        target["unit"] = settings.unit
    return target


def latencies_ms(device: DeviceConfig) -> set[float]:
    """Latencies of a device's actuators that are compensated, ms."""
    found = {actuator.type.latency_ms for actuator in device.actuators}
    return {each for each in found if each >= LEAST_LATENCY_MS}


def vibrating(device: DeviceConfig, amplitude_m_s2: float, frequency_hz: float) -> list[float]:
    """Values (columns,) at which all vibration actuators play alike, and the others are silent."""
    values = device.neutral
    for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
        if actuator.type.modality == "vibration":
            values[part] = amplitude_m_s2, frequency_hz
    return values.tolist()
