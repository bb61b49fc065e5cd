# SPDX-License-Identifier: GPL-3.0-or-later
"""Receiver of OSC messages by UDP in a thread, with a bound on the work of a flood."""

import ipaddress
import socket
import threading
import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from ..errors import UsageError
from .osc_packets import MAX_DATAGRAM, OscMessage, decode

PRIVATE: Final = (
    "127.0.0.0/8",
    "10.0.0.0/8",
    "172.16.0.0/12",
    "192.168.0.0/16",
    "169.254.0.0/16",
    "::1/128",
    "fc00::/7",
    "fe80::/10",
)
"""Networks of the own computer and of local networks (RFC 1918, 3927, 4193, 4291)."""

MAX_KEPT: Final = 256  # messages between two calls of take()

# Bound of the work: datagrams and messages per second over time, and at once. A body of 60 bones
# sends 7,320 at 120 Hz in bundles, 7,200 at 60 Hz in a datagram for each bone.
_MESSAGES_PER_S: Final = 8_000.0
_BURST: Final = 96.0

_WAIT_S: Final = 0.02  # between two tests for the end

# A sender of so many datagrams within a second is the only one, until half a second of silence. A
# program with a new socket for each datagram stays below.
_STEADY: Final = 10
_SILENT_S: Final = 0.5


class ReceivedMessage(NamedTuple):
    """OSC message and the time of its arrival on the clock of ``time.monotonic``, seconds."""

    message: OscMessage
    arrived_s: float


class OscReceiver:
    """UDP socket whose thread decodes OSC datagrams of allowed senders.

    ``address``, ``port``: numeric address and port of the socket; port 0: any free port. The
    attribute ``port`` has the port in use.
    ``allowed``: networks of allowed senders; by default loopback and private networks.
    ``is_used``: test of OSC addresses that are decoded; None: all.
    ``is_single``: take the datagrams of one steady sender only; the attribute ``second`` has the
    address and port of another sender, None without one.

    Of messages with the same address and the same first text argument the newest counts. The
    attribute ``ignored`` counts ignored datagrams and messages.

    Raises UsageError: the address or port is not allowed or in use.
    """

    def __init__(
        self,
        address: str = "127.0.0.1",
        port: int = 0,
        allowed: Sequence[str] = PRIVATE,
        is_used: Callable[[str], bool] | None = None,
        is_single: bool = False,
    ) -> None:
        networks = [_network(text) for text in allowed]
        # A flood of one sender must not parse the sender's address for each datagram.
        self._is_allowed = lru_cache(256)(lambda sender: _is_in(sender, networks))
        self._is_used = is_used
        self._newest: dict[tuple[str, str], ReceivedMessage] = {}
        self._lock = threading.Lock()
        self._is_closed = False
        self.ignored = 0
        self.second: tuple[str, int] | None = None
        self._is_single = is_single
        self._steady: tuple[str, int] | None = None
        self._steady_s = self._counted_s = 0.0
        self._counts: dict[tuple[str, int], int] = {}
        self._socket = _bound_socket(address, port)
        self._socket.settimeout(_WAIT_S)
        self.port = int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._receive, name="hfx osc", daemon=True)
        self._thread.start()

    def take(self) -> list[ReceivedMessage]:
        """Newest messages since the last call, at most 256, in order of arrival; never waits."""
        with self._lock:
            newest, self._newest = self._newest, {}
        return list(newest.values())

    def close(self) -> None:
        """End the thread and close the socket; may be called again."""
        self._is_closed = True
        self._thread.join()
        self._socket.close()

    def _receive(self) -> None:
        """Decode datagrams until :meth:`close`."""
        budget, counted_s = _BURST, time.monotonic()
        while not self._is_closed:
            try:
                datagram, sender = self._socket.recvfrom(MAX_DATAGRAM + 1)
            except OSError:  # nothing arrived; on Windows also a datagram that is too long
                continue
            now_s = time.monotonic()
            budget = min(budget + _MESSAGES_PER_S * (now_s - counted_s), _BURST)
            counted_s = now_s
            budget -= 1.0
            if self._is_allowed(sender[0]) and self._is_of_one(sender[:2], now_s):
                messages, ignored = decode(datagram, self._is_used)
                budget -= len(messages) + ignored
                self._keep(messages, now_s)
                self.ignored += ignored
            else:
                self.ignored += 1
            # The system drops what its buffer cannot hold while this thread rests.
            if budget < 0.0:
                time.sleep(-budget / _MESSAGES_PER_S + _BURST / _MESSAGES_PER_S / 2.0)

    def _is_of_one(self, sender: tuple[str, int], now_s: float) -> bool:
        """Count a datagram; False if the receiver is single and another sender steady."""
        if not self._is_single:
            return True
        if self._steady is not None and sender != self._steady:
            if now_s - self._steady_s <= _SILENT_S:
                self.second = sender
                return False
            self._steady, self.second = None, None
        if now_s - self._counted_s > 1.0:
            self._counted_s, self._counts = now_s, {}
        self._counts[sender] = self._counts.get(sender, 0) + 1
        if self._counts[sender] >= _STEADY:
            self._steady = sender
        if sender == self._steady:
            self._steady_s = now_s
        return True

    def _keep(self, messages: list[OscMessage], now_s: float) -> None:
        """Store messages in place of older ones with equal address and name."""
        with self._lock:
            for message in messages:
                first = message.arguments[0] if message.arguments else ""
                key = (message.address, first if isinstance(first, str) else "")
                # Stored again at the end: the order is that of arrival.
                if self._newest.pop(key, None) is None and len(self._newest) >= MAX_KEPT:
                    self.ignored += 1
                    continue
                self._newest[key] = ReceivedMessage(message, now_s)


def _network(text: str) -> ipaddress.IPv4Network | ipaddress.IPv6Network:
    try:
        return ipaddress.ip_network(text)
    except ValueError:
        raise UsageError(f"sender '{text[:60]}': expected an address, as 192.168.0.20") from None


def _is_in(sender: str, networks: Sequence[ipaddress.IPv4Network | ipaddress.IPv6Network]) -> bool:
    """Test a numeric address of a sender; IPv4 addresses within IPv6 count as IPv4."""
    address = ipaddress.ip_address(sender.partition("%")[0])
    mapped = getattr(address, "ipv4_mapped", None)
    return any((mapped or address) in network for network in networks)


def _bound_socket(address: str, port: int) -> socket.socket:
    """UDP socket bound to a numeric address; UsageError with the reason."""
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(address).version == 6 else socket.AF_INET
    except ValueError:
        raise UsageError(f"address '{address[:60]}': expected a number, as 127.0.0.1") from None
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        bound.bind((address, port))
    except OverflowError:
        bound.close()
        raise UsageError(f"port {port}: expected 1 to 65535, or 0 for any") from None
    except OSError as error:
        bound.close()
        raise UsageError(f"port {port} of {address}: {error.strerror}") from None
    return bound
