# SPDX-License-Identifier: GPL-3.0-or-later
"""Strict JSON parsing with limits, bounded file reading, and deterministic JSON encoding."""

import json
import math
import mmap
import os
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from ..errors import InputError, refuse_no_file
from . import limits

MAX_BYTES: Final = 64 << 20
SHOWN: Final = 60
"""Largest number of characters of a value in a message."""
_READ_BYTES: Final = 1 << 20
_STRINGS: Final = re.compile(r'"(?:[^"\\]|\\.)*"?', re.DOTALL)
_BRACKETS: Final = re.compile(r"[\[\]{}]")
_HALF_PAIR: Final = re.compile(r"\\u[dD][89a-fA-F]")

Place = tuple[Any, ...] | None
"""Location in a document as (parent location, key or index); None for the document itself."""


def shown_place(place: Place) -> str:
    """Location as text, such as ``perceptions[0].channels[3].id``; empty for the document."""
    keys: list[str | int] = []
    while place is not None:
        place, key = place
        keys.append(key)
    text = ""
    for key in reversed(keys):
        text += f"[{key}]" if isinstance(key, int) else f".{key[:SHOWN]}" if text else key
    return text


def parse(
    content: bytes,
    name: str,
    most_bytes: int | None = None,
    most_depth: int | None = None,
    *,
    has_file_names: bool = False,
) -> Any:
    """Parse JSON bytes with finite numbers and unique keys; a byte order mark is allowed.

    ``name`` stands for the file in messages. The size limit is :data:`MAX_BYTES` by default, the
    nesting limit that of Python's parser. ``has_file_names`` allows unpaired surrogates, Python's
    form of file names that are not UTF-8. Raises InputError for a document beyond a limit, no
    UTF-8, no JSON, a repeated key, a number that is not finite or has more than 20 digits, or an
    unpaired surrogate.
    """
    if len(content) > (most_bytes := most_bytes or MAX_BYTES):
        raise InputError(f"{name}: is larger than {most_bytes >> 20} MiB, the most that is read.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: byte {error.start} is not UTF-8.") from None
    if most_depth is not None:
        # Brackets outside strings are counted before the recursive parser runs.
        depth = 0
        for bracket in _BRACKETS.findall(_STRINGS.sub("", text)):
            depth += 1 if bracket in "[{" else -1
            if depth > most_depth:
                raise InputError(
                    f"{name}: is nested deeper than {most_depth}, the most that is allowed."
                )
    try:
        value = json.loads(text, **_STRICT)
        # json.loads accepts half a surrogate pair; its encoding fails.
        if not has_file_names and _HALF_PAIR.search(text):
            encoded(value)
        return value
    except UnicodeEncodeError:
        raise InputError(f"{name}: has half of a surrogate pair, which is no character.") from None
    except RecursionError:
        raise InputError(f"{name}: is nested too deeply.") from None
    # The parser's hooks know no place: the text is parsed again to find it.
    except ValueError as error:
        raise InputError(
            f"{name}: {_located(text) or f'the content is not valid JSON ({error})'}."
        ) from None


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Read a regular file of at most ``most`` bytes; raise InputError for any other path."""
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            parts, size = [], 0
            # In chunks: one large read would allocate the largest allowed size.
            while size <= most and (part := file.read(_READ_BYTES)):
                parts.append(part)
                size += len(part)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    if size > most:
        raise InputError(f"{path}: is larger than {most >> 20} MiB, the most that is read.")
    return b"".join(parts)


def read_data(path: Path) -> bytes:
    """Read a regular file within the limit :data:`.limits.MEMORY`; raise InputError for others."""
    refuse_no_file(path)
    limits.MEMORY.check(path.stat().st_size, str(path), "it has")
    return read_bytes(path, int(limits.MEMORY.allowed))


def mapped_data(path: Path) -> bytes:
    """Map a regular file within the limit :data:`.limits.MEMORY`; raise InputError for others."""
    refuse_no_file(path)
    limits.MEMORY.check(path.stat().st_size, str(path), "it has")
    return mapped(path)


def mapped(path: Path) -> bytes:
    """Map a regular file of any size into memory; InputError for an unreadable path."""
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            # An empty file cannot be mapped.
            if not os.fstat(file.fileno()).st_size:
                return b""
            content: Any = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            return content  # type: ignore[no-any-return]  # slices of a map are bytes
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error


def encoded(document: Any) -> bytes:
    """Encode a document as compact JSON with a final line end; equal documents give equal bytes."""
    return (json.dumps(document, ensure_ascii=False, separators=(",", ":")) + "\n").encode()


def clean(name: str) -> str:
    """Replace characters of a name that UTF-8 cannot encode (names in Blender may be broken)."""
    return name.encode("utf-8", "replace").decode()


def shown(value: Any) -> str:
    """Encode a value as JSON for a message, cut after :data:`SHOWN` characters."""
    text = ""
    for part in json.JSONEncoder().iterencode(value):
        text += part
        if len(text) > SHOWN:  # the rest of a large document is not encoded
            return text[:SHOWN] + "..."
    return text


@dataclass(frozen=True)
class _Fault:
    """Placeholder of a forbidden value until its location is known."""

    described: str


def _located(text: str) -> str:
    """Location and description of the first forbidden number or object; empty for no such fault.
    Parses the text again with placeholders: a hook of the parser has no location."""
    try:
        waiting: list[tuple[Any, Place]] = [(json.loads(text, **_MARKING), None)]
    except (ValueError, RecursionError):
        return ""
    while waiting:
        value, location = waiting.pop()
        if isinstance(value, _Fault):
            return f"{shown_place(location) or 'the document'}: {value.described}"
        if isinstance(value, dict | list):
            members = value.items() if isinstance(value, dict) else enumerate(value)
            # The last entry is taken next: reversed, so that the first fault of the file is named.
            waiting += [(item, (location, key)) for key, item in reversed(list(members))]
    return ""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Object of members in file order; ValueError for a repeated key."""
    members = dict(pairs)
    if len(members) != len(pairs):
        counts = Counter(key for key, _ in pairs)
        twice = next(key for key, _ in pairs if counts[key] > 1)
        raise ValueError(f"the key '{twice[:SHOWN]}' is there twice in one object")
    return members


# Numbers of large files repeat (weights of four digits, vertex ids): a lookup takes a third of the
# time of a hook in Python.
@lru_cache(1 << 16)
def _finite(text: str) -> float:
    """Number of a text; ValueError for NaN, infinity and overflow."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:SHOWN]} is not finite")
    return value


@lru_cache(1 << 16)
def _whole(text: str) -> int:
    """Whole number of a text; ValueError above 20 characters, as int() takes quadratic time."""
    if len(text) > 20:
        raise ValueError(f"the number {text[:20]}... is too long")
    return int(text)


def _marked(hook: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Wrap a hook: return a placeholder instead of raising ValueError."""

    def marking(content: Any) -> Any:
        try:
            return hook(content)
        except ValueError as error:
            return _Fault(str(error))

    return marking


_STRICT: Final[dict[str, Any]] = {
    "object_pairs_hook": _object,
    "parse_float": _finite,
    "parse_int": _whole,
    "parse_constant": _finite,
}
"""Arguments of ``json.loads`` for rejecting repeated keys, NaN, infinity and too long numbers."""

_MARKING: Final[dict[str, Any]] = {key: _marked(hook) for key, hook in _STRICT.items()}
