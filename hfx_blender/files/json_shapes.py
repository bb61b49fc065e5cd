# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes of JSON documents from strangers: faults with their place, and stable codes.

A shape declares a value: its type, range with unit, allowed texts, members. The same shape gives
:func:`check` its findings, readers their documents (:meth:`Node.hold`), and editors a JSON Schema
(``hfx_tools/json_schema.py``). Every fault is a :class:`Finding`; its code is the format's name and
a word that scripts can rely on::

    SPOT = Record({"radius_m": Number(0.0, 1.0, "m")}, {"side": Text(("left", "right"))})
    spot = read(path).read(SPOT)  # {"radius_m": 0.03}, or what SPOT's ``into`` makes of it
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, NoReturn

from ..errors import InputError
from .findings import Finding, Report, sentence
from .strict_json import SHOWN, Place, parse, read_bytes, shown_place

MAX_OWN_BYTES: Final = 1 << 20
"""Largest file of this program's own kinds, bytes, where a reader does not name another size."""
MAX_OWN_DEPTH: Final = 16
"""Deepest nesting of this program's own kinds."""


@dataclass(frozen=True)
class Number:
    """A finite number in a range, both ends included."""

    lowest: float = -math.inf
    highest: float = math.inf
    unit: str = ""
    is_whole: bool = False  # written without a decimal point
    smallest: float = 0.0  # of its size: numbers nearer to 0 are not allowed
    choices: tuple[int, ...] = ()
    may_be_text: bool = False
    note: str = ""  # for messages, in place of the range

    @property
    def allowed(self) -> str:
        """Text for messages that names the allowed values: "0 to 1", "one of a, b"."""
        if self.note or self.choices:
            return self.note or "one of " + ", ".join(map(str, self.choices))
        if self.lowest == self.highest:
            return f"{self.lowest:.10g}"
        kind = "a whole number" if self.is_whole else "a number"
        if self.lowest == -math.inf:
            return kind
        if self.highest == math.inf:
            return f"{kind} of {self.lowest:.10g} or more"
        least = self.smallest or self.lowest
        ends = f"{least:.10g} to {self.highest:.10g} {self.unit}".rstrip()
        return f"{kind} from {ends}" + (", or its negative" if self.smallest else "")


@dataclass(frozen=True)
class Text:
    """A string: any, one of some, or one that a pattern matches as a whole."""

    choices: tuple[str, ...] = ()
    pattern: str = ""
    note: str = ""  # what the pattern matches, for messages
    code: str = "CHOICE"

    @property
    def allowed(self) -> str:
        """Text for messages that names the allowed values: "0 to 1", "one of a, b"."""
        if self.note:
            return self.note
        if self.choices:
            return "one of " + ", ".join(self.choices)
        return f"text of the form {self.pattern}" if self.pattern else "text"


PRINTABLE: Final = Text(
    pattern=r"[^\x00-\x1f\x7f]{1,400}", note="text of 1 to 400 printable characters"
)
SHA256: Final = Text(pattern=r"[0-9a-f]{64}", note="a SHA-256 as 64 hexadecimal digits")


@dataclass(frozen=True)
class Flag:
    """True or false, or only one of them."""

    only: bool | None = None
    note: str = "true or false"


@dataclass(frozen=True)
class Anything:
    """Any value."""


@dataclass(frozen=True)
class Items:
    """A list of items of one shape; an order is that of the items, or of their first items."""

    item: Shape
    least: int = 0
    most: int | None = None
    order: Literal["any", "unique", "ascending", "never falling"] = "any"

    @property
    def allowed(self) -> str:
        """Text for messages that names the allowed values: "0 to 1", "one of a, b"."""
        if self.most is None:
            return f"a list of {self.least} or more items" if self.least else "a list"
        if self.least == self.most:
            return f"{self.most} items"
        return f"a list of {self.least} to {self.most} items"


@dataclass(frozen=True)
class Row:
    """A list of a fixed number of items, each of its own shape."""

    items: tuple[Shape, ...]


@dataclass(frozen=True)
class Record:
    """An object with known members."""

    required: Mapping[str, Shape] = field(default_factory=dict)
    optional: Mapping[str, Shape] = field(default_factory=dict)
    unknown: Literal["error", "warning", "ignore"] = "warning"
    one_of: tuple[str, ...] = ()  # optional members of which exactly one is there
    needs: Mapping[str, str] = field(default_factory=dict)  # members that others go with
    title: str = "an object"  # for messages
    into: Callable[..., Any] = dict  # called with the members that are there, by their names


