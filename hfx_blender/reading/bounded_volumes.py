# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes within a box known before reading: still, or moved by keyframes alone.

A scene may hold thousands of these, such as props with an effect, most of them out of reach. They
are placed in bulk, and read in full only in blocks in which skin meets the box.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from math import isfinite, nan
from typing import Final

import bpy
import numpy as np

from ..authoring.effects import effect_values
from ..blender import compat
from ..engine.active_rows import FARTHEST
from ..engine.arrays import Bool
from ..engine.scene import EffectBlock, PoseBlock, SceneDescription
from ..engine.volume.shape import inverse_placement
from .curves.animation_curves import limits_of
from .curves.curve_reading import CurveEffect
from .description.activation import Activation, ActivationSource
from .description.scene_description import HapticObjects
from .stepped.stepped_reading import VolumePlacements, are_close
from .stepped.stepped_volumes import FarVolumes
from .stepped.stepping import Stepper

_FEWEST: Final = 32
"""Least number of volumes for which boxes of skin cost less than reading every volume."""

_COMPARED: Final = 16
"""Least number of keyed volumes read in full, for the comparison with Blender's evaluation."""

_PATHS: Final = ("CURVE", "SURFACE", "FONT")
"""Types of parents that may move children along a path."""

_PLACING: Final = ("location", "delta_location", "scale", "delta_scale")
_TURNS: Final = ("rotation_euler", "rotation_quaternion", "rotation_axis_angle")


