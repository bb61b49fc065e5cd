# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation of effects and bodies: stored values, keyframes, animated properties.

A .blend may come from any source. A fault excludes only the object that has it, and each corrected
value is reported.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import bpy
import numpy as np

from ...authoring import clips
from ...authoring.effects import effect_values, effects
from ...blender import compat, stored_values
from ...blender.stored_values import BadValue
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...text import named

MOST_FILTERS = 64  # largest number of filters in a contact response
_OF_BODIES = frozenset({"follow", "avatar", "avatar_parts", "fit_kept", "bone_map", "uid"})
_OF_NOBODY = frozenset({"envelope", "response_active", "bone_map_active", "bone_map_region"})
SIZES = {
    "CUBOID": ("size",),
    "SPHERE": ("radius",),
    "CYLINDER": ("radius", "height"),
    "CAPSULE": ("radius", "height"),
}
"""Size properties of each volume shape."""

_LARGEST = np.finfo(np.float32).max  # Blender's stored value of an infinite key

_FIXED = re.compile(
    r"hfx\.(role|kind|modality|response\[\d+\]\.(kind|operation|about|domain|is_muted))"
)
"""Properties required to be constant: the kind of an effect depends on these."""

_STEADY = re.compile(
    r"hfx\.(falloff|falloff_share|temperature_reference|is_muted|is_solo|follow|surface\..*)"
)
"""Properties read once, at the present frame."""


def warnings_of(obj: bpy.types.Object) -> list[str]:
    """Warnings about replaced or ignored values of an effect or a body: stored values, weights,
    keys. Raises InputError for a value without replacement or of a surface, above 64 filters, and
    if a property required to be constant is animated."""
    animated = {path for path in animated_paths(obj) if not _STEADY.fullmatch(path)}
    warnings = []
    for bad in stored_values.bad_values(obj):
        if f"hfx.{bad.path}" in animated:
            continue  # the animated value is checked at each sample
        if not _counts(obj, bad):
            warnings.append(f"{titled(obj)}: {bad}; it is ignored")
        elif bad.taken is None or bad.top == "surface":
            raise InputError(f"{titled(obj)}: {bad}.")
        else:
            warnings.append(f"{titled(obj)}: {bad}; {bad.taken} is taken")
    if len(obj.hfx.response) > MOST_FILTERS:
        raise InputError(
            f"{titled(obj)}: its contact response has {len(obj.hfx.response)} filters, at most "
            f"{MOST_FILTERS} are allowed."
        )
    if obj.hfx.role == "EFFECT" and obj.hfx.kind == "PAINTED":
        bad_count = sum(not 0.0 <= weight <= 1.0 for weight in effects.area(obj)[1])
        if bad_count:
            warnings.append(
                f"{titled(obj)}: {bad_count} painted weights are no numbers from 0 to 1; these "
                "vertices are not felt"
            )
    return warnings + list(_of_animation(obj))


def warnings_of_wire(effect: bpy.types.Object) -> Iterator[str]:
    """Yield a warning about the edited wire of a volume, unless the wire shows one of several
    sizes: an animated one, or that of another user of the mesh."""
    sizes, mesh = ("shape", *SIZES.get(effect.hfx.shape, ())), effect.data
    is_animated = any(p.removeprefix("hfx.") in sizes for p in animated_paths(effect))
    if not (is_animated or mesh.users > 1 or mesh.library != effect.library):
        yield (
            f"{titled(effect)}: its wire differs from its size in the panel Haptic Effect, which "
            "is exported; change the size there instead of applying a scale or editing the mesh"
        )


def without_faulty(
    objects: Iterable[bpy.types.Object], work: Callable[[bpy.types.Object], Any]
) -> tuple[dict[bpy.types.Object, Any], dict[bpy.types.Object, str]]:
    """Results of ``work(obj)`` by object, and the messages of InputErrors by object, both in the
    order of ``objects``; other exceptions pass."""
    results, faults = {}, {}
    for obj in objects:
        try:
            results[obj] = work(obj)
        except InputError as error:
            faults[obj] = str(error)
    return results, faults


def left_out(faults: Mapping[bpy.types.Object, str]) -> tuple[str, ...]:
    """One warning for each excluded object, from messages by object."""
    return tuple(f"{titled(o)} was left out: {why.removesuffix('.')}" for o, why in faults.items())


def titled(obj: bpy.types.Object) -> str:
    """Kind and quoted name for messages: effect, body or object."""
    kind = {"EFFECT": "effect", "BODY": "body"}.get(obj.hfx.role, "object")
    return f"{kind} '{effects.shown_names([obj])[obj]}'"


def non_finite_keyframes(objects: Iterable[bpy.types.Object]) -> tuple[str, ...]:
    """Notes on the first NaN or infinite key of each F-curve of objects, their parents, data and
    shape keys. Such keys are evaluated as Blender does; effects are silent at samples with NaN."""
    owners: dict[bpy.types.ID, str] = {}
    for mover in objects:
        # Ends at the top, at a cycle of parents, and at an ancestor of an earlier object.
        while mover is not None and mover not in owners:
            for owner in filter(None, (mover, mover.data, getattr(mover.data, "shape_keys", None))):
                owners.setdefault(owner, mover.name)
            mover = mover.parent
    return tuple(
        note
        for owner, name in owners.items()
        if owner.animation_data is not None
        for note in _non_finite(name, compat.all_fcurves(owner))
    )


