# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances of haptic volumes in the open scene as it stands: some come, others go.

A live scene is described once, so each source has slots: an instance keeps the one that it was
given while it is there, and what there is no slot for is left out.
"""

from __future__ import annotations

from dataclasses import replace

import bpy

from ..engine.scene import EffectDescription
from . import instances
from .effect_values import Shapes
from .instances import Key
from .scene_rows import EffectRow

FEWEST = 64
"""Slots of a source that nothing makes instances of yet, particles that are still to be born."""


class LiveInstances:
    """Slots for the instances of one scene's volumes.

    Parameters
    ----------
    scene : bpy.types.Scene
    layer : bpy.types.ViewLayer
    shapes : Shapes
    """

    def __init__(self, scene: bpy.types.Scene, layer: bpy.types.ViewLayer, shapes: Shapes) -> None:
        self._scene, self._layer, self._shapes = scene, layer, shapes
        self._slots: dict[str, list[Key | None]] = {}
        found: list[EffectDescription] = []
        for source, count in instances.possible_sources(scene, layer.depsgraph).items():
            slots = min(max(FEWEST, 2 * count), instances.MOST)
            self._slots[source] = [None] * slots
            described = instances.described(scene, bpy.data.objects[source])
            found += [
                replace(described, id=f"{described.id}:~{k}", name=f"{described.name} ~{k}")
                for k in range(slots)
            ]
        self.descriptions = tuple(found)
        self._last: dict[tuple[str, int], Key | None] = {}

    def rows(self) -> tuple[list[EffectRow], list[bool]]:
        """Each slot now, and whether it holds what it held when it was asked for last."""
        if not self._slots:
            return [], []
        now = instances.rows_now(self._scene, self._layer.depsgraph, self._shapes)
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
