# SPDX-License-Identifier: GPL-3.0-or-later
"""Tooltips teach: every operator and every visible property has an explaining description."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import pytest

_OF_BLENDER = {"filepath", "directory", "files", "check_existing", "name"}
"""What Blender's file browser brings, and the names of property groups."""


def _operators() -> Iterator[Any]:
    for name in dir(bpy.ops.hfx):
        yield getattr(bpy.ops.hfx, name).get_rna_type()


def _groups(owner: Any, seen: set[str]) -> Iterator[Any]:
    if owner.identifier in seen:
        return
    seen.add(owner.identifier)
    yield owner
    for entry in owner.properties:
        inner = getattr(entry, "fixed_type", None)
        if inner is not None and inner.identifier.startswith("Hfx"):
            yield from _groups(inner, seen)


def _own_properties(owner: Any) -> Iterator[Any]:
    for entry in owner.properties:
        if entry.identifier in {"rna_type", *_OF_BLENDER} or entry.is_hidden:
            continue
        if entry.identifier.startswith(("hfx", "filter_")) and owner.identifier == "Object":
            continue
        yield entry


def _faults(text: str, place: str) -> list[str]:
    if not text.strip():
        return [f"{place} says nothing"]
    faults = [f"{place} has a line break"] if "\n" in text else []
    return faults + ([f"{place} ends with a full stop"] if text.endswith(".") else [])


def test_every_operator_says_what_it_does(registered: Any) -> None:
    faults = [
        fault
        for operator in _operators()
        for fault in _faults(operator.description, operator.identifier)
    ]
    assert faults == []


def test_every_argument_of_an_operator_says_what_it_does(registered: Any) -> None:
    faults = [
        fault
        for operator in _operators()
        for own_property in _own_properties(operator)
        for fault in _faults(
            own_property.description, f"{operator.identifier}.{own_property.identifier}"
        )
    ]
    assert faults == []


@pytest.mark.parametrize("owner", ["Object", "Scene"])
def test_every_property_of_a_scene_says_what_it_does(registered: Any, owner: str) -> None:
    top = getattr(bpy.types, owner).bl_rna.properties["hfx"].fixed_type
    faults = [
        fault
        for group in _groups(top, set())
        for own_property in _own_properties(group)
        if own_property.type not in ("POINTER", "COLLECTION") or not own_property.fixed_type.base
        for fault in _faults(
            own_property.description, f"{group.identifier}.{own_property.identifier}"
        )
    ]
    assert faults == []


def test_every_choice_says_what_it_means(registered: Any) -> None:
    faults = [
        f"{owner.identifier}.{own_property.identifier}: {item.identifier}"
        for owner in [
            *_operators(),
            *_groups(_hfx("Object"), set()),
            *_groups(_hfx("Scene"), set()),
        ]
        for own_property in _own_properties(owner)
        if own_property.type == "ENUM"
        for item in own_property.enum_items
        if not item.description.strip()
    ]
    assert faults == []


def _hfx(owner: str) -> Any:
    return getattr(bpy.types, owner).bl_rna.properties["hfx"].fixed_type