def _non_finite(name: str, curves: list[bpy.types.FCurve]) -> Iterator[str]:
    """Yield a note for each curve of the object ``name`` with a NaN or infinite key: the first such
    key, counted from 1."""
    # All keys in one array: rigs have thousands of curves.
    keys_by_curve = [np.zeros(len(curve.keyframe_points) * 2, np.float32) for curve in curves]
    for curve, keys in zip(curves, keys_by_curve, strict=True):
        curve.keyframe_points.foreach_get("co", keys)
    counts = np.cumsum([0, *map(len, keys_by_curve)])
    bad = np.flatnonzero(~(np.abs(np.concatenate([np.zeros(0, "f4"), *keys_by_curve])) < _LARGEST))
    curve_numbers = np.searchsorted(counts, bad, "right") - 1
    for which in np.unique(curve_numbers).tolist():
        first = int(bad[np.searchsorted(curve_numbers, which)])
        number = (first - int(counts[which])) // 2 + 1
        yield (
            f"'{name}': key {number} of the F-curve '{curves[which].data_path}' "
            f"[{curves[which].array_index}] is not a finite number; correct or delete it"
        )


def _counts(obj: bpy.types.Object, bad: BadValue) -> bool:
    """Test that a bad value has influence on samples, by role, kind, modality and shape of the
    object; unknown properties of effects count."""
    hfx, name = obj.hfx, bad.top
    if hfx.role == "BODY":
        return name in _OF_BODIES
    if name in _OF_NOBODY or (name in _OF_BODIES and name != "uid"):
        return False
    if name == "activation":  # always on without animation
        return obj.animation_data is not None
    users = [m.name for m in MODALITIES.values() if name in [c.prop for c in m.controls]]
    if users and hfx.modality in MODALITIES:
        return hfx.modality in users
    if name in ("falloff", "falloff_share"):
        return hfx.kind in ("VOLUME", "SPOT") and (name == "falloff" or hfx.falloff != "none")
    if name in ("size", "radius", "height", "shape"):
        if hfx.kind == "SPOT":
            return name == "radius"
        return hfx.kind == "VOLUME" and (name == "shape" or name in SIZES.get(hfx.shape, ()))
    if name in effect_values.LAW:
        return hfx.kind in ("VOLUME", "SURFACE") and (name == "stiffness" or hfx.stiffness > 0.0)
    only = {"response": "VOLUME", "surface": "SURFACE", "path_position": "SPOT"}
    only |= {"drive": "ACTUATORS", "device": "ACTUATORS"}
    return hfx.kind == only[name] if name in only else True


def add_fault(faults: dict[str, set[int]], text: str, index: int) -> None:
    """Add a sample index to a fault, in place. Faults with equal text before the first ": " share
    the entry."""
    # The end of a message may have numbers that differ from sample to sample.
    head = text.partition(": ")[0]
    same = (known for known in faults if known.partition(": ")[0] == head)
    faults.setdefault(next(same, text), set()).add(index)


def animated_paths(obj: bpy.types.ID) -> list[str]:
    """Unique RNA paths of a data-block's unmuted F-curves (action, strips) and drivers, in this
    order."""
    data = obj.animation_data
    if data is None:
        return []
    curves = (*compat.all_fcurves(obj), *data.drivers)
    return list(dict.fromkeys(curve.data_path for curve in curves if not curve.mute))


def _of_animation(obj: bpy.types.Object) -> Iterator[str]:
    """Yield warnings about animation of properties read once, and about keys outside the hard
    limits (lowest and highest key of each path). Raises InputError for an animated kind, modality
    or other constant property of an effect."""
    paths = animated_paths(obj)
    for path in paths:
        if _FIXED.fullmatch(path) and obj.hfx.role == "EFFECT":
            raise InputError(
                f"{titled(obj)}: {path} is animated, and cannot be: it is the same at all times."
            )
        if _STEADY.fullmatch(path):
            yield f"{titled(obj)}: {path} is animated; what it is now is taken for all times"
    if obj.hfx.role == "EFFECT" and (lost := clips.lost_strips(obj)):
        yield f"{titled(obj)}: nothing is played of clips without keyframes: {named(lost)}"
    # Overshoot between two keys within the limits is common and intended, so only keys are checked.
    curves = compat.all_fcurves(obj)
    for path in paths:
        limits = _limits(obj, path)
        if limits is None:
            continue
        keys = [p.co[1] for c in curves if c.data_path == path for p in c.keyframe_points]
        keys = [key for key in keys if key == key]  # NaN is reported by non_finite_keyframes
        if not keys:
            continue
        # A key at the limit itself differs from it by float32 rounding.
        for value, limit in ((min(keys), limits[0]), (max(keys), limits[1])):
            if (value - limit) * (1 if limit == limits[1] else -1) > 1e-5 * max(abs(limit), 1.0):
                yield (
                    f"{titled(obj)}: a key of {path} is {value:g}, allowed is {limits[0]:g} to "
                    f"{limits[1]:g}; {limit:g} is taken"
                )


def _limits(obj: bpy.types.Object, path: str) -> tuple[float, float] | None:
    """Hard minimum and maximum of a float or integer property below ``hfx``, else None."""
    if not path.startswith("hfx."):
        return None
    group, _, name = path.rpartition(".")
    try:
        definition = obj.path_resolve(group).bl_rna.properties[name]
    except (ValueError, KeyError, AttributeError):
        return None  # the path of a removed entry moves nothing
    is_number = definition.type in ("FLOAT", "INT")
    return (definition.hard_min, definition.hard_max) if is_number else None
