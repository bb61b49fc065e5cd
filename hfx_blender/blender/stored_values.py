# SPDX-License-Identifier: GPL-3.0-or-later
"""Raw stored values of the add-on's property groups, and checks of their ranges.

Blender limits a property only when the user interface or a script assigns a value. A file, or a
write past the property, may store NaN, negative lengths, unknown menu items, or text in place of a
number. Every property is checked, including properties of later versions.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from . import compat

_NUMBERS = {"BOOLEAN": (bool, int), "INT": (int,), "FLOAT": (float,), "ENUM": (int,)}
_ARRAYS = {"BOOLEAN": "bi", "INT": "i", "FLOAT": "fd"}  # types of elements
_ENDLESS = 3e38
"""Bound of a float property without limits."""
_HARD_LIMITS: dict[tuple[type, str], tuple[float, float]] = {}  # by type of group and property


@dataclass(frozen=True)
class BadValue:
    """Stored value outside of the property's allowed values."""

    path: str  # below Object.hfx or Scene.hfx, such as ``response[2].decay``
    found: str
    allowed: str
    taken: str | None  # replacement value of readers; None if no value is sensible

    def __str__(self) -> str:
        return f"hfx.{self.path} is {self.found}, allowed is {self.allowed}"

    @property
    def top(self) -> str:
        """Property of Object.hfx or Scene.hfx that contains the value."""
        return self.path.partition(".")[0].partition("[")[0]


def bad_values(owner: bpy.types.ID) -> list[BadValue]:
    """Stored values of ``owner.hfx`` and nested groups of a type or range that is not allowed."""
    # Reading through RNA would clamp or erase the value.
    stored = compat.stored_properties(owner).get("hfx")
    if stored is None:
        return []
    if not hasattr(stored, "keys"):
        return [BadValue("", _described(stored), "a group of properties", "nothing")]
    # Of about 50 properties few are stored, so these are looked up, and sorted only if bad.
    order = owner.hfx.bl_rna.properties.find
    return sorted(_bad_of(owner.hfx, stored, ""), key=lambda bad: order(bad.top))


def stored_at(owner: bpy.types.ID, *names: str) -> Any:
    """Raw stored value at a path of names below ``owner.hfx``; None if nothing is stored."""
    value: Any = compat.stored_properties(owner).get("hfx")
    for name in names:
        value = value.get(name) if hasattr(value, "keys") else None
    return value


def limited(group: bpy.types.PropertyGroup, name: str) -> float:
    """Numeric property clamped to the hard limits; NaN stays NaN."""
    low, high = _hard_limits(group, name)
    return float(min(max(getattr(group, name), low), high))


def limited_vector(group: bpy.types.PropertyGroup, name: str) -> tuple[float, ...]:
    """Array property with each number clamped to the hard limits."""
    low, high = _hard_limits(group, name)
    return tuple(min(max(v, low), high) for v in getattr(group, name))


def _hard_limits(group: bpy.types.PropertyGroup, name: str) -> tuple[float, float]:
    """Hard minimum and maximum of a numeric property, looked up once for each type of group."""
    key = type(group), name
    if key not in _HARD_LIMITS:
        definition = group.bl_rna.properties[name]
        _HARD_LIMITS[key] = definition.hard_min, definition.hard_max
    return _HARD_LIMITS[key]


