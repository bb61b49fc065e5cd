# SPDX-License-Identifier: GPL-3.0-or-later
"""Bulk reading of the placements of stepped volumes, and the distance from skin.

Placements and boxes of all volumes are read at once; a volume far from skin needs no other values.
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
from .scene_rows import SceneRow, VolumePlacements
from .stepping import Stepper


class FarVolumes:
    """Stepped volumes that are read completely only while near skin.

    Parameters
    ----------
    effects : sequence of int
        Indices of stepped effects. Effects that are felt independently of the place, or whose
        size is unknown, are excluded.

    Attributes
    ----------
    numbers : tuple of int
        Indices of the N far volumes in the scene description.
    in_full : set of int
        Volumes near skin in the last block, of which not only placements vary: read completely.
    not_seen_on : set of int
        Volumes without any active sample so far.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, effects: Sequence[int]
    ) -> None:
        halves = {k: _half_size(found.effects[k]) for k in effects}
        half_sizes = {k: half for k, half in halves.items() if half is not None}
        self.numbers = tuple(half_sizes)
        self._effects = [found.effects[k] for k in half_sizes]
        self._is_mesh = np.array([effect.hfx.shape == "MESH" for effect in self._effects], np.bool_)
        self._has_mesh = bool(self._is_mesh.any())
        corners = np.array([*half_sizes.values()], np.float64).reshape(-1, 3)
        self._still = np.stack([-corners, corners], axis=1)
        self._listed: dict[Stepper, tuple[int, I64, list[int]]] = {}
        self.in_full: set[int] = set()
        self.not_seen_on = {*self.numbers}
        self._states = [found.activations[k] for k in self.numbers]
        self._ids = [scene.effects[k].id for k in self.numbers]
        self._unit_m = found.unit_m
        model_ids = {scene.effects[k].model_id for k in self.numbers}
        self._skins = [SkinBoxes(body, model_ids) for body in scene.bodies if self.numbers]

    def read(self, stepper: Stepper) -> VolumePlacements:
        """Placements of all N volumes at the present frame, Blender units; boxes of meshes outside
        the list of evaluated objects are NaN."""
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
        return VolumePlacements(there, matrices, boxes)

    def _rows(
        self, stepper: Stepper, objects: bpy.types.bpy_prop_collection, count: int
    ) -> tuple[I64, list[int]]:
        """Row (N,) of each volume in the list of evaluated objects (0 if absent), and the numbers n
        of absent volumes. Cached per stepper until ``count`` changes, never with animated
        visibility."""
        known = self._listed.get(stepper)
        if known is None or known[0] != count or stepper.is_changing:
            number = {evaluated.original: k for k, evaluated in enumerate(objects)}
            rows = [number.get(effect, -1) for effect in self._effects]
            missing = [k for k, row in enumerate(rows) if row < 0]
            known = count, np.maximum(np.array(rows, np.int64), 0), missing
            self._listed[stepper] = known
        return known[1:]

    def may_be_on(self, frames: F64) -> Bool:
        """Mask (N, T) of animation frames (T,) at which each volume may be on; a superset."""
        masks = [state.may_be_on(frames) for state in self._states]
        return np.array(masks, np.bool_).reshape(len(masks), len(frames))

    def seen_on(self, there: Bool, may_be_on: Bool, stepper: Stepper) -> list[str]:
        """Ids of volumes with a level above 0 for the first time, now; updates `not_seen_on`.
        ``there`` and ``may_be_on`` (N,) are enabled volumes, and volumes possibly on in the present
        block; both are required."""
        ids = []
        for n in np.flatnonzero(there & may_be_on).tolist():
            if self.numbers[n] not in self.not_seen_on:
                continue
            evaluated = stepper.evaluated(self._effects[n])
            is_there = evaluated.is_evaluated and not evaluated.hide_viewport
            if is_there and self._states[n].level(evaluated.hfx) > 0.0:
                ids.append(self._ids[n])
                self.not_seen_on.discard(self.numbers[n])
        return ids

    def places(self, rows: Iterable[SceneRow]) -> VolumePlacements:
        """Stack the placements of the T ``rows`` that have any, in their order, (T, N, ...); arrays
        of shape (0,) without such rows."""
        read = [row.places for row in rows if row.places is not None]
        return VolumePlacements(
            np.array([row.there for row in read]),
            np.array([row.matrices for row in read]),
            np.array([row.boxes for row in read]),
        )

    def are_near(self, places: VolumePlacements, poses: Sequence[PoseBlock]) -> Bool:
        """Mask (N,) of volumes present at any time whose box around all times of a block meets a
        body's skin box over the block; a NaN box and unknown skin count as near. ``poses``: one per
        body of the scene."""
        matrices = places.matrices.copy()
        matrices[..., :3, :] *= self._unit_m
        low, high = swept_boxes(matrices, places.boxes, places.there)
        # Compare by "not apart" instead of "overlapping", so that a NaN box counts as near.
        is_near = np.zeros(len(low), np.bool_)
        for skin, pose in zip(self._skins, poses, strict=True):
            box = skin.over(pose)
            is_near |= box is None or ~((low > box[1]).any(axis=1) | (high < box[0]).any(axis=1))
        return is_near & places.there.any(axis=0)


