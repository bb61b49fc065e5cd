# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses of volumes: the stack of filters, in the scene and in effect files."""

import re
from collections.abc import Sequence
from typing import Final

import bpy

from ..blender import compat
from ..engine.response_filters.controls import CONTROLS, About, Filter, FilterKind, Operation
from ..errors import InputError
from .effects.response_recipes import FilterRecipe, Keys, references_of

KINDS: Final = (
    ("distance", "Distance", "Strength over the distance from the volume's centre or axis"),
    ("speed", "Speed", "Strength by the relative speed of skin and volume"),
    ("impact", "Impact", "Strength by the speed of the impact, with a decay"),
    ("proximity", "Proximity", "Sensation before contact, stronger at shorter distance"),
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
LENGTHS: Final = frozenset({"near", "far", "reach", "wavelength"})  # properties in Blender units

PATH: Final = re.compile(r"hfx\.response\[(\d+)\]\.(\w+)$")
"""Data path of a filter's property; groups: index of the filter, and the property."""


def properties_of(response_filter: bpy.types.PropertyGroup) -> tuple[str, ...]:
    """RNA names of a filter's controls, in the engine's order; a spatial sine has a wavelength."""
    names = _PROPERTIES[FilterKind(response_filter.kind)]
    if response_filter.kind == "sine" and response_filter.domain != "time":
        return tuple("wavelength" if name == "frequency" else name for name in names)
    return names


def active_filters(hfx: bpy.types.PropertyGroup) -> list[tuple[int, bpy.types.PropertyGroup]]:
    """Unmuted filters with their index in the stack; empty for effects that are no volumes."""
    if hfx.kind != "VOLUME":
        return []
    return [(k, item) for k, item in enumerate(hfx.response) if not item.is_muted]


def described(response_filter: bpy.types.PropertyGroup, rings_s: float = 0.0) -> Filter:
    """Engine description of a filter; ``rings_s`` see :class:`Filter`."""
    kind = FilterKind(response_filter.kind)
    operation = Operation(response_filter.operation)
    return Filter(kind, operation, About(_reference(response_filter)), rings_s)


def _reference(response_filter: bpy.types.PropertyGroup) -> str:
    is_sine = response_filter.kind == "sine"
    return str(response_filter.domain if is_sine else response_filter.about)


def signature(hfx: bpy.types.PropertyGroup) -> tuple[object, ...]:
    """Comparable value of a response: stack index, kind, operation and reference of each unmuted
    filter, without the controls that can be animated; () for effects that are no volumes."""
    return tuple((k, described(item)) for k, item in active_filters(hfx))


def add_filter(effect: bpy.types.Object, kind: str) -> bpy.types.PropertyGroup:
    """Add a filter at the end of a volume's stack and make it active; return the filter. Named
    after its kind; "proximity" begins with the operation maximum at influence 0.3. Raises
    InputError for an effect that is no volume."""
    if effect.hfx.kind != "VOLUME":
        raise InputError(f"'{effect.name}' is not a volume: it has no contact response.")
    added = effect.hfx.response.add()
    added.kind = kind
    added.name = next(label for name, label, _ in KINDS if name == kind)
    if kind == "proximity":  # a product is 0 before contact
        added.operation, added.influence = "maximum", 0.3
    effect.hfx.response_active = len(effect.hfx.response) - 1
    effect.update_tag()
    return added


def remove_filter(effect: bpy.types.Object, index: int) -> None:
    """Remove a filter with its F-curves and drivers; those of later filters are renumbered. The
    next filter becomes active, else the last."""
    count = len(effect.hfx.response)
    effect.hfx.response.remove(index)
    renumber(effect, [None if k == index else k - (k > index) for k in range(count)])
    effect.hfx.response_active = max(0, min(index, count - 2))
    effect.update_tag()


def move_filter(effect: bpy.types.Object, index: int, to: int) -> None:
    """Move a filter with its F-curves and drivers to index ``to`` and make it active; nothing for
    ``to`` outside of the stack."""
    count = len(effect.hfx.response)
    if not 0 <= to < count:
        return
    effect.hfx.response.move(index, to)
    # order[new] is the old index; renumber needs the inverse.
    order = list(range(count))
    order.insert(to, order.pop(index))
    renumber(effect, [order.index(k) for k in range(count)])
    effect.hfx.response_active = to
    effect.update_tag()


def renumber(effect: bpy.types.Object, new_indices: Sequence[int | None]) -> None:
    """Update the data paths of F-curves and drivers to new indices of the filters. ``new_indices``
    has an item per old index; None removes the animation of that filter."""
    data = effect.animation_data
    if data is None:
        return
    # Blender stores the index in the data path, and does not update paths when items move. Curves
    # are removed from the collection of their action, so a flat list of curves is not enough.
    for curves in (data.drivers, *compat.curve_collections(effect)):
        for curve in list(curves):
            match = PATH.match(curve.data_path)
            if match is None or int(match[1]) >= len(new_indices):
                continue
            to = new_indices[int(match[1])]
            if to is None:
                curves.remove(curve)
            else:
                curve.data_path = f"hfx.response[{to}].{match[2]}"


def response_recipe(
    effect: bpy.types.Object, unit_m: float, first: float, fps: float
) -> tuple[FilterRecipe, ...]:
    """Recipes of a volume's filters, including muted filters; times relative to frame ``first``.
    Values and keyframes are clamped to the limits of the engine's controls."""
    paths = ((PATH.match(curve.data_path), curve) for curve in compat.fcurves(effect))
    curves = {(int(match[1]), match[2]): curve for match, curve in paths if match}
    recipes = []
    for index, item in enumerate(effect.hfx.response):
        kind = FilterKind(item.kind)
        values: dict[str, float] = {}
        animated: list[tuple[str, Keys]] = []
        for control, name in zip(CONTROLS[kind], properties_of(item), strict=True):
            # Files are strict about limits, a .blend may hold any number.
            scale, low, high = _scale(name, unit_m), control.minimum, control.maximum
            values[control.name] = min(max(float(getattr(item, name)) * scale, low), high)
            if (index, name) in curves:
                keys = tuple(
                    ((key.co[0] - first) / fps, min(max(key.co[1] * scale, low), high))
                    for key in curves[index, name].keyframe_points
                )
                animated.append((control.name, keys))
        about = _reference(item) if references_of(kind) else "centre"
        is_muted, keys_by_control = bool(item.is_muted), tuple(animated)
        recipe = FilterRecipe(kind.value, values, item.operation, about, is_muted, keys_by_control)
        recipes.append(recipe)
    return tuple(recipes)


def _scale(name: str, unit_m: float) -> float:
    """Factor to the engine's unit: metres per unit for lengths, else 1."""
    return unit_m if name in LENGTHS else 1.0


def add_response(
    effect: bpy.types.Object,
    response: Sequence[FilterRecipe],
    unit_m: float,
    frame: float,
    fps: float,
) -> None:
    """Add a recipe's filters, with keyframes on the effect's action, to a volume without filters.
    Time 0 s of the keyframes is ``frame``; lengths in metres are divided by ``unit_m``."""
    # A new volume has no filters, so indices of the recipe are indices of the stack.
    for index, recipe in enumerate(response):
        kind = FilterKind(recipe.kind)
        item = add_filter(effect, recipe.kind)
        item.operation, item.is_muted = recipe.operation, recipe.is_muted
        if kind is FilterKind.SINE:
            item.domain = recipe.about
        elif kind is FilterKind.DISTANCE:
            item.about = recipe.about
        names = (control.name for control in CONTROLS[kind])
        properties = dict(zip(names, properties_of(item), strict=True))
        for control, value in recipe.controls.items():
            name = properties[control]
            setattr(item, name, value / _scale(name, unit_m))
        for control, keys in recipe.keys:
            name = properties[control]
            scale = _scale(name, unit_m)
            curve = compat.own_fcurve(effect, f"hfx.response[{index}].{name}", "Response")
            compat.set_keys(curve, [(frame + t * fps, value / scale) for t, value in keys])
