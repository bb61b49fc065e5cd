# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON from strangers: read strictly, and every fault named with its place in the file."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NoReturn

from ..errors import InputError, refuse_no_file

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 16
MAX_KEYS: Final = 100_000
MAX_S: Final = 86_400.0
"""Latest time of a curve, seconds: a day."""
_SHOWN = 60  # characters of a value that a message repeats
_STRINGS = re.compile(r'"(?:[^"\\]|\\.)*"?', re.DOTALL)


@dataclass(frozen=True)
class Node:
    """Value of a JSON document with its place in the file."""

    value: Any
    file: str
    path: str = ""

    def fail(self, allowed: str) -> NoReturn:
        """Raise an ``InputError`` with file, place, found value and allowed values."""
        found = json.dumps(self.value, ensure_ascii=True)
        if len(found) > _SHOWN:
            found = found[:_SHOWN] + "..."
        where = self.path or "the document"
        raise InputError(f"{self.file}: {where} is {found}, allowed is {allowed}.")

    def member(self, key: str) -> Node:
        """Get a member of an object that is known to have it."""
        path = f"{self.path}.{key}" if self.path else key
        return Node(self.value[key], self.file, path)

    def members(self, required: Collection[str], optional: Collection[str] = ()) -> dict[str, Node]:
        """Get the members of an object that has all required keys and no unknown ones."""
        children = self.entries(allowed="an object")
        place = f"{self.path}: " if self.path else ""
        for key in required:
            if key not in children:
                raise InputError(f"{self.file}: {place}'{key}' is missing.")
        for key in children:
            if key not in required and key not in optional:
                known = ", ".join([*required, *optional])
                raise InputError(
                    f"{self.file}: {place}'{key[:_SHOWN]}' is unknown, allowed are: {known}."
                )
        return children

    def entries(self, *, allowed: str, least: int = 0) -> dict[str, Node]:
        """The members of an object with free keys."""
        if not isinstance(self.value, dict) or len(self.value) < least:
            self.fail(allowed)
        return {key: self.member(key) for key in self.value}

    def items(self, *, least: int, most: int) -> list[Node]:
        """The items of a list of bounded length."""
        if not isinstance(self.value, list) or not least <= len(self.value) <= most:
            self.fail(f"a list of {least} to {most} items" if least != most else f"{most} items")
        return [Node(item, self.file, f"{self.path}[{i}]") for i, item in enumerate(self.value)]

    def triple(self, least: float, most: float, unit: str = "") -> tuple[float, float, float]:
        """Get three numbers, each in the same range."""
        x, y, z = (item.number(least, most, unit) for item in self.items(least=3, most=3))
        return x, y, z

    def curve(
        self, *, least: int = 1, earliest_s: float = 0.0, lowest: float = 0.0, highest: float = 1.0
    ) -> tuple[tuple[float, float], ...]:
        """Get pairs of seconds, which never fall, and values in a range."""
        found: list[tuple[float, float]] = []
        for item in self.items(least=least, most=MAX_KEYS):
            time, value = item.items(least=2, most=2)
            last = found[-1][0] if found else earliest_s
            found.append((time.number(last, MAX_S, "s"), value.number(lowest, highest)))
        return tuple(found)

    def text(self, pattern: str = r"[^\x00-\x1f\x7f]{1,400}", described: str = "") -> str:
        """Get a string that a pattern matches as a whole."""
        if not isinstance(self.value, str) or not re.fullmatch(pattern, self.value):
            self.fail(described or "text of 1 to 400 printable characters")
        return self.value

    def choice(self, allowed: Collection[str]) -> str:
        """Get one of the allowed strings."""
        if not isinstance(self.value, str) or self.value not in allowed:
            self.fail("one of " + ", ".join(allowed))
        return self.value

    def boolean(self) -> bool:
        """Get true or false."""
        if not isinstance(self.value, bool):
            self.fail("true or false")
        return bool(self.value)

    def number(self, minimum: float, maximum: float, unit: str = "") -> float:
        """A finite number in a range, both ends included."""
        # bool is an int in Python, and a true amplitude would be full power.
        is_number = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        if not is_number or not minimum <= self.value <= maximum:
            self.fail(f"a number from {minimum:g} to {maximum:g} {unit}".rstrip())
        return float(self.value)

    def integer(self, minimum: int, maximum: int) -> int:
        """A whole number, written without a decimal point, in a range."""
        is_whole = isinstance(self.value, int) and not isinstance(self.value, bool)
        if not is_whole or not minimum <= self.value <= maximum:
            self.fail(f"a whole number from {minimum} to {maximum}")
        return int(self.value)


def read(path: Path, most_bytes: int = MAX_BYTES) -> Node:
    """Read a JSON document.

    Raises
    ------
    InputError
        It cannot be read, is larger than ``most_bytes`` or deeper than ``MAX_DEPTH``, is not
        UTF-8, is not JSON, repeats a key in an object or holds a number that is not finite.
    """
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    return parse(content, str(path), most_bytes)


def parse(content: bytes, name: str, most_bytes: int = MAX_BYTES) -> Node:
    """:func:`read` for bytes that are no file; messages call them by ``name``."""
    if len(content) > most_bytes:
        raise InputError(f"{name}: is larger than {most_bytes} bytes, the most that is allowed.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: byte {error.start} is not UTF-8.") from None
    if _depth(text) > MAX_DEPTH:
        raise InputError(f"{name}: is nested deeper than {MAX_DEPTH}, the most that is allowed.")
    try:
        value = json.loads(text, **_MARKING)
    except ValueError as error:
        raise InputError(f"{name}: is not valid JSON ({error}).") from None
    document = Node(value, name)
    _refuse_marked(document)
    return document


def _refuse_marked(node: Node) -> None:
    """Raise for the first value that is marked as a fault: only now its place is known."""
    value, where = node.value, node.path or "the document"
    if isinstance(value, _Fault):
        raise InputError(f"{node.file}: {where}: {value.described}.")
    if isinstance(value, dict):
        for each in node.entries(allowed="an object").values():
            _refuse_marked(each)
    elif isinstance(value, list):
        for each in node.items(least=0, most=len(value)):
            _refuse_marked(each)


@dataclass(frozen=True)
class _Fault:
    """Placeholder of invalid JSON, until its place is known."""

    described: str


def _depth(text: str) -> int:
    """Deepest nesting, counted before the recursive parser sees the text."""
    depth = deepest = 0
    for character in _STRINGS.sub("", text):
        if character in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif character in "]}":
            depth -= 1
    return deepest


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        counts = Counter(key for key, _ in pairs)
        twice = next(key for key, _ in pairs if counts[key] > 1)
        raise ValueError(f"the key '{twice[:_SHOWN]}' is there twice in one object")
    return found


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:_SHOWN]} is not finite")
    return value


def _whole(text: str) -> int:
    if len(text) > 20:
        raise ValueError(f"the number {text[:20]}... is too long")
    return int(text)


def _marked(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def found(content: Any) -> Any:
        try:
            return read(content)
        except ValueError as error:
            return _Fault(str(error))

    return found


STRICT: Final[dict[str, Any]] = {
    "object_pairs_hook": _object,
    "parse_float": _finite,
    "parse_int": _whole,
    "parse_constant": _finite,
}
"""Arguments of ``json.loads``: no key twice, no number that is endless, too long or none."""

_MARKING: Final[dict[str, Any]] = {key: _marked(read) for key, read in STRICT.items()}