def _all(objects: bpy.types.bpy_prop_collection, name: str, count: int, width: int) -> F32:
    """Flat float32 array of a property with ``width`` numbers of ``count`` objects; zeros of a
    single object if there are none."""
    flat = np.zeros(max(count, 1) * width, np.float32)
    if count:
        objects.foreach_get(name, flat)
    return flat


def _boxes(corners: F64) -> F64:
    """Lowest and highest corner (N, 2, 3) of N sets of 8 corners (N, 8, 3); NaN for a single point,
    as of an empty mesh. Blender may give a subdivided mesh's cage, which contains the surface."""
    boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    boxes[(boxes[:, 0] == boxes[:, 1]).all(axis=1)] = np.nan
    return boxes


def _half_size(effect: bpy.types.Object) -> list[float] | None:
    """Half sizes (3,) of the largest box of a volume over all times, Blender units; NaN for a mesh.
    None if unknown (animated shape, size by drivers or strips, Edit Mode) or without a place: no
    volume, or response filters."""
    hfx = effect.hfx
    if hfx.kind != "VOLUME" or responses.active_filters(hfx) or is_keyed(effect, "hfx.shape"):
        return None
    if hfx.shape == "MESH":
        is_read = effect.type == "MESH" and effect.mode != "EDIT"
        return [np.nan] * 3 if is_read else None
    largest = _largest(effect, hfx.shape)
    if largest is None:
        return None
    if hfx.shape == "CUBOID":
        return [length / 2 for length in largest]
    radius = largest[0]
    if hfx.shape == "SPHERE":
        return [radius] * 3
    half = largest[1] / 2
    return [radius, radius, half if hfx.shape == "CYLINDER" else max(half, radius)]


def _largest(effect: bpy.types.Object, shape: str) -> list[float] | None:
    """Largest values over time of the size properties of ``shape``, clamped, concatenated; None
    with drivers, strips, blending actions or unbounded curves. An animated cuboid gets the largest
    side thrice."""
    sizes = []
    for name in SIZES[shape]:
        now = limited_vector(effect.hfx, name) if name == "size" else (limited(effect.hfx, name),)
        most = max(now)
        path = f"hfx.{name}"
        if is_keyed(effect, path):
            data = effect.animation_data
            curves = [c for c in compat.fcurves(effect) if c.data_path == path]
            all_curves = [c for curves in compat.curve_collections(effect) for c in curves]
            if len(curves) < sum(c.data_path == path for c in all_curves):
                return None  # NLA strips may combine
            is_driven = any(driver.data_path == path for driver in data.drivers)
            if data.action_blend_type != "REPLACE" or is_driven:
                return None
            limits = effect.hfx.bl_rna.properties[name]
            default = max(limits.default_array) if name == "size" else limits.default
            most = max(most, default, *map(highest_of, curves))
        if not np.isfinite(most):
            return None
        sizes += [most] * len(now) if most > max(now) else now
    return sizes
