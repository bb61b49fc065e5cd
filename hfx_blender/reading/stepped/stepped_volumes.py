# SPDX-License-Identifier: GPL-3.0-or-later
"""Bulk reading of the placements of stepped volumes, and bounding boxes of skin and volumes.

Placements and boxes of all volumes are read at once; a volume far from skin needs no other values.
Boxes here contain the boxes of the engine's broad phase, so that a skipped volume can never touch.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property

import bpy
import numpy as np

from ...authoring import responses
from ...authoring.effects import effect_values
from ...blender import compat
from ...blender.stored_values import limited, limited_vector
from ...engine.arrays import F32, F64, I64, Bool
from ...engine.body.levels_and_cells import cell_of_skin
from ...engine.body.model import load_model
from ...engine.scene import (
    BodyDescription,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SurfaceBinding,
)
from ..curves.animation_curves import limits_of
from ..description.scene_description import HapticObjects
from ..description.soundness import SIZES
from ..description.visibility import is_keyed
from .stepped_reading import SceneRow, VolumePlacements
from .stepping import Stepper

_ROUNDING = 1e-6
"""Margin on all sides of a box, as a fraction of the largest coordinate."""

Box = tuple[F64, F64]
"""Lowest and highest corner in world space, (3,) or (N, 3) each, metres."""


class FarVolumes:
    """Stepped volumes that are read completely only while near skin.

    ``effects`` are indices of stepped effects; effects felt independently of the place, and effects
    of unknown size, are excluded. Attributes are indices in the scene description: ``numbers`` of
    the N volumes; ``in_full``, volumes near skin in the last block with more varying values than
    the placement, which are read completely; ``not_seen_on``, volumes without any active sample so
    far.
    """

    def __init__(
        self, found: HapticObjects, scene: SceneDescription, effects: Sequence[int]
    ) -> None:
        volumes = [found.effects[k] for k in effects]
        is_mesh = found.equal.shared(lambda effect: effect.hfx.shape == "MESH")
        half_size = found.equal.shared(_half_size)
        # The size of a mesh is not in the settings.
        sizes = [_half_size(effect) if is_mesh(effect) else half_size(effect) for effect in volumes]
        halves = dict(zip(effects, sizes, strict=True))
        half_sizes = {k: half for k, half in halves.items() if half is not None}
        self.numbers = tuple(half_sizes)
        self._effects = [found.effects[k] for k in half_sizes]
        self._is_mesh = np.array([*map(is_mesh, self._effects)], np.bool_)
        self._has_mesh = bool(self._is_mesh.any())
        corners = np.array([*half_sizes.values()], np.float64).reshape(-1, 3)
        self._still = np.stack([-corners, corners], axis=1)
        self._listed: dict[Stepper, tuple[int, I64, list[int]]] = {}
        self.in_full: set[int] = set()
        self.not_seen_on = {*self.numbers}
        self._states = [found.activations[k] for k in self.numbers]
        self._ids = [scene.effects[k].id for k in self.numbers]
        self._unit_m = found.unit_m
        self._scene = scene

    @cached_property
    def _skins(self) -> "list[SkinBoxes]":
        """Boxes of the skin of each body."""
        model_ids = {self._scene.effects[k].model_id for k in self.numbers}
        return [SkinBoxes(body, model_ids) for body in self._scene.bodies]

    def read(self, stepper: Stepper) -> VolumePlacements:
        """Placements of all N volumes at the present frame, Blender units. Boxes of meshes are NaN
        if empty or outside the list of evaluated objects."""
        listed = stepper.objects
        count = len(listed)
        # The row of each volume in the list is cached until the length changes; with animated
        # visibility two objects may swap places at equal length.
        cached = self._listed.get(stepper)
        if cached is None or cached[0] != count or stepper.is_changing:
            number = {evaluated.original: k for k, evaluated in enumerate(listed)}
            listed_rows = [number.get(effect, -1) for effect in self._effects]
            missing = [k for k, row in enumerate(listed_rows) if row < 0]
            cached = count, np.maximum(np.array(listed_rows, np.int64), 0), missing
            self._listed[stepper] = cached
        _, rows, missing = cached
        there = np.full(len(self.numbers), True)
        matrices = _all(listed, "matrix_world", count, 16).reshape(-1, 4, 4)[rows]
        matrices = matrices.transpose(0, 2, 1).astype(np.float64)
        boxes = self._still
        if self._has_mesh:
            # Blender may give the box of a subdivided mesh's cage, which contains the surface. An
            # empty mesh has a box of one point.
            corners = _all(listed, "bound_box", count, 24).reshape(-1, 8, 3)[rows]
            corners = corners.astype(np.float64)
            boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
            boxes[(boxes[:, 0] == boxes[:, 1]).all(axis=1)] = np.nan
            boxes[~self._is_mesh] = self._still[~self._is_mesh]
        # Hidden volumes and volumes outside the view layer are not listed.
        for k in missing:
            evaluated = stepper.evaluated(self._effects[k])
            there[k] = evaluated.is_evaluated and not evaluated.hide_viewport
            if there[k]:
                matrices[k] = effect_values.world_matrix(evaluated)
                boxes[k] = np.where(self._is_mesh[k], np.nan, boxes[k])
        return VolumePlacements(there, matrices, boxes)

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
        return self.meet(*self.around(places), poses) & places.there.any(axis=0)

    def around(self, places: VolumePlacements) -> Box:
        """Boxes around the volumes over all times of ``places``, (N, 3), metres."""
        matrices = places.matrices.copy()
        matrices[..., :3, :] *= self._unit_m
        return swept_boxes(matrices, places.boxes, places.there)

    def meet(self, low: F64, high: F64, poses: Sequence[PoseBlock]) -> Bool:
        """Test which of N boxes meet the skin of any body at any time of a block: mask (N,). The
        boxes are the corners returned by :meth:`around`."""
        # Compare by "not apart" instead of "overlapping", so that a NaN box counts as near.
        is_near = np.zeros(len(low), np.bool_)
        for skin, pose in zip(self._skins, poses, strict=True):
            box = skin.over(pose)
            is_near |= box is None or ~((low > box[1]).any(axis=1) | (high < box[0]).any(axis=1))
        return is_near


def _all(objects: bpy.types.bpy_prop_collection, name: str, count: int, width: int) -> F32:
    """Flat float32 array of a property with ``width`` numbers of ``count`` objects; zeros of a
    single object if there are none."""
    flat = np.zeros(max(count, 1) * width, np.float32)
    if count:
        objects.foreach_get(name, flat)
    return flat


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
    # A capsule is as long as its diameter at least.
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
            if len(curves) < sum(c.data_path == path for c in compat.all_fcurves(effect)):
                return None  # NLA strips may combine
            is_driven = any(driver.data_path == path for driver in data.drivers)
            if data.action_blend_type != "REPLACE" or is_driven:
                return None
            limits = effect.hfx.bl_rna.properties[name]
            default = max(limits.default_array) if name == "size" else limits.default
            most = max(most, default, *(limits_of(curve)[1] for curve in curves))
        if not np.isfinite(most):
            return None
        sizes += [most] * len(now) if most > max(now) else now
    return sizes


class SkinBoxes:
    """World boxes around all skin of a body that volumes can touch; ``model_ids`` are the
    perceptual models of these volumes' effects."""

    def __init__(self, body: BodyDescription, model_ids: set[str]) -> None:
        self._binding = body.binding
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)  # rest pose
        self._bones: set[int] = set()  # indices of bones with any skin weight
        self._bulge_m = 0.0
        models = [load_model(model_id) for model_id in sorted(model_ids)]
        finer = [cell_of_skin(model)[0] for model in models if model.modality == "temperature"]
        for model in {loaded.id: loaded for loaded in (*models, *map(load_model, finer))}.values():
            shapes = [model]
            if isinstance(body.binding, SkinBinding):
                # A fitted model has the vertices of this body instead of the canonical ones.
                fitted = body.binding.fitted.get(model.id)
                rest = model if fitted is None else fitted.of(model)
                shapes.append(rest)
                self._low = np.minimum(self._low, rest.vertices.min(axis=0))
                self._high = np.maximum(self._high, rest.vertices.max(axis=0))
                names = {*rest.bone_names}
                bones = enumerate(body.binding.bone_names)
                self._bones.update(k for k, name in bones if name in names)
            # Skin bulges beyond its vertices by less than the longest triangle side.
            for shape in shapes:
                corners = shape.vertices[shape.triangles]
                sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
                self._bulge_m = max(self._bulge_m, float(sides.max(initial=0.0)))

    def over(self, pose: PoseBlock) -> Box | None:
        """World box of the skin over all valid times of a block and between; (inf, -inf) without a
        valid time, None without bones and surface."""
        if not pose.valid.any():
            return np.full(3, np.inf), np.full(3, -np.inf)  # disabled at all times: an empty box
        to_world = pose.to_world[pose.valid]
        if pose.surface is not None:
            assert isinstance(self._binding, SurfaceBinding)
            # A haptic vertex lies beyond its triangle of the avatar where a barycentric weight is
            # negative: by at most the sum of these weights times the sides of the box, on both
            # sides of the triangle. Its offset along the normal comes on top.
            anchors = self._binding.anchors.values()
            beyond = [np.maximum(-a.weights, 0.0).sum(axis=1).max(initial=0.0) for a in anchors]
            above = [np.abs(anchor.offset_m).max(initial=0.0) for anchor in anchors]
            surface = pose.surface[pose.valid]
            low = surface.min(axis=1).astype(np.float64)
            high = surface.max(axis=1).astype(np.float64)
            more = 2.0 * max(beyond, default=0.0) * (high - low).max(axis=1, keepdims=True)
            more += max(above, default=0.0) + self._bulge_m
            return swept_box(to_world, np.stack([low - more, high + more], axis=1))
        if pose.bones is None:
            return None
        bones = pose.bones[pose.valid][:, sorted(self._bones)]
        middle, half = 0.5 * (self._low + self._high), 0.5 * (self._high - self._low)
        # A skinned vertex is a convex combination of its rest position under several bones, so the
        # union of the rest box under every bone contains the vertex. Interval arithmetic: a box
        # under a matrix spans |matrix| times its half size around the centre.
        centres = np.einsum("tbij,j->tbi", bones[..., :3], middle) + bones[..., 3]
        reaches = np.einsum("tbij,j->tbi", np.abs(bones[..., :3]), half) + self._bulge_m
        low, high = (centres - reaches).min(axis=1), (centres + reaches).max(axis=1)
        return swept_box(to_world, np.stack([low, high], axis=1))