@dataclass(frozen=True)
class Table:
    """An object with free keys."""

    item: Shape
    least: int = 0
    key: Text = Text()
    title: str = "an object"  # for messages


@dataclass(frozen=True)
class Tagged:
    """An object of one of several kinds, which a text in it names.

    ``tag`` is the text's place, such as ``kind`` or ``encoder.kind``.
    """

    tag: str
    kinds: Mapping[str, Shape]


@dataclass(frozen=True)
class Either:
    """An object of one of two shapes, told by the presence of a member."""

    member: str
    present: Record
    absent: Record


Shape = Number | Text | Flag | Anything | Items | Row | Record | Table | Tagged | Either


def strict(
    required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None, **more: Any
) -> Record:
    """A record of this program's own kinds: unknown members are errors."""
    return Record(required, optional or {}, unknown="error", **more)


def loose(
    required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None, **more: Any
) -> Record:
    """A record of which only some members matter: others may be there."""
    return Record(required, optional or {}, unknown="ignore", **more)


def tagged(tag: str, kinds: Mapping[str, Record]) -> Tagged:
    """Kinds of an object whose member ``tag`` names its kind; the records are without the tag."""
    return Tagged(
        tag,
        {
            name: replace(kind, required={tag: Text((name,)), **kind.required})
            for name, kind in kinds.items()
        },
    )


def numbers(count: int, lowest: float, highest: float, unit: str = "") -> Row:
    """A list of a fixed number of numbers in one range."""
    return Row((Number(lowest, highest, unit),) * count)


def curve(
    *, least: int = 1, earliest_s: float = 0.0, lowest: float = 0.0, highest: float = 1.0
) -> Items:
    """Pairs of seconds, which never fall and last a day at most, and values in a range."""
    pair = Row((Number(earliest_s, 86_400.0, "s"), Number(lowest, highest)))
    return Items(pair, least, 100_000, order="never falling")


def check(shape: Shape, value: Any, report: Report, place: Place = None) -> None:
    """Hold a value against a shape; every fault is reported."""
    match shape:
        case Record():
            _check_record(shape, value, report, place)
        case Items() | Row():
            _check_list(shape, value, report, place)
        case Table():
            _check_table(shape, value, report, place)
        case Number():
            _check_number(shape, value, report, place)
        case Text():
            _check_text(shape, value, report, place)
        case Flag():
            if not isinstance(value, bool) or (shape.only is not None and value != shape.only):
                report.error("TYPE", place, _found(value, shape.note))
        case Tagged() | Either():
            found = chosen(shape, value)
            if found is None:
                check(_tag_only(shape), value, report, place)
            else:
                check(found, value, report, place)


def chosen(shape: Tagged | Either, value: Any) -> Shape | None:
    """The shape that a value of several kinds has to have; None where its tag is none of them."""
    if isinstance(shape, Either):
        has_member = isinstance(value, dict) and shape.member in value
        return shape.present if has_member else shape.absent
    for key in shape.tag.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return shape.kinds.get(value) if isinstance(value, str) else None


def _tag_only(shape: Tagged | Either) -> Shape:
    """Shape of an object of which only the tag is known."""
    assert isinstance(shape, Tagged)
    found: Shape = Text(tuple(shape.kinds))
    for key in reversed(shape.tag.split(".")):
        found = Record({key: found}, unknown="ignore")
    return found


def known_members(shape: Shape, value: Any) -> Any:
    """A document without the members that its shape does not know.

    Readers get this one: a member that is only unknown where it stands was never checked.
    """
    if isinstance(shape, Record) and isinstance(value, dict):
        members = {**shape.required, **shape.optional}
        return {k: known_members(members[k], item) for k, item in value.items() if k in members}
    if isinstance(shape, Table) and isinstance(value, dict):
        return {key: known_members(shape.item, item) for key, item in value.items()}
    if isinstance(shape, Items) and isinstance(value, list):
        return [known_members(shape.item, item) for item in value]
    return value


