# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovery of connected devices: serial ports by USB ids, programs at network addresses."""

import socket
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from ...engine.rendering.device_config import (
    ButtplugEncoder,
    DeviceConfig,
    VrcHapticsEncoder,
    WebsocketTransport,
)
from ...errors import DeviceError, HfxError
from ..configurations.configuration_reader import is_local
from ..host.output import OutputLostError

ANSWER_S: Final = 0.15
"""Time limit for a connection to a program on this computer or its network, seconds."""


@dataclass(frozen=True)
class FoundPort:
    """Serial port of this computer."""

    name: str
    description: str
    usb: tuple[int, int] | None  # vendor id, product id
    serial: str = ""  # serial number


def serial_ports() -> list[FoundPort]:
    """Serial ports of this computer; empty without pyserial."""
    try:
        from serial.tools import list_ports
    except ImportError:
        return []
    return [
        FoundPort(
            port.device,
            "" if port.description in (None, "n/a") else port.description,  # "n/a" of pyserial
            None if port.vid is None or port.pid is None else (port.vid, port.pid),
            port.serial_number or "",
        )
        for port in list_ports.comports()
    ]


@dataclass(frozen=True)
class Found:
    """Device present now: configuration and connection."""

    device: str  # id
    port: str  # serial port; "": a network address as configured
    description: str
    unit: str = ""  # as of LiveSettings
    more: tuple[tuple[str, str], ...] = ()  # port and unit of each output after the first


def answers(host: str, port: int) -> bool:
    """Test that a program accepts a TCP connection within 0.15 s, without sending data; False for
    an address that is not local."""
    if not is_local(host):
        return False
    with suppress(OSError), socket.create_connection((host, port), ANSWER_S):
        return True
    return False


def found_devices(devices: Iterable[DeviceConfig], ports: Iterable[FoundPort]) -> list[Found]:
    """Pairs of a device and a present connection, for the user to choose; empty without any.

    First, in the order of ``devices``, one for each of ``ports`` with USB ids and serial number of
    the device's brand; then devices by websocket whose local program accepts a connection, for
    Buttplug one for each fitting device of the server, and by VRC Haptics one for each board that
    announces itself within two seconds. Never OSC: datagrams get no answer.
    """
    ports, matches = list(ports), []
    devices = list(devices)
    for_boards: list[DeviceConfig] = []
    programs: dict[tuple[str, int], list[DeviceConfig]] = {}
    for device in devices:
        # A device of several outputs is present only with all of its outputs.
        if len(device.parts) > 1:
            matches += _joined(device, ports)
            continue
        matches += [
            Found(device.id, p.name, p.description, p.serial) for p in ports if _is_on(device, p)
        ]
        transport = None if device.output is None else device.output.transport
        if isinstance(transport, WebsocketTransport):
            programs.setdefault((transport.host, transport.port), []).append(device)
        elif device.output is not None and isinstance(device.output.encoder, VrcHapticsEncoder):
            for_boards.append(device)
    if for_boards:
        from ..transports.vrc_haptics import SEARCH_S, announced

        with suppress(OutputLostError):
            for board in announced(SEARCH_S):
                text = f"VRC Haptics board at {board.host}"
                matches += [Found(device.id, "", text, board.label) for device in for_boards]
    if programs:
        # In parallel, as an address without a program costs the whole time limit.
        with ThreadPoolExecutor(len(programs)) as pool:
            answered = list(pool.map(lambda address: answers(*address), programs))
        for (host, port), is_present in zip(programs, answered, strict=True):
            if is_present:
                matches += _behind(host, port, programs[host, port])
    return matches


