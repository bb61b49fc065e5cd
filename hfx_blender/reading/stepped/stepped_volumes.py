# SPDX-License-Identifier: GPL-3.0-or-later
"""Placements of volumes that only Blender can place: all are read at once, and little of each.

A place and a box tell that a volume is near no skin; then nothing else of it is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy
import numpy as np

from ...authoring import responses
from ...authoring.effects import effect_values
from ...blender import compat
from ...blender.stored_values import limited, limited_vector
from ...engine.arrays import F32, F64, I64, Bool
from ...engine.scene import PoseBlock, SceneDescription
from ..description.response_values import highest_of
from ..description.scene_description import HapticObjects
from ..description.soundness import SIZES
from ..description.visibility import is_keyed
from .nearness import SkinBoxes, swept_boxes
from .scene_rows import Places, Row
from .stepping import Stepper


class FarVolumes:
    """Volumes that are stepped, and read in full only while they are near skin.

    Parameters
    ----------
    effects : sequence of int
        Effects that are stepped, and silent where they are far. Those whose place does not decide
        where they can be felt are left out.

    Attributes
    ----------
    numbers : tuple of int
        Numbers of the effects, (N,).
    in_full : set of int
        Effects that were near at last, and of which more than a place is unknown: they are read
        at once.
    not_seen_on : set of int
        Effects that were not on yet at any time.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, effects: Sequence[int]
    ) -> None:
        halves = {k: _half_size(found.effects[k]) for k in effects}
        known = {k: half for k, half in halves.items() if half is not None}
        self.numbers = tuple(known)
        self._effects = [found.effects[k] for k in known]
        self._is_mesh = np.array([each.hfx.shape == "MESH" for each in self._effects], np.bool_)
        self._has_mesh = bool(self._is_mesh.any())
        corners = np.array([*known.values()], np.float64).reshape(-1, 3)
        self._still = np.stack([-corners, corners], axis=1)
        self._listed: dict[Stepper, tuple[int, I64, list[int]]] = {}
        self.in_full: set[int] = set()
        self.not_seen_on = {*self.numbers}
        self._states = [found.activations[k] for k in self.numbers]
        self._ids = [scene.effects[k].id for k in self.numbers]
        self._unit_m = found.unit_m
        model_ids = {scene.effects[k].model_id for k in self.numbers}
        self._skins = [SkinBoxes(body, model_ids) for body in scene.bodies if self.numbers]

    def read(self, stepper: Stepper) -> Places:
        """Read their placements at the present time."""
        listed = stepper.objects
        count = len(listed)
        rows, missing = self._rows(stepper, listed, count)
        there = np.full(len(self.numbers), True)
        matrices = _all(listed, "matrix_world", count, 16).reshape(-1, 4, 4)[rows]
        matrices = matrices.transpose(0, 2, 1).astype(np.float64)
        boxes = self._still
        if self._has_mesh:
            corners = _all(listed, "bound_box", count, 24).reshape(-1, 8, 3)[rows]
            boxes = _boxes(corners.astype(np.float64))
            boxes[~self._is_mesh] = self._still[~self._is_mesh]
        for k in missing:
            evaluated = stepper.evaluated(self._effects[k])
            there[k] = evaluated.is_evaluated and not evaluated.hide_viewport
            if there[k]:
                matrices[k] = effect_values.world_matrix(evaluated)
                boxes[k] = np.where(self._is_mesh[k], np.nan, boxes[k])
        return Places(there, matrices, boxes)

    def _rows(
        self, stepper: Stepper, objects: bpy.types.bpy_prop_collection, count: int
    ) -> tuple[I64, list[int]]:
        """Rows of the volumes among the objects that a scene shows, and those not among them.

        Their order changes only where some are shown or hidden.
        """
        known = self._listed.get(stepper)
        if known is None or known[0] != count or stepper.is_changing:
            number = {each.original: k for k, each in enumerate(objects)}
            found = [number.get(effect, -1) for effect in self._effects]
            missing = [k for k, row in enumerate(found) if row < 0]
            known = count, np.maximum(np.array(found, np.int64), 0), missing
            self._listed[stepper] = known
        return known[1:]

    def may_be_on(self, frames: F64) -> Bool:
        """Volumes that may be on at frames of the animation, (N, T)."""
        found = [state.may_be_on(frames) for state in self._states]
        return np.array(found, np.bool_).reshape(len(found), len(frames))

    def seen_on(self, there: Bool, may_be_on: Bool, stepper: Stepper) -> list[str]:
        """Ids of volumes that are on for the first time, at the present time of a scene.

        Parameters
        ----------
        there, may_be_on : (N,) bool
            Volumes that are not disabled now, and that may be on in the present block.
        """
        found = []
        for n in np.flatnonzero(there & may_be_on).tolist():
            if self.numbers[n] not in self.not_seen_on:
                continue
            evaluated = stepper.evaluated(self._effects[n])
            is_there = evaluated.is_evaluated and not evaluated.hide_viewport
            if is_there and self._states[n].level(evaluated.hfx) > 0.0:
                found.append(self._ids[n])
                self.not_seen_on.discard(self.numbers[n])
        return found

    def places(self, rows: Iterable[Row]) -> Places:
        """Their places over the T times of a block, in arrays (T, N, ...)."""
        read = [row.places for row in rows if row.places is not None]
        return Places(
            np.array([each.there for each in read]),
            np.array([each.matrices for each in read]),
            np.array([each.boxes for each in read]),
        )

    def are_near(self, places: Places, poses: Sequence[PoseBlock]) -> Bool:
        """Volumes that may meet the skin of any body at the times of a block, or between, (N,)."""
        matrices = places.matrices.copy()
        matrices[..., :3, :] *= self._unit_m
        low, high = swept_boxes(matrices, places.boxes, places.there)
        # Not "and": a box that is no number may be anywhere.
        found = np.zeros(len(low), np.bool_)
        for skin, pose in zip(self._skins, poses, strict=True):
            box = skin.over(pose)
            found |= box is None or ~((low > box[1]).any(axis=1) | (high < box[0]).any(axis=1))
        return found & places.there.any(axis=0)


