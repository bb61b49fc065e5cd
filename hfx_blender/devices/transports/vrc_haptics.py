# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to boards with the firmware of VRC Haptics: OSC messages in UDP datagrams.

A board announces itself once a second to a multicast group while no program drives the board, and
takes values only after a ``/ping`` with the port of the program. The values of ``/h`` have four
hexadecimal digits for each motor. Boards have no reliable dead-man switch: a second without
values clears only the list of received values, not the motors.
"""

import json
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from pythonosc.parsing import osc_types

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ...text import printable
from ..configurations.configuration_reader import is_local
from ..host.encoders import Channels
from ..host.output import OutputLostError
from .reservations import computer, release, reserve

PORT: Final = 1027
GROUP: Final = "239.0.0.1"
GROUP_PORT = 6868
STOPS: Final = 3

SEARCH_S = 2.3
"""Time for announcements, seconds: two intervals of a board, and some delay of the network."""

ANSWER_S: Final = 2.0
"""Time limit for the answer to a ping, seconds; a silent board is asked every 0.1 s."""

LOST_S: Final = 3.0
"""Time without a datagram of the board after which the board counts as lost, seconds. A board
sends a sign of life each second; after half of the limit the board gets a ping."""

FULL_SCALE: Final = 0xFFFF
_MOST_BYTES: Final = 1024
_SILENT_BOARD: Final = (
    "Switch the board on, and connect board and computer to the same network. Close other programs "
    "that drive the board."
)


@dataclass(frozen=True)
class Board:
    """Board that has announced itself."""

    host: str  # sender of the announcement
    port: int
    name: str
    mac: str

    @property
    def label(self) -> str:
        """Name and MAC address."""
        return f"{self.name} {self.mac}".strip()


def board_of(content: bytes, host: str) -> Board | None:
    """Board of an announcement from ``host``; None for any other content or an address that is not
    local. The address in the announcement is ignored: a datagram must not choose the receiver."""
    try:
        facts = json.loads(content[: _MOST_BYTES + 1])
        name, mac, port = facts["name"], facts["mac"], facts.get("port", PORT)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    is_port = isinstance(port, int) and not isinstance(port, bool) and 1 <= port <= 65535
    if len(content) > _MOST_BYTES or not is_port or not is_local(host):
        return None
    if not (isinstance(name, str) and isinstance(mac, str) and mac):
        return None
    return Board(host, port, printable(name)[:80], printable(mac)[:40])


def announced(search_s: float) -> list[Board]:
    """Boards that announce themselves within ``search_s``, seconds, sorted by label.

    Raises OutputLostError: the announcements cannot be received.
    """
    boards: dict[str, Board] = {}
    until = time.monotonic() + search_s
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        try:
            # The server of VRC Haptics listens on the same port.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "SO_REUSEPORT"):
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            listener.bind(("", GROUP_PORT))
        except OSError as error:
            text = f"Announcements of boards cannot be received on port {GROUP_PORT} ({error})."
            raise OutputLostError(text) from None
        with suppress(OSError):  # a computer without a network receives nothing
            membership = struct.pack("4sl", socket.inet_aton(GROUP), socket.INADDR_ANY)
            listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        while (left_s := until - time.monotonic()) > 0.0:
            listener.settimeout(left_s)
            # Several boards may announce themselves, each once a second: the search goes on until
            # its end, and the newest announcement of a board counts.
            with suppress(OSError):  # the time is over
                content, sender = listener.recvfrom(_MOST_BYTES + 1)
                board = board_of(content, sender[0])
                if board is not None:
                    boards[board.mac] = board
    return sorted(boards.values(), key=lambda board: board.label)


def chosen_board(boards: Sequence[Board], unit: str) -> Board:
    """Board with a label, name or MAC address ``unit``, or the only board for "".

    Raises OutputLostError: no board or several boards match.
    """
    matches = [x for x in boards if unit in ("", x.label, x.name, x.mac)]
    if len(matches) == 1:
        return matches[0]
    present = ", ".join(board.label for board in boards) or "none"
    if matches:
        raise OutputLostError(f"Several boards fit: {present}. Choose one with 'Which One'.")
    wanted = f"board '{unit[:80]}'" if unit else "VRC Haptics board"
    raise OutputLostError(
        f"No {wanted} announced itself within {SEARCH_S:g} s; boards: {present}. {_SILENT_BOARD}"
    )


def ping(port: int) -> bytes:
    """Message that asks a board for an answer to a port of this computer."""
    return osc_types.write_string("/ping") + osc_types.write_string(",i") + port.to_bytes(4, "big")


def motors(numbers: Sequence[int]) -> bytes:
    """Message with the values 0..65535 of all motors of a board."""
    text = "".join(f"{number:04x}" for number in numbers)
    return b"".join(map(osc_types.write_string, ("/h", ",s", text)))


class VrcHapticsOutput:
    """Output to a board. The attribute ``chosen_device`` is the MAC address of the board.

    ``host``: address of the board; "": the board that announces itself, chosen by ``unit``.

    Raises OutputLostError: no board answers or fits, or the board is in use by another device.
    """

    def __init__(self, device: DeviceConfig, host: str, port: int, unit: str = "") -> None:
        self._channels = Channels(device, strengths_only=True)
        if not host:
            board = chosen_board(announced(SEARCH_S), unit)
            host, port = board.host, board.port
        self._name = f"The VRC Haptics board at {host}:{port}"
        self.chosen_device = ""
        self._heard_s = self._pinged_s = self._served_s = -1e9
        self._has_answered = False
        try:
            self._address = socket.gethostbyname(host), port
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind(("127.0.0.1" if self._address[0].startswith("127.") else "", 0))
            self._socket.setblocking(False)
        except OSError as error:
            raise OutputLostError(f"{self._name} cannot be reached ({error}).") from None
        self._reserved = frozenset[object]()
        try:
            keys = [("vrc-haptics", computer(host), port)]
            self._reserved = reserve(keys, self._name)
            if not self._await_answer():
                raise OutputLostError(f"{self._name} does not answer. {_SILENT_BOARD}")
        except BaseException:
            self._end()
            raise

    def send(self, values: F64) -> None:
        """Send values (columns,). Raises OutputLostError: the board is silent for
        :data:`LOST_S`, or the network is lost."""
        self._check()
        numbers = self._channels.whole(self._channels.values(values), FULL_SCALE)
        self._send(motors(numbers.tolist()))

    def stop(self) -> None:
        """Send zeros for all motors three times, as datagrams may be lost; never raises
        OutputLostError."""
        for _ in range(STOPS):
            with suppress(OutputLostError):
                self._send(motors([0] * len(self._channels)))

    def close(self) -> None:
        """Send zeros until the board answers a later ping, for :data:`ANSWER_S` at most, and close
        the socket. Raises OutputLostError without an answer: the motors may still run."""
        try:
            if not self._await_answer(before=motors([0] * len(self._channels))):
                raise OutputLostError(
                    f"{self._name} does not confirm the stop. Its motors may run on: switch the "
                    "board off."
                )
        finally:
            self._end()

    def _end(self) -> None:
        self._socket.close()
        release(self._reserved)

    def _await_answer(self, before: bytes = b"") -> bool:
        """Send ``before`` and a ping every 0.1 s until the board answers; False after
        :data:`ANSWER_S`, or if the network is lost."""
        # Answers to earlier pings prove nothing about the zeros that follow.
        self._receive()
        self._has_answered = False
        until = time.monotonic() + ANSWER_S
        while time.monotonic() < until:
            with suppress(OutputLostError):
                # A board executes messages in order: an answer to the ping follows the zeros.
                if before:
                    self._send(before)
                self._ping()
            for _ in range(10):
                time.sleep(0.01)
                self._receive()
                if self._has_answered:
                    return True
        return False

    def _check(self) -> None:
        """Read signs of life, and ping a silent board; OutputLostError after :data:`LOST_S`."""
        now = time.monotonic()
        self._receive()
        # Nothing was read while the device was stopped: the board gets half of the time again.
        if now - self._served_s > 1.0:
            self._heard_s = max(self._heard_s, now - 0.5 * LOST_S)
        self._served_s = now
        silent_s = now - self._heard_s
        if silent_s > LOST_S:
            raise OutputLostError(f"{self._name} gave no sign of life for {LOST_S:g} s.")
        # Signs of life go to the first program since the board's start; a restarted board waits
        # for a ping as well.
        if silent_s >= 0.5 * LOST_S and now - self._pinged_s > 0.25:
            self._ping()

    def _ping(self) -> None:
        self._pinged_s = time.monotonic()
        self._send(ping(self._socket.getsockname()[1]))

    def _receive(self) -> None:
        """Read all datagrams of the board; an answer to a ping gives its MAC address."""
        for _ in range(100):  # a flood must not hold the thread
            try:
                content, sender = self._socket.recvfrom(_MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # Windows reports an unreachable port of an earlier datagram
                continue
            # The board sends from any of its ports.
            if sender[0] != self._address[0]:
                continue
            self._heard_s = time.monotonic()
            if content.startswith(b"/ping\0\0\0,is\0"):
                self._has_answered = True
                mac = content[16:].split(b"\0")[0].decode("ascii", "replace")
                self.chosen_device = printable(mac)[:40]

    def _send(self, content: bytes) -> None:
        try:
            self._socket.sendto(content, self._address)
        except (BlockingIOError, ConnectionError):
            return  # a full queue drops the datagram, as any network may
        except OSError as error:
            raise OutputLostError(f"{self._name} cannot be reached ({error}).") from None
