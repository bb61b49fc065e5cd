# SPDX-License-Identifier: GPL-3.0-or-later
"""Reservations of what outputs of this process drive: ports, devices of a server, channels."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterable

from ..output import OutputLostError

Keys = frozenset[Hashable]

_reserved: dict[Hashable, Keys] = {}
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
        if not found.isdisjoint(_reserved):
            raise OutputLostError(f"{name} is open already, for another device.")
        _reserved.update(dict.fromkeys(found, found))
    return found


def are_free(keys: Iterable[Hashable]) -> bool:
    """Test that no output has reserved any of these keys."""
    with _lock:
        return not any(key in _reserved for key in keys)


def release(keys: Keys) -> None:
    """Give keys back; it may be called again."""
    with _lock:
        for key in keys:
            if _reserved.get(key) is keys:  # unless another output has reserved it since
                del _reserved[key]


def server_key(host: str, port: int) -> tuple[str, int]:
    """Key of a server, the same for all names of this computer."""
    host = host.lower()
    return ("127.0.0.1" if host in ("localhost", "::1") else host), port
