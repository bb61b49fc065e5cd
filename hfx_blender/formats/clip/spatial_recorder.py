# SPDX-License-Identifier: GPL-3.0-or-later
"""Recorder of the animation for the spatial part of a clip, block by block."""

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
    HapticSurface,
    HapticVolume,
    PaintedArea,
    SceneDescription,
)
from ...engine.texture.haptic_map import SurfaceRenderer
from ...engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from . import DETAIL

SHAPES: Final = (Cuboid, Sphere, Cylinder, Capsule)

EffectState = dict[str, npt.NDArray[Any]]
"""State of an effect at its first active sample.

``level``, the highest of all samples, and ``parameters`` (P,) of that sample; ``shape``, an
index into :data:`SHAPES`, and ``half_segment``; ``matrix`` (4, 4) and ``controls``
(filters, WIDTH) of the response at the first active sample. Painted areas
and surfaces: shape and half segment 0.
"""


class SpatialRecorder:
    """Recorder of the first state and highest level of a scene's volumes, painted areas and
    micro-collision surfaces. ``detail`` is the level of detail of the models in the clip; 0 stores
    all vertices."""

    def __init__(self, scene: SceneDescription, detail: int = DETAIL) -> None:
        self.scene, self.detail = scene, detail
        self._found: dict[int, EffectState] = {}
        self._others: set[int] = set()

    def add(self, block: AnimationBlock) -> None:
        """Record the own active, finite samples of the next block in time order: the first state
        and highest level of each painted area, MCHA surface, and volume of a shape that clips have.
        Other effects with samples are marked as left out."""
        for k, effect in enumerate(self.scene.effects):
            # Only active samples with finite values count: inactive ones may hold anything.
            animated = block.effects[k]
            rows = np.arange(len(block.indices))[block.own]
            rows = rows[animated.levels[rows] > 0.0]
            rows = rows[np.isfinite(animated.parameters[rows]).all(axis=1)]
            if animated.matrices is not None:
                rows = rows[(np.abs(animated.matrices[rows]) <= FARTHEST).all(axis=(1, 2))]
            if not len(rows):
                continue
            is_volume = isinstance(effect.area, HapticVolume) and animated.matrices is not None
            has_shape = bool(animated.shapes) and isinstance(animated.shapes[0], SHAPES)
            is_mapped = isinstance(effect.area, HapticSurface) and (
                effect.area.texture.renderer is SurfaceRenderer.MCHA
            )
            if isinstance(effect.area, PaintedArea) or is_mapped or (is_volume and has_shape):
                self._keep(k, _state(effect, animated, rows))
            else:
                self._others.add(k)

    def _keep(self, k: int, seen: EffectState) -> None:
        """Store the first state of effect ``k``, later only a higher level and its parameters."""
        # Players begin with the first state, at the highest level of all samples.
        known = self._found.setdefault(k, seen)
        if float(seen["level"]) > float(known["level"]):
            known["level"], known["parameters"] = seen["level"], seen["parameters"]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Arrays by ``<effect number>.<name>``, and ``others``: unsupported effects."""
        arrays = {
            f"{k}.{name}": values
            for k, state in self._found.items()
            for name, values in state.items()
        }
        return {**arrays, "others": np.array(sorted(self._others), np.int64)}

    def replace(self, parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> None:
        """Replace the recording by :meth:`arrays` of several recorders, joined in time order."""
        self._found, self._others = {}, set()
        for part in parts:
            self._others |= set(part["others"].tolist())
            for k in range(len(self.scene.effects)):
                if f"{k}.level" in part:
                    names = ("level", "parameters", "shape", "half_segment", "matrix", "controls")
                    self._keep(k, {name: part[f"{k}.{name}"] for name in names})

    def effects(self) -> list[tuple[EffectDescription, EffectState]]:
        """Active effects of supported areas in scene order, each with its state."""
        return [(self.scene.effects[k], seen) for k, seen in sorted(self._found.items())]

    def left_out(self) -> list[str]:
        """Names of active effects of unsupported areas (meshes, spots, drives, surfaces of further
        renderers), in scene order."""
        return [self.scene.effects[k].name for k in sorted(self._others - set(self._found))]


def _state(
    effect: EffectDescription, animated: EffectBlock, rows: npt.NDArray[np.int64]
) -> EffectState:
    """State of an effect: level (at most 1) and parameters of the strongest of the sample ``rows``.
    Shape, matrix and clipped response controls are those of the first row of ``rows``; a painted
    area or surface has shape 0, the unit matrix and no controls."""
    best = rows[int(np.argmax(animated.levels[rows]))]
    shape, half, matrix = 0, 0.0, np.eye(4)
    controls = np.zeros((0, WIDTH))
    if isinstance(effect.area, HapticVolume) and animated.matrices is not None:
        first = animated.shapes[0]
        shape, matrix = SHAPES.index(type(first)), animated.matrices[rows[0]]  # type: ignore[arg-type]
        half = first.half_segment if isinstance(first, Capsule) else 0.0
        # Players start responses from the limits-checked controls of the first active
        # sample.
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
