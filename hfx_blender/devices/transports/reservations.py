# SPDX-License-Identifier: GPL-3.0-or-later
"""Reservations of what outputs of this process drive: ports, devices of a server, channels."""

from __future__ import annotations

import ipaddress
import socket
import threading
from collections.abc import Hashable, Iterable
from contextlib import suppress

from ..host.output import OutputLostError

Keys = frozenset[Hashable]

reserved: dict[Hashable, Keys] = {}
_lock = threading.Lock()


def reserve(keys: Iterable[Hashable], name: str) -> Keys:
    """Reserve all keys of an output, or none.

    Parameters
    ----------
    keys : iterable of hashable
        What the output drives, under each name by which it may be reached.
    name : str
        For the message.

    Raises
    ------
    OutputLostError
        Another output has reserved one of them.
    """
    found = frozenset(keys)
    with _lock:
        if not found.isdisjoint(reserved):
            raise OutputLostError(f"{name} is open already, for another device.")
        reserved.update(dict.fromkeys(found, found))
    return found


def are_free(keys: Iterable[Hashable]) -> bool:
    """Test that no output has reserved any of these keys."""
    with _lock:
        return not any(key in reserved for key in keys)


def release(keys: Keys) -> None:
    """Give keys back; it may be called again."""
    with _lock:
        for key in keys:
            if reserved.get(key) is keys:  # unless another output has reserved it since
                del reserved[key]


def server_key(host: str, port: int) -> tuple[str, int]:
    """Key of a server, the same for all spellings of its address."""
    return computer(host), port


def computer(host: str) -> str:
    """Address of a computer in one spelling; all addresses of this computer are one."""
    name = host.strip().rstrip(".").lower()
    try:
        address = ipaddress.ip_address("127.0.0.1" if name == "localhost" else name)
    except ValueError:
        return name
    address = getattr(address, "ipv4_mapped", None) or address
    if address.is_loopback or address.is_unspecified or _is_own(address):
        return "this computer"
    return str(address)


def _is_own(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.bind((str(address), 0))  # only an own address can be bound; nothing is sent
        return True
    return False