def _all(objects: bpy.types.bpy_prop_collection, name: str, count: int, width: int) -> F32:
    """A property of all objects, (count or 1, width): where there are none, of one that is not."""
    flat = np.zeros(max(count, 1) * width, np.float32)
    if count:
        objects.foreach_get(name, flat)
    return flat


def _boxes(corners: F64) -> F64:
    """Boxes (N, 2, 3) around corners (N, 8, 3); NaN where they are one point, as of no mesh.

    Of a subdivided mesh Blender may give the corners of its cage, which it lies within.
    """
    boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    boxes[(boxes[:, 0] == boxes[:, 1]).all(axis=1)] = np.nan
    return boxes


def _half_size(effect: bpy.types.Object) -> list[float] | None:
    """Half of the size that a volume has at most, (3,) Blender's units.

    Of a mesh NaN: its box is read. None where no such is known, or a place does not decide
    where an effect can be felt: it is no volume, or has filters that go on ringing.
    """
    hfx = effect.hfx
    if hfx.kind != "VOLUME" or responses.active_filters(hfx) or is_keyed(effect, "hfx.shape"):
        return None
    if hfx.shape == "MESH":
        is_read = effect.type == "MESH" and effect.mode != "EDIT"
        return [np.nan] * 3 if is_read else None
    known = _largest(effect, hfx.shape)
    if known is None:
        return None
    if hfx.shape == "CUBOID":
        return [each / 2 for each in known]
    radius = known[0]
    if hfx.shape == "SPHERE":
        return [radius] * 3
    half = known[1] / 2
    return [radius, radius, half if hfx.shape == "CYLINDER" else max(half, radius)]


def _largest(effect: bpy.types.Object, shape: str) -> list[float] | None:
    """The largest values of the properties that the size of a shape follows from."""
    found = []
    for name in SIZES[shape]:
        now = limited_vector(effect.hfx, name) if name == "size" else (limited(effect.hfx, name),)
        most = max(now)
        path = f"hfx.{name}"
        if is_keyed(effect, path):
            data = effect.animation_data
            curves = [c for c in compat.fcurves(effect) if c.data_path == path]
            every = [c for each in compat.curve_collections(effect) for c in each]
            if len(curves) < sum(c.data_path == path for c in every):
                return None  # strips may add to each other
            is_driven = any(each.data_path == path for each in data.drivers)
            if data.action_blend_type != "REPLACE" or is_driven:
                return None
            limits = effect.hfx.bl_rna.properties[name]
            default = max(limits.default_array) if name == "size" else limits.default
            most = max(most, default, *map(highest_of, curves))
        if not np.isfinite(most):
            return None
        found += [most] * len(now) if most > max(now) else now
    return found
