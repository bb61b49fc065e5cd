# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that effects and bodies can be read: stored values, keys, animated properties.

A .blend may come from anybody. What is wrong with one effect costs that effect alone, and each
value that is not read as it stands is told.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import bpy
import numpy as np

from ...authoring.effects import effects
from ...blender import compat, stored_values
from ...blender.stored_values import BadValue
from ...engine.modality import MODALITIES
from ...errors import InputError

MOST_FILTERS = 64
"""Filters of one contact response; each costs time at every sample."""

_OF_BODIES = frozenset({"follow", "avatar", "avatar_parts", "fit_kept", "bone_map", "uid"})
_OF_NOBODY = frozenset({"envelope", "response_active", "bone_map_active", "bone_map_region"})
SIZES = {
    "CUBOID": ("size",),
    "SPHERE": ("radius",),
    "CYLINDER": ("radius", "height"),
    "CAPSULE": ("radius", "height"),
}
"""Properties that the size of a volume follows from, by its shape."""

_LARGEST = np.finfo(np.float32).max
"""Infinity, as Blender stores it in a key."""

_FIXED = re.compile(
    r"hfx\.(role|kind|modality|response\[\d+\]\.(kind|operation|about|domain|is_muted))"
)
"""Animated paths that an effect cannot have: it would be another effect at another time."""

_STEADY = re.compile(
    r"hfx\.(falloff|falloff_share|temperature_reference|is_muted|is_solo|follow|surface\..*)"
)
"""Animated paths that are read once."""


def warnings_of(obj: bpy.types.Object) -> list[str]:
    """Warnings about values of an effect or a body that are not read as they are stored.

    Raises
    ------
    InputError
        It cannot be read at all.
    """
    animated = {path for path in animated_paths(obj) if not _STEADY.fullmatch(path)}
    warned = []
    for bad in stored_values.bad_values(obj):
        if f"hfx.{bad.path}" in animated:
            continue  # its present value was evaluated; each sample is checked when it is read
        if not _counts(obj, bad):
            warned.append(f"{titled(obj)}: {bad}; it is ignored")
        elif bad.taken is None or bad.top == "surface":
            raise InputError(f"{titled(obj)}: {bad}.")
        else:
            warned.append(f"{titled(obj)}: {bad}; {bad.taken} is taken")
    if len(obj.hfx.response) > MOST_FILTERS:
        raise InputError(
            f"{titled(obj)}: its contact response has {len(obj.hfx.response)} filters, at most "
            f"{MOST_FILTERS} are allowed."
        )
    return warned + list(_of_weights(obj)) + list(_of_animation(obj))


def without_faulty(
    objects: Iterable[bpy.types.Object], work: Callable[[bpy.types.Object], Any]
) -> tuple[dict[bpy.types.Object, Any], dict[bpy.types.Object, str]]:
    """Results of ``work`` for each object, and the errors of the others."""
    found, faults = {}, {}
    for obj in objects:
        try:
            found[obj] = work(obj)
        except InputError as error:
            faults[obj] = str(error)
    return found, faults


def left_out(faults: Mapping[bpy.types.Object, str]) -> tuple[str, ...]:
    """Warnings about the objects that were left out."""
    return tuple(f"{titled(o)} was left out: {why.removesuffix('.')}" for o, why in faults.items())


def titled(obj: bpy.types.Object) -> str:
    """An object as messages name it."""
    kind = {"EFFECT": "effect", "BODY": "body"}.get(obj.hfx.role, "object")
    return f"{kind} '{obj.name}'"


def non_finite_keyframes(objects: Iterable[bpy.types.Object]) -> tuple[str, ...]:
    """Notes on the keyframes of objects and their parents that are no finite numbers.

    They are evaluated as Blender does; where that gives no number, nothing is felt.
    """
    owners: dict[bpy.types.ID, str] = {}
    for mover in dict.fromkeys(each for obj in objects for each in _with_parents(obj)):
        for owner in filter(None, (mover, mover.data, getattr(mover.data, "shape_keys", None))):
            owners.setdefault(owner, mover.name)
    return tuple(
        note for owner, name in owners.items() for note in _non_finite(name, [*_curves_of(owner)])
    )