class BoundedVolumes:
    """Volumes of a scene that are always on, with finite values and a usable placement, and within
    a known box at all times.

    ``numbers`` are their indices in the scene description, ascending, ``keyed`` those of volumes
    with F-curves. ``effect(k)`` is volume ``k`` in full, made by ``make`` at the first request.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, make: Callable[[int], CurveEffect]
    ) -> None:
        stays: dict[bpy.types.Object, bool] = {}
        states = dict(zip(found.effects, found.activations, strict=True))
        is_usable = found.equal.shared(lambda effect: _is_usable(effect, states[effect]))
        usable = [k for k in found.active if is_usable(found.effects[k])]
        plain = [k for k in usable if _is_held(found.effects[k], stays)]
        self._volumes = FarVolumes(found, scene, plain)
        shown = self._volumes.read(Stepper(found.scene, found.layer))
        self._matrices = effect_values.to_metres(shown.matrices, found.unit_m)
        # A flattened volume gives a warning even far from skin, so it is not bounded here.
        is_placed = inverse_placement(self._matrices)[1] & (shown.boxes[:, 1] > 0.0).all(axis=1)
        is_placed &= shown.there & (np.abs(self._matrices) <= FARTHEST).all(axis=(1, 2))
        effects = [found.effects[k] for k in self._volumes.numbers]
        rows = np.flatnonzero([effect.animation_data is not None for effect in effects])
        limits = np.array([_limits(effects[row]) for row in rows]).reshape(-1, 4, 3, 2)
        places, shifts, scales, factors = limits.transpose(1, 0, 3, 2)
        scales = scales * factors
        # A ball around the origin of the object holds the volume however it turns.
        reaches = np.linalg.norm(shown.boxes[rows, 1] * np.abs(scales).max(axis=1), axis=1)
        around = places + shifts + reaches[:, None, None] * [[-1.0], [1.0]]
        # A volume outside of its box is moved by more than its keys. No scale may pass through 0.
        matrices, boxes = shown.matrices.copy(), shown.boxes.copy()
        now = shown.matrices[rows, :3, 3]
        is_known = (around[:, 0] <= now) & (now <= around[:, 1]) & (scales.prod(axis=1) > 0.0)
        is_known &= (np.abs(around) * found.unit_m <= FARTHEST).all(axis=1)
        is_placed[rows] &= is_known.all(axis=1)
        matrices[rows], boxes[rows] = np.eye(4), around
        # Some remain among the volumes that are read, and so compared with Blender: all of few.
        rows = rows[is_placed[rows]]
        is_placed[rows[:: max(len(rows) // _COMPARED, 1)]] = False
        self._places = VolumePlacements(is_placed[None], matrices[None], boxes[None])
        around = self._volumes.around(self._places)
        self._low, self._high = (corners[is_placed] for corners in around)
        self.numbers = tuple(np.array(self._volumes.numbers, np.int64)[is_placed].tolist())
        self.keyed = frozenset(self._volumes.numbers[row] for row in rows if is_placed[row])
        self._rows = dict(zip(self.numbers, np.flatnonzero(is_placed).tolist(), strict=True))
        self.effect = cache(make)
        self._read: dict[int, EffectBlock] = {}

    def are_near(self, poses: Sequence[PoseBlock]) -> Bool:
        """Mask (n,) over ``numbers``: the box of the volume meets the box of a body's skin during
        a block. All True for fewer than 32 volumes, and for skin of unknown place. ``poses``: one
        block for each body of the scene."""
        if len(self.numbers) < _FEWEST:
            return np.ones(len(self.numbers), np.bool_)
        return self._volumes.meet(self._low, self._high, poses)

    def still_block(self, which: int, count: int) -> EffectBlock:
        """Block of a still volume by index at ``count`` equal times; shared by equal calls."""
        known = self._read.get(which)
        if known is None or len(known.levels) != count:
            effect = self.effect(which)
            known = effect.read(np.zeros(count))
            assert known.matrices is not None
            shown = self._matrices[self._rows[which]].copy()
            shown[:3, :3] *= effect.scale
            # Far from the origin Blender rounds sums of parents to float32, and its place counts.
            if count and not are_close(known.matrices[0], shown).all():
                known = replace(known, matrices=np.repeat(shown[None], count, axis=0))
            self._read[which] = known
        return known


def _is_usable(effect: bpy.types.Object, state: Activation) -> bool:
    """Test for a volume with a formula, always on, with finite values."""
    hfx = effect.hfx
    has_formula = hfx.kind == "VOLUME" and hfx.shape != "MESH"
    if not has_formula or state.source is not ActivationSource.ALWAYS_ON:
        return False
    names = ("intensity", "group_gain", *effect_values.properties_of(hfx.modality))
    return all(isfinite(getattr(hfx, name)) for name in names) and hfx.intensity > 0.0


def _is_held(effect: bpy.types.Object, stays: dict[bpy.types.Object, bool]) -> bool:
    """Test that nothing moves an object, or only F-curves, without a parent. Results are cached in
    ``stays``, see :func:`_stays`."""
    if effect.animation_data is None:
        return _stays(effect, stays)
    return not _is_moved(effect) and effect.parent is None


def _stays(obj: bpy.types.Object, known: dict[bpy.types.Object, bool]) -> bool:
    """Test that neither animation, constraints, physics nor a parent moves an object; results are
    cached in ``known``."""
    if obj not in known:
        known[obj] = False  # ends a cycle of parents
        parent = obj.parent
        known[obj] = not (obj.animation_data or _is_moved(obj)) and (
            parent is None
            or (obj.parent_type == "OBJECT" and parent.type not in _PATHS and _stays(parent, known))
        )
    return known[obj]


def _is_moved(obj: bpy.types.Object) -> bool:
    """Test for constraints and physics of an object's own."""
    return bool(obj.rigid_body or obj.soft_body or len(obj.constraints))


def _limits(effect: bpy.types.Object) -> list[list[list[float]]]:
    """Lowest and highest value over all frames of each component of location, delta location, scale
    and delta scale, (4, 3, 2); NaN if F-curves are unbounded or change more than the placement, and
    with drivers and NLA tracks."""
    data = effect.animation_data
    # A component without a curve keeps its value, as with a muted curve.
    limits = {name: [[value, value] for value in getattr(effect, name)] for name in _PLACING}
    is_known = not (len(data.drivers) or len(data.nla_tracks) or data.use_tweak_mode)
    for curve in compat.fcurves(effect):
        path, (low, high) = curve.data_path, limits_of(curve)
        is_known &= path in (*limits, *_TURNS) and isfinite(high - low)
        if is_known and path in limits:
            span = limits[path][curve.array_index]
            span[:] = min(low, span[0]), max(high, span[1])
    return [*limits.values()] if is_known else [[[nan] * 2] * 3] * 4