def value_of(shape: Shape, value: Any) -> Any:
    """A value that has a shape, as readers use it.

    Numbers that may have a decimal point are floats, lists are tuples, and records are what their
    ``into`` makes of the members that they know.
    """
    match shape:
        case Number():
            return value if shape.is_whole else float(value)
        case Items():
            return tuple(value_of(shape.item, item) for item in value)
        case Row():
            return tuple(map(value_of, shape.items, value))
        case Table():
            return {key: value_of(shape.item, item) for key, item in value.items()}
        case Record():
            members = {**shape.required, **shape.optional}
            known = {k: value_of(members[k], v) for k, v in value.items() if k in members}
            return shape.into(**known)
        case Tagged() | Either():
            kind = chosen(shape, value)
            assert kind is not None, "a value that has its shape"
            return value_of(kind, value)
        case _:
            return value


def _check_record(shape: Record, value: Any, report: Report, place: Place) -> None:
    if not isinstance(value, dict):
        report.error("TYPE", place, _found(value, shape.title))
        return
    for key in shape.required:
        if key not in value:
            report.error("MISSING", place, f"'{key}' is missing")
    for key, item in value.items():
        member = shape.required.get(key) or shape.optional.get(key)
        if member is not None:
            check(member, item, report, (place, key))
        elif shape.unknown == "error":
            allowed = ", ".join([*shape.required, *shape.optional])
            report.error("UNKNOWN", place, f"'{key[:SHOWN]}' is unknown, allowed are: {allowed}")
        elif shape.unknown == "warning":
            report.warn("UNKNOWN", place, f"'{key[:SHOWN]}' is unknown")
    if shape.one_of and sum(key in value for key in shape.one_of) != 1:
        report.error("COUNT", place, _found(value, "exactly one of " + ", ".join(shape.one_of)))
    for key, other in shape.needs.items():
        if key in value and value.get(other, False) is False:
            must = f'"{other}"' + (": true" if isinstance(shape.optional[other], Flag) else "")
            report.error("MISSING", (place, key), _found(value[key], f"left out: it needs {must}"))


def _check_list(shape: Items | Row, value: Any, report: Report, place: Place) -> None:
    if isinstance(shape, Row):
        count = len(shape.items)
        if not isinstance(value, list) or len(value) != count:
            report.error("TYPE", place, _found(value, f"{count} items"))
            return
        for k, (member, item) in enumerate(zip(shape.items, value, strict=True)):
            check(member, item, report, (place, k))
        return
    if not isinstance(value, list):
        report.error("TYPE", place, _found(value, shape.allowed))
        return
    if len(value) < shape.least or (shape.most is not None and len(value) > shape.most):
        report.error("COUNT", place, _found(value, shape.allowed))
    before = report.count
    for k, item in enumerate(value):
        check(shape.item, item, report, (place, k))
    if shape.order != "any" and report.count == before:
        _check_order(shape, value, report, place)


def _check_order(shape: Items, value: list[Any], report: Report, place: Place) -> None:
    if shape.order == "unique":
        if len({json.dumps(item, sort_keys=True) for item in value}) != len(value):
            report.error("ORDER", place, _found(value, "each item once"))
        return
    firsts = [item[0] if isinstance(item, list) else item for item in value]
    for k in range(1, len(firsts)):
        is_above = firsts[k] > firsts[k - 1]
        if not is_above and (shape.order == "ascending" or firsts[k] < firsts[k - 1]):
            inner = (place, k) if firsts[k] is value[k] else ((place, k), 0)
            least = "above" if shape.order == "ascending" else "not below"
            allowed = f"a number {least} {firsts[k - 1]:.10g}, as they are in ascending order"
            report.error("ORDER", inner, _found(firsts[k], allowed))
            return


def _check_table(shape: Table, value: Any, report: Report, place: Place) -> None:
    if not isinstance(value, dict) or len(value) < shape.least:
        report.error("TYPE", place, _found(value, shape.title))
        return
    for key, item in value.items():
        if shape.key.pattern and not re.fullmatch(shape.key.pattern, key):
            report.error("CHOICE", (place, key), f"the name {_found(key, shape.key.allowed)}")
        check(shape.item, item, report, (place, key))


