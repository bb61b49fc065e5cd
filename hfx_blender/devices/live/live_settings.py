# SPDX-License-Identifier: GPL-3.0-or-later
"""Connection settings of a user's devices, and targets for the output process.

Settings are stored in the user's data folder, never in a .blend, which has only the names of
devices: a downloaded .blend cannot open a port.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ...errors import DeviceError, InputError
from ...files import resources
from ...files.atomic import amend_json, stored_json

if TYPE_CHECKING:
    from ...engine.rendering.device_config import DeviceConfig
    from .approval import DeviceScript

MAX_OFFSET_MS: Final = 1000.0

LEAST_LATENCY_MS: Final = 5.0
"""Shortest latency that is compensated, ms; the delay of the picture is longer."""


@dataclass(frozen=True)
class PortSettings:
    """Connection of an output; members as of :class:`LiveSettings`."""

    port: str = ""
    host: str = ""
    unit: str = ""


@dataclass(frozen=True)
class LiveSettings:
    """Connection settings of a device."""

    kind: str = "SIMULATOR"  # or DEVICE, AUDIO, CSV, PAGE
    port: str = ""  # serial port, "": by USB ids; network port, "": as configured; sound card
    host: str = ""  # "": as configured
    path: str = ""  # of a log
    offset_ms: float = 0.0  # delay of the values, 0..1000
    unit: str = ""  # among several devices: label at a server, or serial number at a port
    more: tuple[PortSettings, ...] = ()  # outputs of the device after the first
    profile: str = ""  # of a person; "": none

    def of_output(self, index: int) -> LiveSettings:
        """Settings of an output by its number from 0, without the other outputs; empty port, host
        and unit for an output that is missing here."""
        if not index:
            return replace(self, more=())
        own = self.more[index - 1] if index <= len(self.more) else PortSettings()
        return replace(self, **asdict(own), more=())


def load() -> dict[str, LiveSettings]:
    """Load the settings by device name; empty without a valid file. Invalid members have their
    default, the delay is clipped to 0..1000 ms."""
    settings = {}
    for name, entry in (stored_json(resources.live_settings()) or {}).items():
        if not isinstance(entry, dict):
            continue
        members: dict[str, Any] = {}
        for field in fields(LiveSettings):
            value = entry.get(field.name, field.default)
            if field.name == "more":
                items = value if isinstance(value, list) else []
                members["more"] = tuple(_port_settings(item) for item in items)
            elif isinstance(field.default, str):
                members[field.name] = value if isinstance(value, str) else field.default
            else:  # the delay
                is_number = isinstance(value, int | float) and math.isfinite(value)
                delay_ms = min(max(float(value), 0.0), MAX_OFFSET_MS) if is_number else 0.0
                members[field.name] = delay_ms
        settings[str(name)] = LiveSettings(**members)
    return settings


def _port_settings(entry: object) -> PortSettings:
    """Connection of an output from JSON; invalid members are empty."""
    members = entry if isinstance(entry, dict) else {}
    texts = (members.get(field.name) for field in fields(PortSettings))
    return PortSettings(*(text if isinstance(text, str) else "" for text in texts))


def store(name: str, settings: LiveSettings) -> None:
    """Store changed settings of a device; entries of concurrent processes are kept.

    Raises OutputError: the file cannot be written.
    """
    if load().get(name) == settings:
        return
    amend_json(
        resources.live_settings(),
        lambda: {k: asdict(entry) for k, entry in sorted({**load(), name: settings}.items())},
    )


class UnapprovedScriptError(InputError):
    """Raised for a device's script without approval of the present bytes."""


def named(name: str) -> tuple[DeviceConfig, DeviceScript | None]:
    """Load a device by name or file, with the approved script; None without a script.

    Raises InputError: the device is unknown or its file invalid.
    Raises UnapprovedScriptError: the user has not approved the script.
    """
    from ..configuration import load_device
    from . import approval

    folder = resources.user_devices()
    device = load_device(name, folder)
    script = approval.script_of(name, folder)
    if script is not None and not script.is_approved:
        raise UnapprovedScriptError(
            f"Device '{device.name}' has the script {script.path}; {approval.how_to_approve(name)}."
        )
    return device, script


def target_of(device: DeviceConfig, settings: LiveSettings) -> dict[str, Any]:
    """Target for :func:`~hfx_blender.devices.host.opening.open_output`, by kind of the settings:
    log, sound card, or the device's output, with host, port and unit only where set; a serial port
    by USB ids or serial number.

    Raises DeviceError: the device has no output, is on no port, or the settings are incomplete.
    """
    if settings.kind == "SIMULATOR":
        return {"kind": "simulator", **({"path": settings.path} if settings.path else {})}
    if settings.kind == "CSV":
        if not settings.path:
            raise DeviceError(f"Device '{device.name}': choose a file for the log.")
        return {"kind": "csv", "path": str(Path(settings.path))}
    if settings.kind == "AUDIO":
        return {"kind": "audio", "interface": settings.port}
    if settings.kind == "PAGE":
        return {"kind": "page", "host": settings.host or "127.0.0.1"}
    if not device.parts:
        raise DeviceError(
            f"Device '{device.name}': its configuration has no output, so it cannot be driven live."
        )
    targets = [_target_of_part(part, settings.of_output(k)) for k, part in enumerate(device.parts)]
    return targets[0] if len(targets) == 1 else {"kind": "several", "outputs": targets}


def _target_of_part(device: DeviceConfig, settings: LiveSettings) -> dict[str, Any]:
    """Target of a device with one output; DeviceError as of :func:`target_of`."""
    from ..host import opening
    from .discovery import port_of, same_port, serial_ports

    kind = opening.kind_of(device)
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
            raise DeviceError(f"Device '{device.name}': '{settings.port}' is no network port.")
        target["port"] = int(settings.port)
    if settings.unit:
        target["unit"] = settings.unit
    return target


def latencies_ms(device: DeviceConfig) -> set[float]:
    """Different latencies of a device's actuators, ms, without those below 5 ms."""
    latencies = {actuator.type.latency_ms for actuator in device.actuators}
    return {ms for ms in latencies if ms >= LEAST_LATENCY_MS}


def vibrating(device: DeviceConfig, amplitude_m_s2: float, frequency_hz: float) -> list[float]:
    """Values (columns,): amplitude and frequency at each vibration actuator, neutral elsewhere."""
    values = device.neutral
    for actuator, part in zip(device.actuators, device.actuator_columns, strict=True):
        if actuator.type.modality == "vibration":
            values[part] = amplitude_m_s2, frequency_hz
    return values.tolist()


def page_of(unit: str) -> tuple[str, str]:
    """Address without scheme, and code, of a web page from the label of its output; the code is ""
    for other outputs."""
    address, _, code = unit.removeprefix("http://").partition(" code ")
    return address, code