def _non_finite(name: str, curves: list[bpy.types.FCurve]) -> Iterator[str]:
    """Notes on the F-curves of an object of this name: the first such keyframe of each."""
    every = [np.zeros(len(curve.keyframe_points) * 2, np.float32) for curve in curves]
    for curve, keys in zip(curves, every, strict=True):
        curve.keyframe_points.foreach_get("co", keys)
    counts = np.cumsum([0, *map(len, every)])
    endless = np.flatnonzero(~(np.abs(np.concatenate([np.zeros(0, "f4"), *every])) < _LARGEST))
    places = np.searchsorted(counts, endless, "right") - 1
    for which in np.unique(places).tolist():
        first = int(endless[np.searchsorted(places, which)])
        number = (first - int(counts[which])) // 2 + 1
        yield (
            f"'{name}': key {number} of the F-curve '{curves[which].data_path}' "
            f"[{curves[which].array_index}] is not a finite number; correct or delete it"
        )


def _curves_of(owner: bpy.types.ID) -> Iterator[bpy.types.FCurve]:
    for curves in compat.curve_collections(owner):
        yield from curves


def _with_parents(obj: bpy.types.Object) -> list[bpy.types.Object]:
    found: dict[str, bpy.types.Object] = {}
    while obj is not None and obj.name_full not in found:
        found[obj.name_full] = obj
        obj = obj.parent
    return list(found.values())


def _counts(obj: bpy.types.Object, bad: BadValue) -> bool:
    """Test that a property affects samples; unknown properties do."""
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
    only = {"response": "VOLUME", "surface": "SURFACE", "path_position": "SPOT"}
    only |= {"drive": "ACTUATORS", "device": "ACTUATORS"}
    return hfx.kind == only[name] if name in only else True


def add_fault(faults: dict[str, set[int]], text: str, index: int) -> None:
    """Add a fault at a sample; those that differ after the colon only count as the first one."""
    head = text.partition(": ")[0]
    same = (known for known in faults if known.partition(": ")[0] == head)
    faults.setdefault(next(same, text), set()).add(index)


def animated_paths(obj: bpy.types.ID) -> list[str]:
    """Paths that curves or drivers of an object or other data write, each once."""
    data = obj.animation_data
    if data is None:
        return []
    every = (*_curves_of(obj), *data.drivers)
    return list(dict.fromkeys(curve.data_path for curve in every if not curve.mute))


def _of_weights(obj: bpy.types.Object) -> Iterator[str]:
    """Warning about painted weights that are none."""
    if obj.hfx.role == "EFFECT" and obj.hfx.kind == "PAINTED":
        bad = sum(not 0.0 <= weight <= 1.0 for weight in effects.area(obj)[1])
        if bad:
            yield (
                f"{titled(obj)}: {bad} painted weights are no numbers from 0 to 1; these vertices "
                "are not felt"
            )


def _of_animation(obj: bpy.types.Object) -> Iterator[str]:
    """Warnings about animated properties whose animation has no effect."""
    paths = animated_paths(obj)
    for path in paths:
        if _FIXED.fullmatch(path) and obj.hfx.role == "EFFECT":
            raise InputError(
                f"{titled(obj)}: {path} is animated, and cannot be: it is the same at all times."
            )
        if _STEADY.fullmatch(path):
            yield f"{titled(obj)}: {path} is animated; what it is now is taken for all times"
    # Curves that swing past a limit between two keys within it are common, and meant so.
    curves = list(_curves_of(obj))
    for path in paths:
        limits = _limits(obj, path)
        if limits is None:
            continue
        keys = [p.co[1] for c in curves if c.data_path == path for p in c.keyframe_points]
        keys = [key for key in keys if key == key]  # NaN is told where it is read
        if not keys:
            continue
        for value, limit in ((min(keys), limits[0]), (max(keys), limits[1])):
            if (value - limit) * (1 if limit == limits[1] else -1) > 1e-5 * max(abs(limit), 1.0):
                yield (
                    f"{titled(obj)}: a key of {path} is {value:g}, allowed is {limits[0]:g} to "
                    f"{limits[1]:g}; {limit:g} is taken"
                )


def _limits(obj: bpy.types.Object, path: str) -> tuple[float, float] | None:
    """Range of an animated number of ours; None for other properties."""
    if not path.startswith("hfx."):
        return None
    group, _, name = path.rpartition(".")
    try:
        definition = obj.path_resolve(group).bl_rna.properties[name]
    except (ValueError, KeyError, AttributeError):
        return None  # of an entry that is there no more: it moves nothing
    if definition.type not in ("FLOAT", "INT"):
        return None
    return definition.hard_min, definition.hard_max
