# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes of JSON documents: validation with located findings, reading, and JSON Schema.

A shape declares type, range with unit, allowed texts and members of a value. :func:`check` reports
findings, :meth:`Node.read` returns Python values, and ``hfx_tools/json_schema.py`` writes a JSON
Schema from the same shape. Each :class:`Finding` has a stable code::

    SPOT = Record({"radius_m": Number(0.0, 1.0, "m")}, {"side": Text(("left", "right"))})
    spot = read(path).read(SPOT)  # {"radius_m": 0.03}, or the result of SPOT's ``into``
"""

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, NoReturn

from ..errors import InputError
from .findings import Finding, Report, sentence
from .strict_json import SHOWN, Place, parse, read_bytes, shown, shown_place

MAX_OWN_BYTES: Final = 1 << 20  # default size limit of this program's own files, bytes
MAX_OWN_DEPTH: Final = 16  # nesting limit of this program's own files


@dataclass(frozen=True)
class Number:
    """Finite number in a range, both ends included."""

    lowest: float = -math.inf
    highest: float = math.inf
    unit: str = ""
    is_whole: bool = False  # written without a decimal point
    smallest: float = 0.0  # lowest allowed absolute value
    choices: tuple[int, ...] = ()
    may_be_text: bool = False  # a decimal number in a string is allowed, too
    note: str = ""  # allowed values in messages, instead of the range

    @property
    def allowed(self) -> str:
        """Allowed values for messages: "a number from 0 to 1 m", "one of 8, 16"."""
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
    """String: any, one of ``choices``, or a full match of ``pattern``."""

    choices: tuple[str, ...] = ()
    pattern: str = ""
    note: str = ""  # allowed values in messages, instead of the pattern
    code: str = "CHOICE"  # of the finding

    @property
    def allowed(self) -> str:
        """Allowed values for messages: "one of left, right", "text"."""
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
    """Boolean; with ``only``, that value alone."""

    only: bool | None = None
    note: str = "true or false"


@dataclass(frozen=True)
class Anything:
    """Any value."""


@dataclass(frozen=True)
class Items:
    """List of items of equal shape, with limits on the count and an order. Lists as items are
    ordered by their first items."""

    item: "Shape"
    least: int = 0
    most: int | None = None  # None: no limit
    order: Literal["any", "unique", "ascending", "never falling"] = "any"

    @property
    def allowed(self) -> str:
        """Allowed count for messages: "a list of 1 to 8 items"."""
        if self.most is None:
            return f"a list of {self.least} or more items" if self.least else "a list"
        if self.least == self.most:
            return f"{self.most} items"
        return f"a list of {self.least} to {self.most} items"


@dataclass(frozen=True)
class Row:
    """List of a fixed number of items with separate shapes."""

    items: "tuple[Shape, ...]"


@dataclass(frozen=True)
class Record:
    """Object with required and optional members."""

    required: "Mapping[str, Shape]" = field(default_factory=dict)
    optional: "Mapping[str, Shape]" = field(default_factory=dict)
    unknown: Literal["error", "warning", "ignore"] = "warning"
    one_of: tuple[str, ...] = ()  # optional members, exactly one of which must be present
    needs: Mapping[str, str] = field(default_factory=dict)  # member: required companion
    title: str = "an object"  # for messages
    into: Callable[..., Any] = dict  # called with the present members as keywords


@dataclass(frozen=True)
class Table:
    """Object with free keys and values of equal shape."""

    item: "Shape"
    least: int = 0
    key: Text = Text()
    title: str = "an object"  # for messages


@dataclass(frozen=True)
class Tagged:
    """Object of several possible kinds, chosen by the text at ``tag``, such as ``encoder.kind``."""

    tag: str
    kinds: "Mapping[str, Shape]"


@dataclass(frozen=True)
class Either:
    """Object of two possible shapes, chosen by the presence of ``member``."""

    member: str
    present: Record
    absent: Record


Shape = Number | Text | Flag | Anything | Items | Row | Record | Table | Tagged | Either


def strict(
    required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None, **more: Any
) -> Record:
    """Make a record whose unknown members are errors, for this program's own files."""
    return Record(required, optional or {}, unknown="error", **more)


def loose(
    required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None, **more: Any
) -> Record:
    """Make a record whose unknown members are ignored."""
    return Record(required, optional or {}, unknown="ignore", **more)


def tagged(tag: str, kinds: Mapping[str, Record]) -> Tagged:
    """Make a :class:`Tagged`; ``tag`` is added to the records as a required member."""
    return Tagged(
        tag,
        {
            name: replace(kind, required={tag: Text((name,)), **kind.required})
            for name, kind in kinds.items()
        },
    )


def numbers(count: int, lowest: float, highest: float, unit: str = "") -> Row:
    """Make a row of ``count`` numbers with equal range."""
    return Row((Number(lowest, highest, unit),) * count)


