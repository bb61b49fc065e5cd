# SPDX-License-Identifier: GPL-3.0-or-later
"""Which serial ports there are, and on which of them a device answers to its USB ids."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

from ...engine.rendering.device import DeviceConfig
from ...errors import DeviceError


@dataclass(frozen=True)
class FoundPort:
    """A serial port of this machine."""

    name: str
    description: str
    usb: tuple[int, int] | None  # vendor id, product id
    serial: str = ""


def serial_ports() -> list[FoundPort]:
    """The ports of this machine; none without pyserial."""
    try:
        from serial.tools import list_ports
    except ImportError:
        return []
    return [
        FoundPort(
            each.device,
            each.description or "",
            None if each.vid is None or each.pid is None else (each.vid, each.pid),
            each.serial_number or "",
        )
        for each in list_ports.comports()
    ]


def port_of(device: DeviceConfig, ports: list[FoundPort]) -> str:
    """The one port whose USB ids are the device's, and its serial number if one is asked for.

    Raises
    ------
    DeviceError
        There is none, or more than one.
    """
    ids = device.brand.usb if device.brand is not None else ()
    pattern = device.brand.serial if device.brand is not None else ""
    matching = [
        each.name
        for each in ports
        if each.usb in ids and (not pattern or fnmatchcase(each.serial, pattern))
    ]
    if len(matching) == 1:
        return matching[0]
    there = ", ".join(f"{each.name} ({each.description})" for each in ports) or "none"
    if matching:
        raise DeviceError(
            f"Device '{device.id}' is on several ports ({', '.join(matching)}); say which."
        )
    raise DeviceError(f"Device '{device.id}' was not found; serial ports: {there}.")
