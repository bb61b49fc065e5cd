# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of JSON documents from strangers: faults with their place, and stable codes.

A document is checked against a shape (records, lists, numbers, texts). Every fault is a
:class:`Finding`; its code is the format's name and a word that scripts can rely on.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from ..errors import InputError, refuse_no_file
from .strict_json import STRICT

MAX_BYTES: Final = 64 << 20
MAX_FINDINGS: Final = 1000
_READ_BYTES: Final = 1 << 20
_HALF_PAIR: Final = re.compile(r"\\u[dD][89a-fA-F]")
_SHOWN = 60  # characters of a value that a message repeats

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """Fault of a file."""

    code: str
    place: str
    message: str
    severity: Severity = "error"

    def __str__(self) -> str:
        return f"{self.severity} {self.code} {self.place or 'the document'}: {self.message}"


Place = tuple[Any, ...] | None
"""Place in a document: (place of its parent, key or index); None for the document itself."""


def shown_place(place: Place) -> str:
    """``perceptions[0].channels[3].id``."""
    keys: list[str | int] = []
    while place is not None:
        place, key = place
        keys.append(key)
    text = ""
    for each in reversed(keys):
        text += f"[{each}]" if isinstance(each, int) else f".{each[:_SHOWN]}" if text else each
    return text


@dataclass
class Report:
    """Findings about one file, about ``MAX_FINDINGS`` at most.

    The first one of each kind is always kept: a fault is not to hide behind a thousand others
    that a reader copes with.
    """

    prefix: str
    findings: list[Finding] = field(default_factory=list)
    has_errors: bool = False
    count: int = 0  # of all findings, kept or not
    _kinds: set[tuple[str, Severity]] = field(default_factory=set)

    def error(self, code: str, place: Place, message: str) -> None:
        """Report an error."""
        self._add(code, place, message, "error")
        self.has_errors = True

    def warn(self, code: str, place: Place, message: str) -> None:
        """Report something unusual, with which readers cope."""
        self._add(code, place, message, "warning")

    def _add(self, code: str, place: Place, message: str, severity: Severity) -> None:
        self.count += 1
        if len(self.findings) < MAX_FINDINGS or (code, severity) not in self._kinds:
            self._kinds.add((code, severity))
            full_code = f"{self.prefix}-{code}"
            self.findings.append(Finding(full_code, shown_place(place), message, severity))


@dataclass(frozen=True)
class Number:
    """A finite number in a range."""

    lowest: float = -math.inf
    highest: float = math.inf
    is_whole: bool = False
    is_clamped: bool = False  # readers of this format clamp: out of range is a warning
    may_be_text: bool = False


@dataclass(frozen=True)
class Text:
    """Shape of a string: any, one of some, or one that a pattern matches as a whole."""

    choices: tuple[str, ...] = ()
    pattern: str = ""
    code: str = "CHOICE"


@dataclass(frozen=True)
class Flag:
    """Shape of true or false."""


@dataclass(frozen=True)
class Anything:
    """Shape of any value."""


@dataclass(frozen=True)
class Items:
    """A list."""

    item: Shape
    least: int = 0
    most: int | None = None


@dataclass(frozen=True)
class Record:
    """An object with known keys."""

    required: Mapping[str, Shape] = field(default_factory=dict)
    optional: Mapping[str, Shape] = field(default_factory=dict)
    unknown: Literal["error", "warning", "ignore"] = "warning"


@dataclass(frozen=True)
class Table:
    """An object with free keys."""

    item: Shape


Shape = Number | Text | Flag | Anything | Items | Record | Table


def check(shape: Shape, value: Any, report: Report, place: Place = None) -> None:
    """Hold a value against a shape; every fault is reported."""
    if isinstance(shape, Record):
        _check_record(shape, value, report, place)
    elif isinstance(shape, Items):
        if not isinstance(value, list):
            report.error("TYPE", place, f"expected a list, found {shown(value)}")
            return
        if len(value) < shape.least or (shape.most is not None and len(value) > shape.most):
            most = "or more" if shape.most is None else f"to {shape.most}"
            report.error("COUNT", place, f"{len(value)} items, allowed are {shape.least} {most}")
        for k, item in enumerate(value):
            check(shape.item, item, report, (place, k))
    elif isinstance(shape, Table):
        if not isinstance(value, dict):
            report.error("TYPE", place, f"expected an object, found {shown(value)}")
            return
        for key, item in value.items():
            check(shape.item, item, report, (place, key))
    elif isinstance(shape, Number):
        _check_number(shape, value, report, place)
    elif isinstance(shape, Text):
        _check_text(shape, value, report, place)
    elif isinstance(shape, Flag) and not isinstance(value, bool):
        report.error("TYPE", place, f"expected true or false, found {shown(value)}")


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


def _check_record(shape: Record, value: Any, report: Report, place: Place) -> None:
    if not isinstance(value, dict):
        report.error("TYPE", place, f"expected an object, found {shown(value)}")
        return
    for key, member in shape.required.items():
        if key in value:
            check(member, value[key], report, (place, key))
        else:
            report.error("MISSING", place, f"'{key}' is missing")
    for key, item in value.items():
        if key in shape.optional:
            check(shape.optional[key], item, report, (place, key))
        elif key not in shape.required and shape.unknown != "ignore":
            message = f"'{key[:_SHOWN]}' is unknown"
            if shape.unknown == "error":
                report.error("UNKNOWN", place, message)
            else:
                report.warn("UNKNOWN", place, message)


