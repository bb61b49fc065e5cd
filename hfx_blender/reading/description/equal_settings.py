# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of objects with equal stored settings, so that a value is derived once for a group."""

import marshal
from collections.abc import Callable, Hashable, Iterable, Mapping
from contextlib import suppress
from typing import Any, Final, TypeVar

import bpy

Value = TypeVar("Value")
_EMPTY: Final = marshal.dumps([], 2)


class EqualSettings:
    """Groups of objects without animation by their stored values, see
    :func:`..visibility.stored_of`; the unique id has no influence. An object that is animated,
    refers to a data-block or is not in ``stored`` forms a separate group."""

    def __init__(self, stored: Mapping[bpy.types.Object, dict[str, Any]]) -> None:
        self._keys: dict[bpy.types.Object, bytes] = {}
        for obj, values in stored.items():
            settings = values["hfx"]
            if isinstance(settings, dict) and isinstance(settings.get("uid"), str):
                values = {**values, "hfx": {**settings, "uid": ""}}
            # As bytes NaN equals NaN, and 1 is neither True nor 1.0. Later versions than 2 write
            # equal values as different bytes, and data-blocks raise ValueError.
            with suppress(ValueError):
                key = marshal.dumps(values, 2)
                # An empty array hides the type of its elements.
                if _EMPTY not in key and obj.animation_data is None:
                    self._keys[obj] = key

    def group_of(self, obj: bpy.types.Object) -> Hashable:
        """Key of an object's group; for a separate group the object."""
        return self._keys.get(obj, obj)

    def distinct(self, objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
        """The last of the ``objects`` of each group."""
        return [*{self.group_of(obj): obj for obj in objects}.values()]

    def shared(self, work: Callable[..., Value]) -> Callable[..., Value]:
        """Function that calls ``work(obj, *more)`` for the first object of a group, and returns the
        same value for the rest of the group with equal ``more``. ``work`` reads only stored
        settings and animation of ``obj``, and values shared by all objects."""
        known: dict[tuple[Hashable, ...], Value] = {}
        keys = self._keys

        def value(obj: bpy.types.Object, *more: Hashable) -> Value:
            key = (keys.get(obj, obj), *more)
            if key not in known:
                known[key] = work(obj, *more)
            return known[key]

        return value
