# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses between the scene and files of effects."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ...blender import compat
from ...engine.response_filters.controls import CONTROLS, FilterKind
from ..effects.response_recipes import FilterRecipe, Keys, references_of
from . import responses


def response_recipe(
    effect: bpy.types.Object, unit_m: float, first: float, fps: float
) -> tuple[FilterRecipe, ...]:
    """A volume's filters; muted ones as well. Times count from frame ``first``."""
    return tuple(
        _recipe(effect, k, each, unit_m, first, fps) for k, each in enumerate(effect.hfx.response)
    )


def _recipe(
    effect: bpy.types.Object,
    place: int,
    each: bpy.types.PropertyGroup,
    unit_m: float,
    first: float,
    fps: float,
) -> FilterRecipe:
    kind = FilterKind(each.kind)
    controls = CONTROLS[kind]
    names = responses.properties_of(each)
    curves = {
        match[2]: curve
        for curve in compat.fcurves(effect)
        if (match := responses.PATH.match(curve.data_path)) and int(match[1]) == place
    }
    values, keys = {}, []
    for control, name in zip(controls, names, strict=True):
        scale = unit_m if name in responses.LENGTHS else 1.0

        def held(value: float, scale: float = scale, of: object = control) -> float:
            return min(max(value * scale, of.minimum), of.maximum)  # type: ignore[attr-defined]

        values[control.name] = held(float(getattr(each, name)))
        if name in curves:
            found: Keys = tuple(
                ((key.co[0] - first) / fps, held(key.co[1])) for key in curves[name].keyframe_points
            )
            keys.append((control.name, found))
    about = each.domain if kind is FilterKind.SINE else each.about
    return FilterRecipe(
        kind.value,
        values,
        each.operation,
        about if references_of(kind) else "centre",
        bool(each.is_muted),
        tuple(keys),
    )


def add_response(
    effect: bpy.types.Object,
    response: Sequence[FilterRecipe],
    unit_m: float,
    frame: float,
    fps: float,
) -> None:
    """Give a new volume its filters; times count from ``frame``."""
    for place, recipe in enumerate(response):
        kind = FilterKind(recipe.kind)
        each = responses.add_filter(effect, recipe.kind)
        each.operation, each.is_muted = recipe.operation, recipe.is_muted
        if kind is FilterKind.SINE:
            each.domain = recipe.about
        elif kind is FilterKind.DISTANCE:
            each.about = recipe.about
        properties = dict(
            zip((c.name for c in CONTROLS[kind]), responses.properties_of(each), strict=True)
        )
        for control, value in recipe.controls.items():
            name = properties[control]
            setattr(each, name, value / (unit_m if name in responses.LENGTHS else 1.0))
        for control, keys in recipe.keys:
            name = properties[control]
            scale = unit_m if name in responses.LENGTHS else 1.0
            curve = compat.own_fcurve(effect, f"hfx.response[{place}].{name}", "Response")
            compat.set_keys(curve, [(frame + t * fps, value / scale) for t, value in keys])
