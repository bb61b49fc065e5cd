# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances of haptic volumes in the open scene.

A live scene is described once, so each source has a fixed number of slots. An instance keeps its
slot while present; instances without a free slot are left out.
"""

from __future__ import annotations

from dataclasses import replace

import bpy

from ...authoring.effects.effect_values import ShapeCache
from ...blender.scene_info import scene_objects
from ...engine.scene import EffectDescription
from ..description.scene_description import HapticObjects
from ..stepped import instances
from ..stepped.instances import Key
from ..stepped.scene_rows import EffectRow

FEWEST = 64
"""Slots of a source without present instances, for particles of later frames."""


class LiveInstances:
    """Slots for the instances of a scene's volumes."""

    def __init__(self, haptics: HapticObjects, shapes: ShapeCache) -> None:
        self._layer = haptics.layer
        self._sources = instances.Sources(haptics, shapes)
        self._slots: dict[str, list[Key | None]] = {}
        descriptions: list[EffectDescription] = []
        for source, count in self._counts(haptics.scene).items():
            slots = min(max(FEWEST, 2 * count), instances.MOST)
            self._slots[source] = [None] * slots
            described = self._sources.described(source)
            descriptions += [
                replace(described, id=f"{described.id}:~{k}", name=f"{described.name} ~{k}")
                for k in range(slots)
            ]
        self.descriptions = tuple(descriptions)

    def _counts(self, scene: bpy.types.Scene) -> dict[str, int]:
        """Sources with present or possible instances -> number of present instances, sorted."""
        scene_members = set(scene_objects(scene))
        counts = {
            name: 0 for name, obj in self._sources.objects.items() if obj not in scene_members
        }
        if self._sources.objects:
            for name, _, _ in self._sources.keys_now(self._layer.depsgraph):
                counts[name] = counts.get(name, 0) + 1
        return dict(sorted(counts.items()))

    def rows(self) -> tuple[list[EffectRow], list[bool]]:
        """Effect row of each slot, and True for slots with the same instance as in the last
        call."""
        if not self._slots:
            return [], []
        current = self._sources.rows_now(self._layer.depsgraph)
        rows: list[EffectRow] = []
        stays: list[bool] = []
        for source, slots in self._slots.items():
            own_rows = {key: row for key, row in current.items() if key[0] == source}
            before = list(slots)
            for k, key in enumerate(slots):
                if key not in own_rows:
                    slots[k] = None
            new_keys = sorted(set(own_rows) - set(slots))
            for k, key in enumerate(slots):
                if key is None and new_keys:
                    slots[k] = new_keys.pop(0)
            for key, old in zip(slots, before, strict=True):
                rows.append(EffectRow() if key is None else own_rows[key])
                stays.append(key is not None and key == old)
        return rows, stays
