# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances of haptic volumes in the open scene; some appear, others vanish.

A live scene is described once, so each source has slots: an instance keeps the one that it was
given while it is there, and what there is no slot for is left out.
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
"""Slots of a source that nothing makes instances of yet, particles that are still to be born."""


class LiveInstances:
    """Slots for the instances of one scene's volumes."""

    def __init__(self, found: HapticObjects, shapes: ShapeCache) -> None:
        self._layer = found.layer
        self._sources = instances.Sources(found, shapes)
        self._slots: dict[str, list[Key | None]] = {}
        descriptions: list[EffectDescription] = []
        for source, count in self._counts(found.scene).items():
            slots = min(max(FEWEST, 2 * count), instances.MOST)
            self._slots[source] = [None] * slots
            described = self._sources.described(source)
            descriptions += [
                replace(described, id=f"{described.id}:~{k}", name=f"{described.name} ~{k}")
                for k in range(slots)
            ]
        self.descriptions = tuple(descriptions)

    def _counts(self, scene: bpy.types.Scene) -> dict[str, int]:
        """Volumes with instances now, or possibly at another time, and their number."""
        here = set(scene_objects(scene))
        counts = {name: 0 for name, obj in self._sources.objects.items() if obj not in here}
        if self._sources.objects:
            for name, _, _ in self._sources.keys_now(self._layer.depsgraph):
                counts[name] = counts.get(name, 0) + 1
        return dict(sorted(counts.items()))

    def rows(self) -> tuple[list[EffectRow], list[bool]]:
        """Row of each slot now, and whether the slot still holds the same instance."""
        if not self._slots:
            return [], []
        now = self._sources.rows_now(self._layer.depsgraph)
        rows: list[EffectRow] = []
        stays: list[bool] = []
        for source, slots in self._slots.items():
            mine = {key: row for key, row in now.items() if key[0] == source}
            before = list(slots)
            for k, key in enumerate(slots):
                if key not in mine:
                    slots[k] = None
            fresh = sorted(set(mine) - set(slots))
            for k, key in enumerate(slots):
                if key is None and fresh:
                    slots[k] = fresh.pop(0)
            for key, old in zip(slots, before, strict=True):
                rows.append(EffectRow() if key is None else mine[key])
                stays.append(key is not None and key == old)
        return rows, stays