def swept_box(matrices: F64, bounds: F64) -> Box:
    """World box, two corners (3,), around a moving box at all times and between. ``matrices`` (T,
    4, 4) map box space to world, ``bounds`` (T, 2, 3) are lowest and highest corners. See
    :func:`swept_boxes`."""
    is_present = np.ones((len(matrices), 1), np.bool_)
    low, high = swept_boxes(matrices[:, None], bounds[:, None], is_present)
    return low[0], high[0]


def swept_boxes(matrices: F64, bounds: F64, is_present: Bool) -> Box:
    """World boxes around N moving boxes over all times and between them: lowest and highest corners
    (N, 3). ``matrices`` (T, N, 4, 4) and boxes ``bounds`` (T, N, 2, 3) count where ``is_present``
    (T, N). Boxes reach from -inf to inf if any counted number is not finite, and are empty (inf,
    -inf) if never present."""
    middle, half = bounds.mean(axis=2), 0.5 * (bounds[:, :, 1] - bounds[:, :, 0])
    linear, origins = matrices[..., :3, :3], matrices[..., :3, 3]
    counts = is_present[..., None]
    centres = np.einsum("tnij,tnj->tni", linear, middle) + origins
    reaches = np.einsum("tnij,tnj->tni", np.abs(linear), half)
    known = ~is_present | (np.isfinite(centres) & np.isfinite(reaches)).all(axis=2)
    low = (centres - reaches).min(axis=0, initial=np.inf, where=counts)
    high = (centres + reaches).max(axis=0, initial=-np.inf, where=counts)
    # A rotation between two times may carry a corner farther out than at both: at most as far as
    # the corner's distance from the origin of rotation, added on all sides where the matrix turns.
    arms = np.einsum("tnij,tnj->tni", np.abs(linear), np.abs(middle) + half)
    first = linear[is_present.argmax(axis=0), np.arange(is_present.shape[1])]
    turns = ((linear != first) & counts[..., None]).any(axis=(0, 2, 3))
    longest = np.sqrt(np.square(arms).sum(axis=2).max(axis=0, initial=0.0, where=is_present))
    margin = np.where(turns, longest, 0.0) + _ROUNDING * np.maximum(np.abs(low), np.abs(high)).max(
        axis=1
    )
    is_known = known.all(axis=0)[:, None]
    with np.errstate(invalid="ignore"):  # inf - inf of absent volumes
        low, high = low - margin[:, None], high + margin[:, None]
    return np.where(is_known, low, -np.inf), np.where(is_known, high, np.inf)