def curve(
    *, least: int = 1, earliest_s: float = 0.0, lowest: float = 0.0, highest: float = 1.0
) -> Items:
    """Make a list of (seconds, value) pairs; times never fall, at most one day."""
    pair = Row((Number(earliest_s, 86_400.0, "s"), Number(lowest, highest)))
    return Items(pair, least, 100_000, order="never falling")


def check(shape: Shape, value: Any, report: Report, place: Place = None) -> None:
    """Validate a value against a shape and add every fault to ``report``."""
    match shape:
        case Record():
            _check_record(shape, value, report, place)
        case Items() | Row():
            _check_list(shape, value, report, place)
        case Table():
            _check_table(shape, value, report, place)
        case Number():
            _check_number(shape, value, report, place)
        case Text() if not isinstance(value, str):
            report.error("TYPE", place, _found(value, shape.allowed))
        case Text():
            is_choice = not shape.choices or value in shape.choices
            if not is_choice or (shape.pattern and not re.fullmatch(shape.pattern, value)):
                report.error(shape.code, place, _found(value, shape.allowed))
        case Flag():
            if not isinstance(value, bool) or (shape.only is not None and value != shape.only):
                report.error("TYPE", place, _found(value, shape.note))
        case Tagged() | Either():
            kind = chosen(shape, value)
            if kind is None:
                # An unknown tag is the only fault: members of an unknown kind cannot be checked.
                assert isinstance(shape, Tagged)
                kind = Text(tuple(shape.kinds))
                for key in reversed(shape.tag.split(".")):
                    kind = Record({key: kind}, unknown="ignore")
            check(kind, value, report, place)


def chosen(shape: Tagged | Either, value: Any) -> Shape | None:
    """Select the shape of a value by tag or member; None for an unknown or missing tag."""
    if isinstance(shape, Either):
        has_member = isinstance(value, dict) and shape.member in value
        return shape.present if has_member else shape.absent
    for key in shape.tag.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return shape.kinds.get(value) if isinstance(value, str) else None


def known_members(shape: Shape, value: Any) -> Any:
    """Copy a document without the members that its shape does not name, at any depth. Nothing is
    checked: a value of another type than its shape is returned unchanged."""
    if isinstance(shape, Record) and isinstance(value, dict):
        members = {**shape.required, **shape.optional}
        return {k: known_members(members[k], item) for k, item in value.items() if k in members}
    if isinstance(shape, Table) and isinstance(value, dict):
        return {key: known_members(shape.item, item) for key, item in value.items()}
    if isinstance(shape, Items) and isinstance(value, list):
        return [known_members(shape.item, item) for item in value]
    return value


def value_of(shape: Shape, value: Any) -> Any:
    """Convert a valid value: numbers to float unless whole, lists to tuples, records by ``into``.
    Unknown members of records are dropped."""
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
            # Absent members keep the defaults of ``into``.
            known = {k: value_of(members[k], v) for k, v in value.items() if k in members}
            return shape.into(**known)
        case Tagged() | Either():
            kind = chosen(shape, value)
            assert kind is not None, "a value that has its shape"
            return value_of(kind, value)
        case _:
            return value


def _check_record(shape: Record, value: Any, report: Report, place: Place) -> None:
    """Report missing and unknown members, the rules between members, and faults of each member."""
    if not isinstance(value, dict):
        report.error("TYPE", place, _found(value, shape.title))
        return
    for key in shape.required:
        if key not in value:
            report.error("MISSING", place, f"'{key}' is missing")
    # Unknown members are reported after missing ones: a misspelt name shows as both.
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
    # A companion that is a flag must be true, any other one present.
    for key, companion in shape.needs.items():
        if key in value and value.get(companion, False) is False:
            must = f'"{companion}"' + (
                ": true" if isinstance(shape.optional[companion], Flag) else ""
            )
            report.error("MISSING", (place, key), _found(value[key], f"left out: it needs {must}"))


def _check_list(shape: Items | Row, value: Any, report: Report, place: Place) -> None:
    """Report a wrong count, faults of each item, or else a wrong order of the items."""
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
    if not (isinstance(shape.item, Number) and _are_all_in_range(shape.item, value)):
        for k, item in enumerate(value):
            check(shape.item, item, report, (place, k))
    # Only items without faults are comparable.
    if shape.order != "any" and report.count == before:
        _check_order(shape, value, report, place)


