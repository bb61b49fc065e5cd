# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for the connections of a device before it is connected: ports, toys, sound cards."""

import os
import threading
from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from ...engine.rendering.device_config import (
    BhapticsEncoder,
    ButtplugEncoder,
    DeviceConfig,
    SerialTransport,
    VrcHapticsEncoder,
)
from ...errors import DeviceError
from ...text import named
from ..host.opening import kind_of
from ..host.output import OutputLostError
from .discovery import FoundPort, answers, port_of, serial_ports
from .live_settings import LiveSettings

_PROGRAMS: Final[dict[type, str]] = {
    BhapticsEncoder: "the bHaptics Player",
    ButtplugEncoder: "Intiface Central, and its server",
}
NO_DEAD_MAN: Final = (
    "Motors of this board may run on if the network fails: keep its power switch within reach. "
    "Stop All sends zeros"
)
"""Warning about boards of VRC Haptics, shown before and during playback."""

_REPEAT_S: Final = 1.0
_LONGEST_S: Final = 300.0  # an abandoned search ends

Choices = tuple[tuple[str, str], ...]  # value of a setting, and description


@dataclass(frozen=True)
class Connections:
    """Connections that are present now."""

    ports: Choices = ()  # serial ports, or sound cards
    units: Choices = ()  # devices of a server
    hint: str = ""  # what is missing, and the cure; "": nothing
    more: "tuple[Connections, ...]" = ()  # of the outputs after the first


def why_not(device: DeviceConfig, kind: str) -> str:
    """Reason why a device cannot have settings of a kind; "" if the device can."""
    if kind == "DEVICE" and not device.outputs:
        plays = "the sound card or the log" if "vibration" in device.modalities else "the log"
        return f"HFX has no connection to this device: use {plays}, or export files"
    if kind == "AUDIO" and "vibration" not in device.modalities:
        return "A sound card plays vibration only; the device has none"
    if kind == "PAGE" and "vibration" not in device.modalities:
        return "A web page plays vibration only; the device has none"
    return ""


def searched(device: DeviceConfig, settings: LiveSettings) -> Generator[Connections, None, None]:
    """Search without end: each step gives the connections that are present now.

    A step takes at most some tenths of a second; of a Buttplug server, 3 s. The server scans for
    devices until the iterator is closed.
    """
    if settings.kind == "DEVICE" and len(device.parts) > 1:
        searches = [searched(x, settings.of_output(k)) for k, x in enumerate(device.parts)]
        # One step of all searches together: their results are of the same moment.
        for first, *more in zip(*searches, strict=True):
            # An equal hint of several outputs is one sentence; some hints end with a full stop.
            hints: dict[str, list[str]] = {}
            for part, result in zip(device.parts, (first, *more), strict=True):
                if result.hint:
                    ids = [actuator.id for actuator in part.actuators]
                    hints.setdefault(result.hint.rstrip("."), []).extend(ids)
            hint = ". ".join(
                text if len(ids) == len(device.actuators) else f"{named(ids)}: {text}"
                for text, ids in hints.items()
            )
            yield replace(first, hint=hint, more=tuple(more))
    kind = settings.kind if settings.kind != "DEVICE" else kind_of(device)
    if kind == "websocket":
        yield from _served(device, settings)
    while True:
        if kind == "serial":
            yield _serial(device, settings.port, serial_ports())
        elif (
            kind == "udp"
            and settings.kind == "DEVICE"
            and (device.output is not None and isinstance(device.output.encoder, VrcHapticsEncoder))
        ):
            yield _boards(settings)
        elif kind == "AUDIO":
            yield _cards(device, settings.port)
        else:
            is_without_file = kind == "CSV" and not settings.path
            yield Connections(hint="Choose a file for the log" if is_without_file else "")


def _serial(device: DeviceConfig, name: str, ports: list[FoundPort]) -> Connections:
    """Serial ports, those with USB ids first; the hint is on ``name``, or on the port by USB
    ids."""
    ports = sorted(ports, key=lambda port: port.usb is None)
    choices = tuple((port.name, port.description) for port in ports)
    if find_spec("serial") is None:
        hint = "The Python package pyserial is missing: install the extension's zip again"
        return Connections(hint=hint)
    if not name:
        try:
            name = port_of(device, ports)
        except DeviceError as error:
            hint = "Connect the device by USB and switch it on, or choose a port."
            return Connections(choices, hint=f"{error} {hint}")
    if not os.path.exists(name) and name not in [port.name for port in ports]:
        return Connections(choices, hint=f"{name} is missing: connect the device, or choose a port")
    if os.name == "posix" and not os.access(name, os.R_OK | os.W_OK):
        group = "dialout"
        with suppress(OSError, KeyError):  # unplugged now; a group without a name
            group = Path(name).group()
        cure = f"add your user to the group '{group}', then log in again"
        return Connections(choices, hint=f"No permission for {name}: {cure}")
    return Connections(choices)


