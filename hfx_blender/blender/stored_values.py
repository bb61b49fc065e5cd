# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of our property groups as stored in a file, possibly beyond all limits.

Blender keeps to a property's range where somebody sets it. What a file holds, or a script writes
past the property, comes as it is: NaN, negative lengths, items that no menu has, text in place of
a number. Every property is looked at here, whatever it is called.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from . import compat

_NUMBERS = {"BOOLEAN": (bool, int), "INT": (int,), "FLOAT": (float,), "ENUM": (int,)}
_ARRAYS = {"BOOLEAN": "bi", "INT": "i", "FLOAT": "fd"}  # types of elements
_ENDLESS = 3e38
"""Limits beyond it are those of the number's type: there are none."""


@dataclass(frozen=True)
class BadValue:
    """Stored value that its property does not allow."""

    path: str  # below Object.hfx or Scene.hfx, such as ``response[2].decay``
    found: str
    allowed: str
    taken: str | None  # value read in its place; None if there is no sensible one

    def __str__(self) -> str:
        return f"hfx.{self.path} is {self.found}, allowed is {self.allowed}"

    @property
    def top(self) -> str:
        """Property of Object.hfx or Scene.hfx that holds the value."""
        return self.path.partition(".")[0].partition("[")[0]


def bad_values(owner: bpy.types.ID) -> list[BadValue]:
    """The values of ``owner.hfx``, with all that is below it, that are not allowed."""
    stored = compat.stored_properties(owner).get("hfx")
    if stored is None:
        return []
    if not hasattr(stored, "keys"):
        return [BadValue("", _described(stored), "a group of properties", "nothing")]
    return list(_bad_of(owner.hfx, stored, ""))


def stored_at(owner: bpy.types.ID, *names: str) -> Any:
    """Value below ``owner.hfx`` as it is stored; None where nothing is."""
    value: Any = compat.stored_properties(owner).get("hfx")
    for name in names:
        value = value.get(name) if hasattr(value, "keys") else None
    return value


def limited(group: bpy.types.PropertyGroup, name: str) -> float:
    """Numeric property, within its limits; NaN stays NaN."""
    limits = group.bl_rna.properties[name]
    return float(min(max(getattr(group, name), limits.hard_min), limits.hard_max))


def limited_row(group: bpy.types.PropertyGroup, name: str) -> tuple[float, ...]:
    """A property of several numbers, each within its limits."""
    limits = group.bl_rna.properties[name]
    return tuple(min(max(v, limits.hard_min), limits.hard_max) for v in getattr(group, name))


def _bad_of(
    group: bpy.types.PropertyGroup, stored: Mapping[str, Any], above: str
) -> Iterator[BadValue]:
    for definition in group.bl_rna.properties:
        name, kind = definition.identifier, definition.type
        if name == "rna_type" or name not in stored:
            continue
        value, path = stored[name], above + name
        if kind in _NUMBERS:
            found = _bad_number(definition, value, path)
            if found is not None:
                yield found
        elif kind == "STRING":
            if not isinstance(value, str | bytes):
                yield BadValue(path, _described(value), "a text", "an empty text")
        elif kind == "POINTER" and definition.fixed_type.base.identifier == "PropertyGroup":
            if hasattr(value, "keys"):
                yield from _bad_of(getattr(group, name), value, path + ".")
            else:
                yield BadValue(path, _described(value), "a group of properties", None)
        elif kind == "POINTER":
            what = definition.fixed_type.identifier
            # 4.5 stores an empty group when code asks for a pointer that was never set.
            is_unset = value is None or (hasattr(value, "keys") and not value.keys())
            if not is_unset and not isinstance(value, getattr(bpy.types, what)):
                is_other = isinstance(value, bpy.types.ID)
                yield BadValue(
                    path, _described(value), f"a datablock {what}", None if is_other else "none"
                )
        elif kind == "COLLECTION":
            yield from _bad_entries(getattr(group, name), value, path)


def _bad_entries(entries: Any, stored: Any, path: str) -> Iterator[BadValue]:
    if not isinstance(stored, list) or len(stored) != len(entries):
        yield BadValue(path, _described(stored), "a list of entries", "an empty list")
        return
    for k, (entry, each) in enumerate(zip(entries, stored, strict=True)):
        yield from _bad_of(entry, each, f"{path}[{k}].")


def _bad_number(definition: bpy.types.Property, value: Any, path: str) -> BadValue | None:
    """A number, a row of numbers or an item of a menu that is not allowed."""
    allowed = _allowed(definition)
    count = 0 if definition.type == "ENUM" else definition.array_length
    if count:
        if getattr(value, "typecode", "none") not in _ARRAYS[definition.type]:
            return BadValue(path, _described(value), f"{count} times {allowed}", None)
        if len(value) != count:
            default = ", ".join(f"{each:g}" for each in definition.default_array)
            return BadValue(path, f"{len(value)} numbers", f"{count} times {allowed}", default)
        row = list(value)
        if all(_is_within(definition, each) for each in row):
            return None
        described = ", ".join(f"{each:g}" for each in row)
        taken = None
        if all(map(math.isfinite, row)):
            taken = ", ".join(f"{_nearest(definition, each):g}" for each in row)
        return BadValue(path, described, f"{count} times {allowed}", taken)
    if not isinstance(value, _NUMBERS[definition.type]):
        return BadValue(path, _described(value), allowed, str(definition.default))
    if definition.type == "ENUM":
        known = any(item.value == value for item in definition.enum_items)
        return None if known else BadValue(path, f"item {value}", allowed, None)
    if definition.type == "BOOLEAN" or _is_within(definition, value):
        return None
    taken = f"{_nearest(definition, value):g}" if math.isfinite(value) else None
    return BadValue(path, f"{value:g}", allowed, taken)


def _is_within(definition: bpy.types.Property, value: float) -> bool:
    low, high = definition.hard_min, definition.hard_max
    rounding = 1e-6 * max(abs(value), 1e-30)  # limits are 32-bit floats, a value may have 64
    return math.isfinite(value) and low - rounding <= value <= high + rounding


def _nearest(definition: bpy.types.Property, value: float) -> float:
    return min(max(value, definition.hard_min), definition.hard_max)


def _allowed(definition: bpy.types.Property) -> str:
    if definition.type == "ENUM":
        return "one of " + ", ".join(item.identifier for item in definition.enum_items)
    if definition.type == "BOOLEAN":
        return "yes or no"
    low, high = definition.hard_min, definition.hard_max
    is_int = definition.type == "INT"
    endless = 2**31 - 1 if is_int else _ENDLESS
    if low <= -endless and high >= endless:
        return "a whole number" if is_int else "a finite number"
    return f"{low:g} or more" if high >= endless else f"{low:g} to {high:g}"


def _described(value: Any) -> str:
    if isinstance(value, str):
        return f"the text '{value[:40]}'"
    if isinstance(value, bpy.types.ID):
        return f"'{value.name}'"
    if isinstance(value, int | float):
        return f"the number {value:g}"
    if hasattr(value, "typecode") or isinstance(value, list):
        return f"a list of {len(value)}"
    return "of another kind"