def _check_order(shape: Items, value: list[Any], report: Report, place: Place) -> None:
    """Report the first item out of ``shape.order``, or that items are equal ("unique")."""
    if shape.order == "unique":
        if len({json.dumps(item, sort_keys=True) for item in value}) != len(value):
            report.error("ORDER", place, _found(value, "each item once"))
        return
    # Pairs (time, value) are ordered by their times.
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
    """Report a value other than an object (TYPE), and faults of each key and value."""
    if not isinstance(value, dict) or len(value) < shape.least:
        report.error("TYPE", place, _found(value, shape.title))
        return
    for key, item in value.items():
        if shape.key.pattern and not re.fullmatch(shape.key.pattern, key):
            report.error("CHOICE", (place, key), f"the name {_found(key, shape.key.allowed)}")
        check(shape.item, item, report, (place, key))


def _check_number(shape: Number, value: Any, report: Report, place: Place) -> None:
    """Report a value other than a number (TYPE), or outside range and choices (RANGE)."""
    if shape.may_be_text and isinstance(value, str):
        text = value
        with suppress(ValueError):
            value = float(text)
        if isinstance(value, str) or not math.isfinite(value):
            report.error("TYPE", place, _found(text, shape.allowed))
            return
    # bool is an int in Python: an amplitude of true would be full power.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or (shape.is_whole and not isinstance(value, int)):
        report.error("TYPE", place, _found(value, shape.allowed))
        return
    is_in_range = shape.lowest <= value <= shape.highest and abs(value) >= shape.smallest
    if not is_in_range or (shape.choices and value not in shape.choices):
        report.error("RANGE", place, _found(value, shape.allowed))


def _are_all_in_range(shape: Number, values: list[Any]) -> bool:
    """Quick test that no value of a list has a fault; False if undecided."""
    allowed = {int} if shape.is_whole else {int, float}
    if shape.smallest or shape.choices or not values or not allowed.issuperset(map(type, values)):
        return False
    if not (shape.lowest <= min(values) and max(values) <= shape.highest):
        return False
    # A NaN may hide from both, but makes the sum NaN.
    return shape.is_whole or not math.isnan(sum(values))


def _found(value: Any, allowed: str) -> str:
    """Message "is <value>, allowed is <allowed>"."""
    return f"is {shown(value)}, allowed is {allowed}"


@dataclass(frozen=True)
class Node:
    """Value of a JSON document with file name and place, for messages."""

    value: Any
    file: str
    place: Place = None

    def hold(self, shape: Shape) -> "Node":
        """Validate the value and return the node; raise InputError for the first error."""
        report = Report("")
        check(shape, self.value, report, self.place)
        for finding in report.findings:
            if finding.severity == "error":
                raise InputError(f"{self.file}: {sentence(finding)}.")
        return self

    def read(self, shape: Shape) -> Any:
        """Validate and convert the value by :func:`value_of`; InputError for the first error."""
        return value_of(shape, self.hold(shape).value)

    def fail(self, allowed: str) -> NoReturn:
        """Raise InputError with file, place, value and the allowed values."""
        finding = Finding("", shown_place(self.place), _found(self.value, allowed))
        raise InputError(f"{self.file}: {sentence(finding)}.")

    @property
    def path(self) -> str:
        """Place as text, such as ``actuators[1].id``; empty for the whole document."""
        return shown_place(self.place)

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def __getitem__(self, key: str | int) -> "Node":
        return Node(self.value[key], self.file, (self.place, key))

    def items(self) -> "Iterable[Node]":
        """Yield the items of a list as nodes."""
        return (self[k] for k in range(len(self.value)))

    def members(self) -> "dict[str, Node]":
        """Nodes of an object's members by name."""
        return {key: self[key] for key in self.value}

    def get(self, key: str, default: Any = None) -> Any:
        """Value of a member, or ``default`` for a missing member."""
        return self.value.get(key, default)

    def number(self, key: str, default: float | None = None) -> float:
        """Member as float; KeyError for a missing member without a default."""
        return float(self.value[key] if default is None else self.value.get(key, default))

    def numbers(self, key: str) -> tuple[float, ...]:
        """Member, a list of numbers, as floats."""
        return tuple(map(float, self.value[key]))

    def curve(self, key: str) -> tuple[tuple[float, float], ...]:
        """Member, a list of number pairs, as floats; empty for a missing member."""
        return tuple((float(a), float(b)) for a, b in self.value.get(key, ()))


def read(path: Path, most_bytes: int = MAX_OWN_BYTES) -> Node:
    """Read a JSON file of this program's own formats. Raises InputError for an unreadable file,
    more than ``most_bytes``, nesting deeper than ``MAX_OWN_DEPTH``, no UTF-8, no JSON, a repeated
    key in an object, or a number that is not finite."""
    return node_of(read_bytes(path, most_bytes), str(path), most_bytes)


def node_of(content: bytes, name: str, most_bytes: int = MAX_OWN_BYTES) -> Node:
    """Parse JSON bytes like :func:`read`; ``name`` stands for the file in messages."""
    document = parse(content, name, most_bytes, MAX_OWN_DEPTH, has_file_names=True)
    return Node(document, name)
