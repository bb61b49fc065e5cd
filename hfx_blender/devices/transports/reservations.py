# SPDX-License-Identifier: GPL-3.0-or-later
"""Reservations of ports, devices of a server and channels by the outputs of this process."""

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
    """Reserve all keys of an output, or none; the result is for :func:`release`.

    ``keys``: ports, devices or channels of the output, under all names.
    ``name``: name of the output in the message.

    Raises OutputLostError: a key is reserved by another output.
    """
    own = frozenset(keys)
    with _lock:
        if not own.isdisjoint(reserved):
            raise OutputLostError(f"{name} is open already, for another device.")
        reserved.update(dict.fromkeys(own, own))
    return own


def are_free(keys: Iterable[Hashable]) -> bool:
    """Test that no output has reserved any of the keys."""
    with _lock:
        return not any(key in reserved for key in keys)


def release(keys: Keys) -> None:
    """Release the keys of :func:`reserve`, except later reserved ones; may be called again."""
    with _lock:
        for key in keys:
            if reserved.get(key) is keys:  # not reserved by a later output
                del reserved[key]


def server_key(host: str, port: int) -> tuple[str, int]:
    """Normalised host and port of a server, for :func:`reserve`."""
    return computer(host), port


def computer(host: str) -> str:
    """Normalise a host: "this computer" for localhost and all addresses of this computer, else the
    IP address (IPv4 for mapped IPv6), or the name in lower case, not resolved."""
    name = host.strip().rstrip(".").lower()
    try:
        address = ipaddress.ip_address("127.0.0.1" if name == "localhost" else name)
    except ValueError:
        return name
    # ::ffff:127.0.0.1 is 127.0.0.1.
    address = getattr(address, "ipv4_mapped", None) or address
    if address.is_loopback or address.is_unspecified:
        return "this computer"
    # Only an address of this computer can be bound; binding sends nothing.
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.bind((str(address), 0))
        return "this computer"
    return str(address)
