# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovers devices: serial ports by USB ids, programs that answer on the network."""

from __future__ import annotations

import socket
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from ...engine.rendering.device_config import ButtplugEncoder, DeviceConfig, WebsocketTransport
from ...errors import DeviceError, HfxError
from ..configurations.output_reader import is_local
from ..host.output import OutputLostError

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
    unit: str = ""  # which of several: see LiveSettings


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
    programs: dict[tuple[str, int], list[DeviceConfig]] = {}
    for device in devices:
        found += [
            Found(device.id, p.name, p.description, p.serial) for p in ports if _is_on(device, p)
        ]
        transport = None if device.output is None else device.output.transport
        if isinstance(transport, WebsocketTransport):
            programs.setdefault((transport.host, transport.port), []).append(device)
    if programs:
        with ThreadPoolExecutor(len(programs)) as pool:
            there = list(pool.map(lambda place: answers(*place), programs))
        for (host, port), is_there in zip(programs, there, strict=True):
            if is_there:
                found += _behind(host, port, programs[host, port])
    return found


def found_at(folder: Path) -> tuple[list[str], list[Found], list[str]]:
    """Look for all known devices.

    Parameters
    ----------
    folder : Path
        Of the user's own configurations.

    Returns
    -------
    ports : list of str
        Names of all serial ports.
    found : list of Found
    faults : list of str
        Of configurations that cannot be read.
    """
    from ..configuration import list_devices, load_device

    devices, faults = [], []
    for name in list_devices(folder):
        try:
            devices.append(load_device(name, folder))
        except HfxError as error:
            faults.append(str(error))
    ports = serial_ports()
    return [each.name for each in ports], found_devices(devices, ports), faults


def _behind(host: str, port: int, devices: list[DeviceConfig]) -> list[Found]:
    """Devices behind a program: with Buttplug, each of its devices that one fits."""
    from ..transports.buttplug import devices_at

    text, found, served = f"a program on {host}:{port}", [], None
    for device in devices:
        how = None if device.output is None else device.output.encoder
        if not isinstance(how, ButtplugEncoder):
            found.append(Found(device.id, "", text))
            continue
        if served is None:
            try:
                served = devices_at(host, port)
            except OutputLostError:  # it answers, but not as Buttplug
                served = []
        fitting = [each for each in served if each.fits(how)]
        found += [Found(device.id, "", f"{e.label} at {text}", e.label) for e in fitting]
    return found


def _is_on(device: DeviceConfig, port: FoundPort) -> bool:
    if device.brand is None or port.usb not in device.brand.usb:
        return False
    return not device.brand.serial or fnmatchcase(port.serial, device.brand.serial)


def serial_number_of(name: str, ports: Iterable[FoundPort]) -> str:
    """Serial number of the device on a port; empty where it has none."""
    return next((each.serial for each in ports if each.name == name), "")


def same_port(device: DeviceConfig, name: str, serial_number: str, ports: list[FoundPort]) -> str:
    """Find the port of the device that was on a port when it was chosen.

    Raises
    ------
    DeviceError
        It is on no port, and another device is on the one that was chosen.
    """
    at_name = serial_number_of(name, ports)
    if not serial_number or not at_name or at_name == serial_number:
        return name
    for each in ports:
        if each.serial == serial_number:
            return each.name
    raise DeviceError(
        f"Device '{device.id}' was connected with serial number {serial_number[:80]}, which is on "
        f"no port; on {name} is another one, {at_name[:80]}. To use that, clear 'Which One' when "
        "you connect it."
    )


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
