# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounding boxes of skin and of moving volumes, for skipping volumes far from skin.

Boxes here contain the boxes of the engine's broad phase, so that a skipped volume can never touch.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.body.levels_and_cells import cell_of_skin
from ...engine.body.model import PerceptualModel, load_model
from ...engine.scene import BodyDescription, PoseBlock, SkinBinding, SurfaceBinding

_ROUNDING = 1e-6
"""Margin on all sides of a box, as a fraction of the largest coordinate."""

Box = tuple[F64, F64]
"""Lowest and highest corner in world space, (3,) or (N, 3) each, metres."""


class SkinBoxes:
    """World boxes around all skin of a body that volumes of some models can touch.

    Skin bulges beyond its vertices by less than the longest triangle side.

    Parameters
    ----------
    model_ids : set of str
        Perceptual models of these volumes' effects.
    """

    def __init__(self, body: BodyDescription, model_ids: set[str]) -> None:
        self._binding = body.binding
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)  # rest pose
        self._bones: set[int] = set()  # indices of bones with any skin weight
        self._bulge_m = 0.0
        models = [load_model(model_id) for model_id in sorted(model_ids)]
        finer = [cell_of_skin(model)[0] for model in models if model.modality == "temperature"]
        for model in {loaded.id: loaded for loaded in (*models, *map(load_model, finer))}.values():
            self._bulge_m = max(self._bulge_m, _longest_side(model))
            if isinstance(body.binding, SkinBinding):
                self._add(model, body.binding)

    def _add(self, model: PerceptualModel, binding: SkinBinding) -> None:
        """Extend rest box, bones and bulge by a model, in place; a model fitted to the body is used
        instead. Bones without a name in the model are left out."""
        fitted = binding.fitted.get(model.id)
        if fitted is not None:
            model = fitted.of(model)
            self._bulge_m = max(self._bulge_m, _longest_side(model))
        self._low = np.minimum(self._low, model.vertices.min(axis=0))
        self._high = np.maximum(self._high, model.vertices.max(axis=0))
        names = set(model.bone_names)
        self._bones.update(k for k, name in enumerate(binding.bone_names) if name in names)

    def over(self, pose: PoseBlock) -> Box | None:
        """World box of the skin over all valid times of a block and between; (inf, -inf) without a
        valid time, None without bones and surface. A skinned vertex is a convex combination of the
        bones' transforms of the rest position, so the union of the rest box under every bone
        contains the vertex."""
        if not pose.valid.any():
            return np.full(3, np.inf), np.full(3, -np.inf)  # disabled at all times: an empty box
        to_world = pose.to_world[pose.valid]
        if pose.surface is not None:
            return swept_box(to_world, self._of_surface(pose.surface[pose.valid]))
        if pose.bones is None:
            return None
        bones = pose.bones[pose.valid][:, sorted(self._bones)]
        middle, half = 0.5 * (self._low + self._high), 0.5 * (self._high - self._low)
        # Interval arithmetic: a box under a matrix spans |matrix| times its half size around the
        # centre.
        centres = np.einsum("tbij,j->tbi", bones[..., :3], middle) + bones[..., 3]
        reaches = np.einsum("tbij,j->tbi", np.abs(bones[..., :3]), half) + self._bulge_m
        low, high = (centres - reaches).min(axis=1), (centres + reaches).max(axis=1)
        return swept_box(to_world, np.stack([low, high], axis=1))

    def _of_surface(self, surface: npt.NDArray[np.float32]) -> F64:
        """Boxes (T, 2, 3) of all skin at T times, from the A avatar vertices (T, A, 3), both in the
        avatar's local space, metres. The box of the vertices is enlarged on all sides: by twice the
        largest negative barycentric weight of an anchor times the box's longest side, by the
        largest offset above the triangle, and by the bulge."""
        assert isinstance(self._binding, SurfaceBinding)
        anchors = self._binding.anchors.values()
        beyond = [np.maximum(-a.weights, 0.0).sum(axis=1).max(initial=0.0) for a in anchors]
        above = [np.abs(anchor.offset_m).max(initial=0.0) for anchor in anchors]
        low, high = surface.min(axis=1).astype(np.float64), surface.max(axis=1).astype(np.float64)
        more = 2.0 * max(beyond, default=0.0) * (high - low).max(axis=1, keepdims=True)
        more += max(above, default=0.0) + self._bulge_m
        return np.stack([low - more, high + more], axis=1)


def _longest_side(model: PerceptualModel) -> float:
    """Longest triangle side of a model in rest pose, metres."""
    corners = model.vertices[model.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(sides.max(initial=0.0))


def swept_box(matrices: F64, bounds: F64) -> Box:
    """World box, two corners (3,), around a moving box at all times and between.

    ``matrices`` (T, 4, 4) map box space to world, ``bounds`` (T, 2, 3) are lowest and highest
    corners. See :func:`swept_boxes`.
    """
    is_present = np.ones((len(matrices), 1), np.bool_)
    low, high = swept_boxes(matrices[:, None], bounds[:, None], is_present)
    return low[0], high[0]


def swept_boxes(matrices: F64, bounds: F64, is_present: npt.NDArray[np.bool_]) -> Box:
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
