# SPDX-License-Identifier: GPL-3.0-or-later
"""A volume's contact response as its user edits it: a stack of filters."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import bpy

from ...blender import compat
from ...engine.response_filters.controls import About, Filter, FilterKind, Operation
from ...errors import InputError

KINDS: Final = (
    ("distance", "Distance", "Strength over the distance from the volume's centre or axis"),
    ("speed", "Speed", "Strength by the relative speed of skin and volume"),
    ("impact", "Impact", "Strength by the speed of the impact, then fading"),
    ("proximity", "Proximity", "Felt before contact, stronger with less distance"),
    ("sine", "Sine", "Strength oscillates in time or in space"),
)
"""Kinds of filters: identifier, label and tooltip."""

_PROPERTIES: Final = {
    FilterKind.DISTANCE: ("influence", "near", "far", "near_value", "far_value"),
    FilterKind.SPEED: ("influence", "still_speed", "full_speed"),
    FilterKind.IMPACT: ("influence", "attack", "decay", "full_speed"),
    FilterKind.PROXIMITY: ("influence", "reach", "exponent"),
    FilterKind.SINE: ("influence", "frequency", "depth", "phase"),
}
LENGTHS: Final = frozenset({"near", "far", "reach", "wavelength"})
"""Properties in Blender's units."""


PATH: Final = re.compile(r"hfx\.response\[(\d+)\]\.(\w+)$")
"""Animated path of a filter's property: the filter's place, and the property."""


def properties_of(each: bpy.types.PropertyGroup) -> tuple[str, ...]:
    """Names of a filter's properties, in the order of the engine's controls."""
    names = _PROPERTIES[FilterKind(each.kind)]
    if each.kind == "sine" and each.domain != "time":
        return tuple("wavelength" if name == "frequency" else name for name in names)
    return names


def active(hfx: bpy.types.PropertyGroup) -> list[tuple[int, bpy.types.PropertyGroup]]:
    """Unmuted filters, with their places in the stack."""
    if hfx.kind != "VOLUME":
        return []
    return [(k, each) for k, each in enumerate(hfx.response) if not each.is_muted]


def described(each: bpy.types.PropertyGroup, rings_s: float = 0.0) -> Filter:
    """Engine description of a filter; ``rings_s`` see :class:`Filter`."""
    kind = FilterKind(each.kind)
    about = About(each.domain if kind is FilterKind.SINE else each.about)
    return Filter(kind, Operation(each.operation), about, rings_s)


def signature(hfx: bpy.types.PropertyGroup) -> tuple[object, ...]:
    """Fingerprint of a response's description: changes with every setting that may affect it."""
    return tuple((k, described(each)) for k, each in active(hfx))


def add_filter(effect: bpy.types.Object, kind: str) -> bpy.types.PropertyGroup:
    """Add a filter at the end of a volume's stack.

    Raises
    ------
    InputError
        The effect is painted: nothing touches it.
    """
    if effect.hfx.kind != "VOLUME":
        raise InputError(f"'{effect.name}' is not a volume: nothing touches it.")
    added = effect.hfx.response.add()
    added.kind = kind
    added.name = next(label for name, label, _ in KINDS if name == kind)
    if kind == "proximity":  # only proximity can be felt before contact
        added.operation, added.influence = "maximum", 0.3
    effect.hfx.response_active = len(effect.hfx.response) - 1
    effect.update_tag()
    return added


def remove_filter(effect: bpy.types.Object, index: int) -> None:
    """Remove a filter; animation of those below it goes along with them."""
    count = len(effect.hfx.response)
    effect.hfx.response.remove(index)
    order = [None if k == index else k - (k > index) for k in range(count)]
    renumber(effect, order)
    effect.hfx.response_active = max(0, min(index, count - 2))
    effect.update_tag()


def move_filter(effect: bpy.types.Object, index: int, to: int) -> None:
    """Move a filter to another place; its animation goes along."""
    count = len(effect.hfx.response)
    if not 0 <= to < count:
        return
    effect.hfx.response.move(index, to)
    places = list(range(count))
    places.insert(to, places.pop(index))
    order: list[int | None] = [places.index(k) for k in range(count)]
    renumber(effect, order)
    effect.hfx.response_active = to
    effect.update_tag()


def renumber(effect: bpy.types.Object, order: Sequence[int | None]) -> None:
    """Rename curves and drivers to follow their filters, which they name by their place.

    Parameters
    ----------
    order : sequence of int or None
        The new place of the filter that was at each place; None: it is gone, and so is its
        animation.
    """
    data = effect.animation_data
    if data is None:
        return
    for curves in (data.drivers, *compat.curve_collections(effect)):
        for curve in list(curves):
            match = PATH.match(curve.data_path)
            if match is None or int(match[1]) >= len(order):
                continue
            to = order[int(match[1])]
            if to is None:
                curves.remove(curve)
            else:
                curve.data_path = f"hfx.response[{to}].{match[2]}"