def _check_number(shape: Number, value: Any, report: Report, place: Place) -> None:
    if shape.may_be_text and isinstance(value, str):
        number = _number_of(value)
        if number is None:
            report.error("TYPE", place, f"expected a number, found {shown(value)}")
            return
        value = number
    # bool is an int in Python, and a true amplitude would be full power.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or (shape.is_whole and not isinstance(value, int)):
        kind = "a whole number" if shape.is_whole else "a number"
        report.error("TYPE", place, f"expected {kind}, found {shown(value)}")
    elif not shape.lowest <= value <= shape.highest:
        message = f"{shown(value)} is out of range, allowed is {_range(shape)}"
        if shape.is_clamped and math.isfinite(value):
            report.warn("RANGE", place, message)
        else:
            report.error("RANGE", place, message)


def _number_of(text: str) -> float | None:
    """Number that a text holds; None for another text, infinities and what is no number."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _range(shape: Number) -> str:
    if shape.highest == math.inf:
        return f"{shape.lowest:g} or more"
    return f"{shape.lowest:.10g} to {shape.highest:.10g}"


def _check_text(shape: Text, value: Any, report: Report, place: Place) -> None:
    if not isinstance(value, str):
        report.error("TYPE", place, f"expected text, found {shown(value)}")
    elif shape.choices and value not in shape.choices:
        allowed = ", ".join(shape.choices)
        report.error(shape.code, place, f"{shown(value)} is none of {allowed}")
    elif shape.pattern and not re.fullmatch(shape.pattern, value):
        report.error(shape.code, place, f"{shown(value)} is not of the form {shape.pattern}")


def shown(value: Any) -> str:
    """A value as a message repeats it."""
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else f"a list of {len(value)}"
    text = json.dumps(value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


def parse(content: bytes, name: str) -> Any:
    """Parse a JSON document; numbers are finite, keys are there once.

    Raises
    ------
    InputError
        It is too large, not UTF-8, not JSON, too deep, or has one of the faults above.
    """
    if len(content) > MAX_BYTES:
        raise InputError(f"{name}: is larger than {MAX_BYTES >> 20} MiB, the most that is read.")
    try:
        text = content.decode("utf-8-sig")
        value = json.loads(text, **STRICT)
        if _HALF_PAIR.search(text):
            encoded(value)
        return value
    except UnicodeEncodeError:
        raise InputError(f"{name}: has half of a surrogate pair, which is no character.") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: byte {error.start} is not UTF-8.") from None
    except RecursionError:
        raise InputError(f"{name}: is nested too deeply.") from None
    except ValueError as error:
        raise InputError(f"{name}: is not valid JSON ({error}).") from None


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """A file's content, if it is not larger than allowed.

    Raises
    ------
    InputError
        It cannot be read or is larger.
    """
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            parts, size = [], 0
            # Part by part: for one large read Python allocates the largest possible size.
            while size <= most and (part := file.read(_READ_BYTES)):
                parts.append(part)
                size += len(part)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    if size > most:
        raise InputError(f"{path}: is larger than {most >> 20} MiB, the most that is read.")
    return b"".join(parts)


def mapped(path: Path) -> bytes:
    """Memory-mapped content of a file of any size.

    Raises
    ------
    InputError
        It cannot be read.
    """
    refuse_no_file(path)
    try:
        with open(path, "rb") as file:
            if not os.fstat(file.fileno()).st_size:
                return b""
            found: Any = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            return found  # type: ignore[no-any-return]  # it is sliced as bytes are
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error


def decoding_findings(
    format_name: str, decode: Callable[[bytes, str], object], content: bytes, name: str
) -> list[Finding]:
    """Faults of a file whose decoding reveals all of them."""
    report = Report(format_name)
    try:
        decode(content, name)
    except InputError as error:
        report.error("CONTENT", None, str(error).removeprefix(f"{name}: ").rstrip("."))
    return report.findings


def json_validator(
    findings: Callable[[Any], list[Finding]], read: Callable[[bytes, str], Any] = parse
) -> Callable[[bytes, str], list[Finding]]:
    """Function of the faults of a file, given that of the faults of a parsed document.

    It raises ``InputError`` for a file that is no JSON document.
    """
    return lambda content, name: findings(read(content, name))


def refuse_errors(findings: list[Finding], name: str) -> None:
    """Raise the first error among findings.

    Raises
    ------
    InputError
        There is one; how many more there are is told.
    """
    errors = [each for each in findings if each.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more faults)" if len(errors) > 1 else ""
        first = errors[0]
        where = f"{first.place}: " if first.place else ""
        raise InputError(f"{name}: {where}{first.message} [{first.code}]{more}.")


def encoded(document: Any) -> bytes:
    """A document as JSON, the same bytes for the same content."""
    return (json.dumps(document, ensure_ascii=False, separators=(",", ":")) + "\n").encode()


def clean(name: str) -> str:
    """A name as UTF-8 can hold it: Blender's may have broken characters."""
    return name.encode("utf-8", "replace").decode()
