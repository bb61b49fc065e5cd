# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovers devices: serial ports by USB ids, programs that answer on the network."""

from __future__ import annotations

import socket
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final

from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.device_output import WebsocketTransport
from ...errors import DeviceError
from ..output_reader import is_local

ANSWER_S: Final = 0.15
"""A program on this computer or its network answers sooner than that."""


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


@dataclass(frozen=True)
class Found:
    """Device that can be connected now."""

    device: str
    port: str  # serial port; empty: as its configuration has it
    description: str


def answers(host: str, port: int) -> bool:
    """Test that a program takes connections at an address; nothing is sent to it."""
    if not is_local(host):
        return False
    with suppress(OSError), socket.create_connection((host, port), ANSWER_S):
        return True
    return False


def found_devices(devices: Iterable[DeviceConfig], ports: Iterable[FoundPort]) -> list[Found]:
    """Devices that are present: on a port with their USB ids, or behind a program that answers.

    Datagrams get no answer, so that what is driven by them cannot be looked for.
    """
    ports, found = list(ports), []
    programs: dict[tuple[str, int], list[str]] = {}
    for device in devices:
        found += [Found(device.id, p.name, p.description) for p in ports if _is_on(device, p)]
        transport = None if device.output is None else device.output.transport
        if isinstance(transport, WebsocketTransport):
            programs.setdefault((transport.host, transport.port), []).append(device.id)
    if programs:
        with ThreadPoolExecutor(len(programs)) as pool:
            there = list(pool.map(lambda place: answers(*place), programs))
        for (host, port), is_there in zip(programs, there, strict=True):
            if is_there:
                text = f"a program on {host}:{port}"
                found += [Found(name, "", text) for name in programs[host, port]]
    return found


def _is_on(device: DeviceConfig, port: FoundPort) -> bool:
    if device.brand is None or port.usb not in device.brand.usb:
        return False
    return not device.brand.serial or fnmatchcase(port.serial, device.brand.serial)


def port_of(device: DeviceConfig, ports: list[FoundPort]) -> str:
    """Find the only port with the device's USB ids, and its serial number if one is given.

    Raises
    ------
    DeviceError
        There is none, or more than one.
    """
    matching = [each.name for each in ports if _is_on(device, each)]
    if len(matching) == 1:
        return matching[0]
    there = ", ".join(f"{each.name} ({each.description})" for each in ports) or "none"
    if matching:
        raise DeviceError(
            f"Device '{device.id}' is on several ports ({', '.join(matching)}); choose one."
        )
    raise DeviceError(f"Device '{device.id}' was not found; serial ports: {there}.")