def _served(device: DeviceConfig, settings: LiveSettings) -> Iterator[Connections]:
    """Devices of a Buttplug server that fit; for other programs, the hint if none answers."""
    from ..transports.buttplug import scanning

    assert device.output is not None
    how, transport = device.output.encoder, device.output.transport
    assert not isinstance(transport, SerialTransport)
    host, port = settings.host or transport.host, settings.port or str(transport.port)
    program = _PROGRAMS.get(type(how), "your program")
    while True:
        if not (port.isdecimal() and len(port) < 6 and 0 < int(port) < 65536):
            yield Connections(hint=f"'{port}' is no network port: allowed is 1 to 65535")
        elif not answers(host, int(port)):
            yield Connections(hint=f"No program answers at {host}:{port}: start {program}")
        elif not isinstance(how, ButtplugEncoder):
            yield Connections()
        else:
            try:
                with scanning(host, int(port)) as served:
                    while True:
                        devices = served()
                        fitting = tuple((x.label, "") for x in devices if x.fits(how))
                        names = ", ".join(x.names for x in devices) or "none"
                        hint = f"No device of the server fits; devices: {names}. Switch yours on"
                        yield Connections(units=fitting, hint="" if fitting else hint)
            except OutputLostError as error:
                yield Connections(hint=str(error))


def _boards(settings: LiveSettings) -> Connections:
    """Boards of VRC Haptics that announce themselves; the hint is on a missing board, or the
    warning that boards have no dead-man switch."""
    from ..transports.vrc_haptics import SEARCH_S, announced, chosen_board

    try:
        boards = announced(SEARCH_S)
        if not settings.host:
            chosen_board(boards, settings.unit)
    except OutputLostError as error:
        return Connections(hint=str(error))
    return Connections(units=tuple((board.label, board.host) for board in boards), hint=NO_DEAD_MAN)


def _cards(device: DeviceConfig, name: str) -> Connections:
    """Sound cards with their channels; the hint is on the card ``name``, "" for the default."""
    from ..transports.sound_card import cards

    try:
        present = cards()
    except OutputLostError as error:
        return Connections(hint=str(error))
    needed = sum(actuator.type.modality == "vibration" for actuator in device.actuators)
    choices = tuple((card.name, f"{card.channels} channels") for card in present)
    if not present:
        return Connections(hint="No sound card: connect one, and restart Blender")
    matching = [
        card for card in present if (name.lower() in card.name.lower() if name else card.is_default)
    ]
    if name and not matching and not name.isdecimal():
        return Connections(choices, hint=f"No sound card is named '{name}': choose one of the list")
    if matching and max(card.channels for card in matching) < needed:
        few = matching[0]
        hint = f"{few.name} has {few.channels} channels; the device needs {needed}"
        return Connections(choices, hint=hint)
    return Connections(choices)


class ConnectionSearch:
    """Search in a thread, repeated each second between start and end."""

    def __init__(self) -> None:
        self.newest: Connections | None = None  # None before the first result
        self._of: tuple[DeviceConfig, LiveSettings] | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread()

    def start(self, device: DeviceConfig | None, settings: LiveSettings) -> None:
        """Search for a device with settings; an equal search goes on. None: no search."""
        if device is not None and self._of != (device, settings):
            self.end()
            self._of, self._is_over = (device, settings), threading.Event()
            arguments = device, settings, self._is_over
            self._thread = threading.Thread(target=self._run, args=arguments, daemon=True)
            self._thread.start()

    def _run(self, device: DeviceConfig, settings: LiveSettings, is_over: threading.Event) -> None:
        search = searched(device, settings)
        for _ in range(round(_LONGEST_S / _REPEAT_S)):
            self.newest = next(search)
            if is_over.wait(_REPEAT_S):
                break
        search.close()

    def end(self) -> None:
        """End the search, with its connection to a server; waits for 4 s at most."""
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join(4.0)
        self.newest = self._of = None


search = ConnectionSearch()
"""Search of the dialog of *Connect*."""
