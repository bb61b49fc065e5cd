# SPDX-License-Identifier: GPL-3.0-or-later
"""Recorder of the animation that the spatial part of a clip needs, block by block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.active_rows import FARTHEST
from ...engine.response_filters.controls import WIDTH
from ...engine.response_filters.filters import within_limits
from ...engine.scene import (
    AnimationBlock,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    SceneDescription,
)
from ...engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from . import DETAIL

SHAPES: Final = (Cuboid, Sphere, Cylinder, Capsule)


Seen = dict[str, npt.NDArray[Any]]
"""An effect as a game begins with it.

``level``, the highest, and ``parameters`` (P,) at that moment; ``shape``, an index into
:data:`SHAPES`, and ``half_segment``; ``matrix`` (4, 4) where it is first on, and ``controls``
(filters, WIDTH) of its response there. Painted: shape 0, half segment 0.
"""


class SpatialRecorder:
    """Recorder of a scene's volumes and painted areas: their beginnings and highest levels.

    Parameters
    ----------
    detail : int
        Level of detail of the models in the clip, of those that have several; 0 is all vertices.
    """

    def __init__(self, scene: SceneDescription, detail: int = DETAIL) -> None:
        self.scene, self.detail = scene, detail
        self._found: dict[int, Seen] = {}
        self._others: set[int] = set()

    def add(self, block: AnimationBlock) -> None:
        """Take the next block, in the order of time."""
        for k, effect in enumerate(self.scene.effects):
            animated = block.effects[k]
            rows = np.arange(len(block.indices))[block.own]
            rows = rows[animated.levels[rows] > 0.0]
            rows = rows[np.isfinite(animated.parameters[rows]).all(axis=1)]
            if animated.matrices is not None:
                rows = rows[(np.abs(animated.matrices[rows]) <= FARTHEST).all(axis=(1, 2))]
            if not len(rows):
                continue
            if _is_spatial(effect, animated):
                self._keep(k, _seen(effect, animated, rows))
            else:
                self._others.add(k)

    def _keep(self, k: int, seen: Seen) -> None:
        """Keep the first moment of an effect, and its strongest."""
        known = self._found.setdefault(k, seen)
        if float(seen["level"]) > float(known["level"]):
            known["level"], known["parameters"] = seen["level"], seen["parameters"]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Recorded values as arrays that one process can hand on to another."""
        found = {f"{k}.{name}": each for k, of in self._found.items() for name, each in of.items()}
        return {**found, "others": np.array(sorted(self._others), np.int64)}

    def replace(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Replace what was recorded by that of others, given in the order of time."""
        self._found, self._others = {}, set()
        for part in parts:
            self._others |= set(part["others"].tolist())
            for k in range(len(self.scene.effects)):
                if f"{k}.level" in part:
                    names = ("level", "parameters", "shape", "half_segment", "matrix", "controls")
                    self._keep(k, {name: part[f"{k}.{name}"] for name in names})

    def effects(self) -> list[tuple[EffectDescription, Seen]]:
        """Volumes and painted areas that are ever on, in the order of the scene."""
        return [(self.scene.effects[k], seen) for k, seen in sorted(self._found.items())]

    def left_out(self) -> list[str]:
        """Names of effects that a player cannot evaluate."""
        return [self.scene.effects[k].name for k in sorted(self._others - set(self._found))]


def _is_spatial(effect: EffectDescription, animated: EffectBlock) -> bool:
    if isinstance(effect.area, PaintedArea):
        return True
    is_volume = isinstance(effect.area, HapticVolume) and animated.matrices is not None
    return is_volume and bool(animated.shapes) and isinstance(animated.shapes[0], SHAPES)


def _seen(effect: EffectDescription, animated: EffectBlock, rows: npt.NDArray[np.int64]) -> Seen:
    """An effect in some rows of a block."""
    best = rows[int(np.argmax(animated.levels[rows]))]
    shape, half, matrix = 0, 0.0, np.eye(4)
    controls = np.zeros((0, WIDTH))
    if isinstance(effect.area, HapticVolume) and animated.matrices is not None:
        first = animated.shapes[0]
        shape, matrix = SHAPES.index(type(first)), animated.matrices[rows[0]]  # type: ignore[arg-type]
        half = first.half_segment if isinstance(first, Capsule) else 0.0
        if animated.response is not None:
            filters = effect.area.response
            controls = within_limits(filters, animated.response[rows[:1]])[0]
    return {
        "level": np.array(min(float(animated.levels[best]), 1.0)),
        "parameters": animated.parameters[best],
        "shape": np.array(shape),
        "half_segment": np.array(half),
        "matrix": matrix,
        "controls": controls,
    }
