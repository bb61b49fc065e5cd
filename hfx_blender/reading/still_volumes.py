# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that nothing moves or changes: placed in bulk, and read in full only near skin.

A scene may hold thousands of these, such as props with an effect, most of them out of reach.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Final

import bpy
import numpy as np

from ..authoring.effects import effect_values
from ..engine.active_rows import FARTHEST
from ..engine.arrays import Bool
from ..engine.scene import EffectBlock, PoseBlock, SceneDescription
from ..engine.volume.shape import inverse_placement
from .curves.curve_reading import CurveEffect
from .description.activation import Activation, ActivationSource
from .description.scene_description import HapticObjects
from .stepped.stepped_reading import VolumePlacements, are_close
from .stepped.stepped_volumes import FarVolumes
from .stepped.stepping import Stepper

_FEWEST: Final = 32
"""Smallest number of still volumes for which boxes of skin cost less than reading each volume."""

_PATHS: Final = ("CURVE", "SURFACE", "FONT")
"""Types of parents that may move children along a path."""


class StillVolumes:
    """Still volumes of a scene that are always on, with finite values and a usable placement.

    ``numbers`` are their indices in the scene description, ascending.
    ``make(k)`` reads volume ``k`` in full; called once, for volumes near skin.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, make: Callable[[int], CurveEffect]
    ) -> None:
        stays: dict[bpy.types.Object, bool] = {}
        pairs = [*zip(found.effects, found.activations, strict=True)]
        still = [k for k in found.active if _is_still(*pairs[k], stays)]
        self._volumes = FarVolumes(found, scene, still)
        shown = self._volumes.read(Stepper(found.scene, found.layer))
        self._matrices = effect_values.to_metres(shown.matrices, found.unit_m)
        # A flattened volume gives a warning even far from skin, so it is not still here.
        is_placed = inverse_placement(self._matrices)[1] & (shown.boxes[:, 1] > 0.0).all(axis=1)
        is_placed &= shown.there & (np.abs(self._matrices) <= FARTHEST).all(axis=(1, 2))
        self._places = VolumePlacements(is_placed[None], shown.matrices[None], shown.boxes[None])
        self.numbers = tuple(np.array(self._volumes.numbers, np.int64)[is_placed].tolist())
        self._rows = dict(zip(self.numbers, np.flatnonzero(is_placed).tolist(), strict=True))
        self._make = make
        self._read: dict[int, EffectBlock] = {}

    def are_near(self, poses: Sequence[PoseBlock]) -> Bool:
        """Mask (n,) over ``numbers`` of volumes with a box that meets a body's skin box over a
        block; True for unknown skin, and for all of few. ``poses``: one per body of the scene."""
        if len(self.numbers) < _FEWEST:
            return np.ones(len(self.numbers), np.bool_)
        return self._volumes.are_near(self._places, poses)[self._places.there[0]]

    def block(self, which: int, count: int) -> EffectBlock:
        """Block of a volume by index at ``count`` times, equal at all; shared by equal calls."""
        known = self._read.get(which)
        if known is None or len(known.levels) != count:
            effect = self._make(which)
            known = effect.read(np.zeros(count))
            assert known.matrices is not None
            shown = self._matrices[self._rows[which]].copy()
            shown[:3, :3] *= effect.scale
            # Far from the origin Blender rounds sums of parents to float32, and its place counts.
            if count and not are_close(known.matrices[0], shown).all():
                known = replace(known, matrices=np.repeat(shown[None], count, axis=0))
            self._read[which] = known
        return known


def _is_still(
    effect: bpy.types.Object, state: Activation, stays: dict[bpy.types.Object, bool]
) -> bool:
    """Test for a volume with a formula, always on, with finite values and without any motion."""
    hfx = effect.hfx
    if hfx.kind != "VOLUME" or hfx.shape == "MESH" or not _stays(effect, stays):
        return False
    names = ("intensity", "group_gain", *effect_values.properties_of(hfx.modality))
    are_finite = all(isfinite(getattr(hfx, name)) for name in names)
    return state.source is ActivationSource.ALWAYS_ON and are_finite and hfx.intensity > 0.0


def _stays(obj: bpy.types.Object, known: dict[bpy.types.Object, bool]) -> bool:
    """Test that neither animation, constraints, physics nor a parent moves an object; results are
    cached in ``known``."""
    if obj not in known:
        known[obj] = False  # ends a cycle of parents
        parent = obj.parent
        is_moved = obj.animation_data or obj.rigid_body or obj.soft_body or len(obj.constraints)
        known[obj] = not is_moved and (
            parent is None
            or (obj.parent_type == "OBJECT" and parent.type not in _PATHS and _stays(parent, known))
        )
    return known[obj]