def _bad_of(
    group: bpy.types.PropertyGroup, stored: Mapping[str, Any], prefix: str
) -> Iterator[BadValue]:
    """Yield the bad values among the ``stored`` values of a group and its nested groups, paths
    after ``prefix``; values of unknown names are ignored."""
    definitions = group.bl_rna.properties
    for name in [*stored]:
        definition = definitions.get(name)
        if definition is None or name == "rna_type":
            continue
        kind, value, path = definition.type, stored[name], prefix + name
        # A branch per kind of property; a nested group recurs.
        if kind in _NUMBERS:
            bad = _bad_number(definition, value, path)
            if bad is not None:
                yield bad
        elif kind == "STRING":
            if not isinstance(value, str | bytes):
                yield BadValue(path, _described(value), "a text", "an empty text")
        elif kind == "POINTER" and definition.fixed_type.base.identifier == "PropertyGroup":
            if hasattr(value, "keys"):
                yield from _bad_of(getattr(group, name), value, path + ".")
            else:
                yield BadValue(path, _described(value), "a group of properties", None)
        elif kind == "POINTER":
            id_type = definition.fixed_type.identifier
            # Blender 4.5 stores an empty group when an unset pointer is read.
            is_unset = value is None or (hasattr(value, "keys") and not value.keys())
            if not is_unset and not isinstance(value, getattr(bpy.types, id_type)):
                taken = None if isinstance(value, bpy.types.ID) else "none"
                yield BadValue(path, _described(value), f"a datablock {id_type}", taken)
        elif kind == "COLLECTION":
            # RNA may show fewer entries than a damaged list stores, so lengths are compared first.
            entries = getattr(group, name)
            if not isinstance(value, list) or len(value) != len(entries):
                yield BadValue(path, _described(value), "a list of entries", "an empty list")
                continue
            for k, (entry, stored_entry) in enumerate(zip(entries, value, strict=True)):
                yield from _bad_of(entry, stored_entry, f"{path}[{k}].")


def _bad_number(definition: bpy.types.Property, value: Any, path: str) -> BadValue | None:
    """Fault of a stored number, array or menu item in type, length or range; None if allowed."""
    kind = definition.type
    count = 0 if kind == "ENUM" else definition.array_length
    # Blender stores an array with an element type.
    if count:
        allowed = f"{count} times {_allowed(definition)}"
        if getattr(value, "typecode", "none") not in _ARRAYS[kind]:
            return BadValue(path, _described(value), allowed, None)
        if len(value) != count:
            default = ", ".join(f"{number:g}" for number in definition.default_array)
            return BadValue(path, f"{len(value)} numbers", allowed, default)
        numbers = list(value)
        if all(_is_within(definition, number) for number in numbers):
            return None
        taken = None
        if all(map(math.isfinite, numbers)):
            taken = ", ".join(f"{_nearest(definition, number):g}" for number in numbers)
        described = ", ".join(f"{number:g}" for number in numbers)
        return BadValue(path, described, allowed, taken)
    if not isinstance(value, _NUMBERS[kind]):
        return BadValue(path, _described(value), _allowed(definition), str(definition.default))
    if kind == "ENUM":
        is_known = any(item.value == value for item in definition.enum_items)
        return None if is_known else BadValue(path, f"item {value}", _allowed(definition), None)
    if kind == "BOOLEAN" or _is_within(definition, value):
        return None
    taken = f"{_nearest(definition, value):g}" if math.isfinite(value) else None
    return BadValue(path, f"{value:g}", _allowed(definition), taken)


def _is_within(definition: bpy.types.Property, value: float) -> bool:
    """Test for a finite number within a property's hard limits, up to float32 rounding."""
    low, high = definition.hard_min, definition.hard_max
    rounding = 1e-6 * max(abs(value), 1e-30)  # limits are 32-bit floats, a value may have 64
    return math.isfinite(value) and low - rounding <= value <= high + rounding


def _nearest(definition: bpy.types.Property, value: float) -> float:
    """Value clamped to a property's hard limits."""
    return min(max(value, definition.hard_min), definition.hard_max)


def _allowed(definition: bpy.types.Property) -> str:
    """Allowed values of a number or menu property, for messages; "a finite number" without
    limits."""
    if definition.type == "ENUM":
        return "one of " + ", ".join(item.identifier for item in definition.enum_items)
    if definition.type == "BOOLEAN":
        return "yes or no"
    low, high = definition.hard_min, definition.hard_max
    is_int = definition.type == "INT"
    # Blender gives unlimited properties the limits of the number type.
    endless = 2**31 - 1 if is_int else _ENDLESS
    if low <= -endless and high >= endless:
        return "a whole number" if is_int else "a finite number"
    return f"{low:g} or more" if high >= endless else f"{low:g} to {high:g}"


def _described(value: Any) -> str:
    """Stored value for messages: text (40 letters), datablock, number, length of a list, or "of
    another kind"."""
    if isinstance(value, str):
        return f"the text '{value[:40]}'"
    if isinstance(value, bpy.types.ID):
        return f"'{value.name}'"
    if isinstance(value, int | float):
        return f"the number {value:g}"
    if hasattr(value, "typecode") or isinstance(value, list):
        return f"a list of {len(value)}"
    return "of another kind"