def _joined(device: DeviceConfig, ports: list[FoundPort]) -> list[Found]:
    """Match of a device with several outputs: for each output the first present connection that no
    output before has; empty unless all outputs are present."""
    chosen: list[Found] = []
    for part in device.parts:
        taken = [(match.port, match.unit) for match in chosen if match.port or match.unit]
        # Two boards with equal USB ids differ by port or serial number.
        free = [x for x in found_devices([part], ports) if (x.port, x.unit) not in taken]
        chosen += free[:1]
    if len(chosen) < len(device.parts):
        return []
    first, text = chosen[0], "; ".join(match.description for match in chosen)
    more = tuple((match.port, match.unit) for match in chosen[1:])
    return [Found(device.id, first.port, text, first.unit, more)]


def found_at(folder: Path) -> tuple[list[str], list[Found], list[str]]:
    """Look for all shipped devices and devices of a folder, for about three seconds.

    Returns the names of all serial ports, the matches, and messages about unreadable
    configurations.
    """
    from ..configuration import list_devices, load_device

    devices, faults = [], []
    for name in list_devices(folder):
        try:
            devices.append(load_device(name, folder))
        except HfxError as error:
            faults.append(str(error))
    ports = serial_ports()
    return [port.name for port in ports], found_devices(devices, ports), faults


def _behind(host: str, port: int, devices: list[DeviceConfig]) -> list[Found]:
    """Matches of ``devices`` configured for a program at an address: one each; for Buttplug one for
    each fitting device of the server, none if it is no Buttplug server. Connects to the server."""
    from ..transports.buttplug import devices_at

    text, matches, served = f"a program on {host}:{port}", [], None
    for device in devices:
        how = None if device.output is None else device.output.encoder
        if not isinstance(how, ButtplugEncoder):
            matches.append(Found(device.id, "", text))
            continue
        if served is None:
            try:
                served = devices_at(host, port)
            except OutputLostError:  # the program is no Buttplug server
                served = []
        fitting = [unit for unit in served if unit.fits(how)]
        matches += [Found(device.id, "", f"{u.label} at {text}", u.label) for u in fitting]
    return matches


def _is_on(device: DeviceConfig, port: FoundPort) -> bool:
    # Boards of one maker share USB ids: a serial number pattern distinguishes products.
    if device.brand is None or port.usb not in device.brand.usb:
        return False
    return not device.brand.serial or fnmatchcase(port.serial, device.brand.serial)


def serial_number_of(name: str, ports: Iterable[FoundPort]) -> str:
    """Serial number of the device on a port; "" without a number or port."""
    return next((port.serial for port in ports if port.name == name), "")


def same_port(device: DeviceConfig, name: str, serial_number: str, ports: list[FoundPort]) -> str:
    """Port of the device with a serial number, last seen on port ``name``.

    Returns ``name`` if ``serial_number`` is "", or ``name`` has no number or the same number.

    Raises DeviceError: the device is on no port, and a device with another serial number is on
    ``name``.
    """
    at_name = serial_number_of(name, ports)
    # Without numbers to compare, the name of the port decides.
    if not serial_number or not at_name or at_name == serial_number:
        return name
    for port in ports:
        if port.serial == serial_number:
            return port.name
    raise DeviceError(
        f"Device '{device.name}' was connected with serial number {serial_number[:80]}, which is "
        f"on no port; on {name} is another one, {at_name[:80]}. To use that, clear 'Which One' "
        "when you connect it."
    )


def port_of(device: DeviceConfig, ports: list[FoundPort]) -> str:
    """The only port with the device's USB ids, and serial number pattern if configured.

    Raises DeviceError: no port or several ports match.
    """
    matching = [port.name for port in ports if _is_on(device, port)]
    if len(matching) == 1:
        return matching[0]
    texts = (f" ({port.description})" if port.description else "" for port in ports)
    there = ", ".join(port.name + text for port, text in zip(ports, texts, strict=True)) or "none"
    if matching:
        raise DeviceError(
            f"Device '{device.name}' is on several ports ({', '.join(matching)}); choose one."
        )
    raise DeviceError(f"Device '{device.name}' was not found; serial ports: {there}.")
