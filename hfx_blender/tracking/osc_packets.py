# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoding of OSC 1.0 datagrams with bounds on size, depth and number of messages.

Format: https://opensoundcontrol.stanford.edu/spec-1_0.html. Argument types are i, f, s, b, T, F, d
and h. Time tags of bundles are ignored: every message is for now.
"""

import struct
from collections.abc import Callable
from typing import Final, NamedTuple

MAX_DATAGRAM: Final = 16384
MAX_MESSAGES: Final = 256  # of a datagram
MAX_DEPTH: Final = 4  # of bundles within bundles
_MAX_ARGUMENTS: Final = 32

_BUNDLE: Final = b"#bundle\0"
_HEAD: Final = len(_BUNDLE) + 8  # the time tag has 8 bytes
_PATTERNS: Final = frozenset(b" #*,?[]{}")  # characters of patterns; no method has these in OSC 1.0
_NUMBERS: Final = {
    ord("i"): struct.Struct(">i"),
    ord("f"): struct.Struct(">f"),
    ord("d"): struct.Struct(">d"),
    ord("h"): struct.Struct(">q"),
}
_INT: Final = _NUMBERS[ord("i")]

Argument = int | float | str | bytes | bool


class OscMessage(NamedTuple):
    """Address, as ``/VMC/Ext/T``, and arguments; numbers may be NaN or infinite."""

    address: str
    arguments: tuple[Argument, ...]


class Decoded(NamedTuple):
    """Valid messages of a datagram in order, and the number of ignored elements."""

    messages: list[OscMessage]
    ignored: int


def decode(datagram: bytes, is_used: Callable[[str], bool] | None = None) -> Decoded:
    """Decode a message or a bundle; never raises.

    An invalid message counts as ignored; further messages of the bundle stay. After an invalid
    size the rest of the bundle is ignored. Datagrams of more than 16384 bytes, messages after the
    256th and bundles below the fourth level are ignored. Messages with
    characters of patterns (``*?[]{}``, comma, space, ``#``) in the address are ignored.

    ``is_used``: test of an address; messages of unused addresses are skipped without decoding of
    their arguments and are not counted.
    """
    messages: list[OscMessage] = []
    if len(datagram) > MAX_DATAGRAM:
        return Decoded(messages, 1)
    ignored, seen = 0, 0
    # Elements of an outer bundle that follow an inner one wait on the stack: begin, end, depth.
    waiting = [(0, len(datagram), 0)]
    while waiting:
        begin, end, depth = waiting.pop()
        if not datagram.startswith(_BUNDLE, begin, end):
            if (seen := seen + 1) > MAX_MESSAGES:
                return Decoded(messages, ignored + 1)
            message = _message(datagram, begin, end, is_used)
            if isinstance(message, OscMessage):
                messages.append(message)
            else:
                ignored += message
            continue
        elements = _elements(datagram, begin + _HEAD, end)
        if elements is None or depth >= MAX_DEPTH:
            ignored += 1
            continue
        waiting += [(first, last, depth + 1) for first, last in reversed(elements)]
        ignored += (elements[-1][1] if elements else begin + _HEAD) != end
    return Decoded(messages, ignored)


def _elements(datagram: bytes, position: int, end: int) -> list[tuple[int, int]] | None:
    """Begin and end of each element of a bundle up to the first invalid size; None for a bundle
    without a complete head."""
    if position > end:
        return None
    elements: list[tuple[int, int]] = []
    while position + 4 <= end and len(elements) <= MAX_MESSAGES:
        (size,) = _INT.unpack_from(datagram, position)
        if size <= 0 or size % 4 or position + 4 + size > end:
            break
        elements.append((position + 4, position + 4 + size))
        position += 4 + size
    return elements


def _message(
    datagram: bytes, begin: int, end: int, is_used: Callable[[str], bool] | None
) -> OscMessage | int:
    """Message between two positions; 0 for an unused address, 1 for an invalid message."""
    try:
        address, position = _text(datagram, begin, end)
        if address[:1] != b"/" or not _PATTERNS.isdisjoint(address):
            return 1
        name = address.decode()
        if is_used is not None and not is_used(name):
            return 0
        types, position = _text(datagram, position, end)
        if types[:1] != b"," or len(types) > _MAX_ARGUMENTS + 1:
            return 1
        arguments: list[Argument] = []
        for kind in types[1:]:
            number = _NUMBERS.get(kind)
            if number is not None:
                if position + number.size > end:
                    return 1
                arguments += number.unpack_from(datagram, position)
                position += number.size
            elif kind == ord("s"):
                text, position = _text(datagram, position, end)
                arguments.append(text.decode())
            elif kind == ord("b"):
                (size,) = _INT.unpack_from(datagram, position)
                position += 4
                if size < 0 or position + size > end:
                    return 1
                arguments.append(datagram[position : position + size])
                position += -(-size // 4) * 4
            elif kind in b"TF":
                arguments.append(kind == ord("T"))
            else:
                return 1
    except (ValueError, struct.error):  # also UnicodeDecodeError
        return 1
    return OscMessage(name, tuple(arguments)) if position == end else 1


def _text(datagram: bytes, begin: int, end: int) -> tuple[bytes, int]:
    """Text up to its zero byte, and the position after its padding to 4 bytes; ValueError for a
    text without an end."""
    zero = datagram.index(b"\0", begin, end)
    position = begin + (zero - begin) // 4 * 4 + 4
    if position > end:
        raise ValueError("padding is missing")
    return datagram[begin:zero], position
