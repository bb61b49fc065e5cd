# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF as JSON text, piece by piece: a long file is never in memory as a whole."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, BinaryIO, Final

from .document import MEMBERS, Hjif, Keyframe

_PIECE: Final = 1 << 16  # characters, about
_as_text: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":")).encode


def encode(document: Hjif) -> bytes:
    """A document as the bytes of a file; the same bytes for the same content."""
    return b"".join(_pieces(document))


def write(document: Hjif, file: BinaryIO) -> None:
    """Write the text of :func:`encode`."""
    file.writelines(_pieces(document))


def _pieces(document: Hjif) -> Iterator[bytes]:
    waiting: list[str] = []
    length = 0
    for text in _texts(document):
        waiting.append(text)
        length += len(text)
        if length >= _PIECE:
            yield "".join(waiting).encode()
            waiting, length = [], 0
    waiting.append("\n")
    yield "".join(waiting).encode()


def _texts(item: Any) -> Iterator[str]:
    if isinstance(item, tuple):
        if item and type(item[0]) is Keyframe:
            for first in range(0, len(item), _PIECE // 64):
                yield "," if first else "["
                yield ",".join(map(_keyframe, item[first : first + _PIECE // 64]))
        elif item and type(item[0]) in MEMBERS:
            for k, each in enumerate(item):
                yield "," if k else "["
                yield from _texts(each)
        else:
            yield _as_text(item)[:-1]
        yield "]"
    elif type(item) in MEMBERS:
        before = "{"
        for name in MEMBERS[type(item)]:
            value = getattr(item, name)
            if value is not None:
                yield f'{before}"{name}":'
                yield from _texts(value)
                before = ","
        yield "}" if before == "," else "{}"
    else:
        yield _as_text(item)


def _keyframe(frame: Keyframe) -> str:
    """Encode a keyframe, quickly, as they are most of a file: its members are known to be
    numbers.
    """
    members = []
    if frame.relative_position is not None:
        members.append(f'"relative_position":{_number(frame.relative_position)}')
    if frame.amplitude_modulation is not None:
        members.append(f'"amplitude_modulation":{_number(frame.amplitude_modulation)}')
    if frame.frequency_modulation is not None:
        members.append(f'"frequency_modulation":{_number(frame.frequency_modulation)}')
    return f"{{{','.join(members)}}}"


def _number(value: float) -> str:
    # As json writes them; a number of another kind, such as one of numpy's, is a fault.
    return int.__repr__(value) if type(value) is int else float.__repr__(value)