def _check_number(shape: Number, value: Any, report: Report, place: Place) -> None:
    if shape.may_be_text and isinstance(value, str):
        number = _number_of(value)
        if number is None:
            report.error("TYPE", place, _found(value, shape.allowed))
            return
        value = number
    # bool is an int in Python, and a true amplitude would be full power.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or (shape.is_whole and not isinstance(value, int)):
        report.error("TYPE", place, _found(value, shape.allowed))
        return
    is_in_range = shape.lowest <= value <= shape.highest and abs(value) >= shape.smallest
    if not is_in_range or (shape.choices and value not in shape.choices):
        report.error("RANGE", place, _found(value, shape.allowed))


def _number_of(text: str) -> float | None:
    """Number that a text holds; None for another text, infinities and what is no number."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _check_text(shape: Text, value: Any, report: Report, place: Place) -> None:
    if not isinstance(value, str):
        report.error("TYPE", place, _found(value, shape.allowed))
    elif (shape.choices and value not in shape.choices) or (
        shape.pattern and not re.fullmatch(shape.pattern, value)
    ):
        report.error(shape.code, place, _found(value, shape.allowed))


def _found(value: Any, allowed: str) -> str:
    return f"is {shown(value)}, allowed is {allowed}"


def shown(value: Any) -> str:
    """Begin of a value as JSON, as a message repeats it."""
    text = ""
    for part in json.JSONEncoder().iterencode(value):
        text += part
        if len(text) > SHOWN:  # a document may be large: the rest of it is not encoded
            return text[:SHOWN] + "..."
    return text


@dataclass(frozen=True)
class Node:
    """Value of a JSON document with its place in the file."""

    value: Any
    file: str
    place: Place = None

    def hold(self, shape: Shape) -> Node:
        """Refuse a value that has not a shape.

        Raises
        ------
        InputError
            With the first fault: file, place, found value and allowed values.
        """
        report = Report("")
        check(shape, self.value, report, self.place)
        for each in report.findings:
            if each.severity == "error":
                raise InputError(f"{self.file}: {sentence(each)}.")
        return self

    def read(self, shape: Shape) -> Any:
        """Value of a shape, see :func:`value_of`; raises as :meth:`hold`."""
        return value_of(shape, self.hold(shape).value)

    def fail(self, allowed: str) -> NoReturn:
        """Raise an ``InputError`` with file, place, found value and allowed values."""
        finding = Finding("", shown_place(self.place), _found(self.value, allowed))
        raise InputError(f"{self.file}: {sentence(finding)}.")

    @property
    def path(self) -> str:
        """Place as text: ``actuators[1].id``; empty for the document."""
        return shown_place(self.place)

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def __getitem__(self, key: str | int) -> Node:
        return Node(self.value[key], self.file, (self.place, key))

    def items(self) -> Iterable[Node]:
        """The items of a list."""
        return (self[k] for k in range(len(self.value)))

    def members(self) -> dict[str, Node]:
        """The members of an object."""
        return {key: self[key] for key in self.value}

    def get(self, key: str, default: Any = None) -> Any:
        """Value of a member, or a default without it."""
        return self.value.get(key, default)

    def number(self, key: str, default: float | None = None) -> float:
        """Number of a member as float, or a default without it."""
        return float(self.value[key] if default is None else self.value.get(key, default))

    def numbers(self, key: str) -> tuple[float, ...]:
        """List of numbers of a member, as floats."""
        return tuple(map(float, self.value[key]))

    def curve(self, key: str) -> tuple[tuple[float, float], ...]:
        """Pairs of numbers of a member, as floats; none without it."""
        return tuple((float(a), float(b)) for a, b in self.value.get(key, ()))


def read(path: Path, most_bytes: int = MAX_OWN_BYTES) -> Node:
    """Read a JSON document of this program's own kinds.

    Raises
    ------
    InputError
        It cannot be read, is larger than ``most_bytes`` or deeper than ``MAX_OWN_DEPTH``, is not
        UTF-8, is not JSON, repeats a key in an object or holds a number that is not finite.
    """
    return node_of(read_bytes(path, most_bytes), str(path), most_bytes)


def node_of(content: bytes, name: str, most_bytes: int = MAX_OWN_BYTES) -> Node:
    """:func:`read` for bytes that are no file; messages call them by ``name``."""
    document = parse(content, name, most_bytes, MAX_OWN_DEPTH, has_file_names=True)
    return Node(document, name)
