# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around skin and around moving volumes; volumes clear of all skin are read no further.

Boxes here are larger than those that the engine tests, so that it never asks for more than the
bounds of what counts as far.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.body.model import PerceptualModel, load_model
from ...engine.body.temperature_cells import cell_of_skin
from ...engine.scene import BodyDescription, PoseBlock, SkinBinding, SurfaceBinding

_ROUNDING = 1e-6
"""Margin on all sides of a box, as a share of the largest coordinate."""

Box = tuple[F64, F64]
"""Lowest and highest corner in the world, (3,) each."""


class SkinBoxes:
    """Boxes around all skin of a body that volumes of some modalities can meet.

    Skin bulges beyond its vertices by less than they are apart.

    Parameters
    ----------
    model_ids : set of str
        The perceptual models that these volumes are felt on.
    """

    def __init__(self, body: BodyDescription, model_ids: set[str]) -> None:
        self._binding = body.binding
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)  # of all skin at rest
        self._bones: set[int] = set()  # that any of it follows
        self._bulge_m = 0.0
        models = [load_model(each) for each in sorted(model_ids)]
        finer = [cell_of_skin(each)[0] for each in models if each.modality == "temperature"]
        for model in {each.id: each for each in (*models, *map(load_model, finer))}.values():
            self._bulge_m = max(self._bulge_m, _longest_side(model))
            if isinstance(body.binding, SkinBinding):
                self._add(model, body.binding)

    def _add(self, model: PerceptualModel, binding: SkinBinding) -> None:
        fitted = binding.fitted.get(model.id)
        if fitted is not None:
            model = fitted.of(model)
            self._bulge_m = max(self._bulge_m, _longest_side(model))
        self._low = np.minimum(self._low, model.vertices.min(axis=0))
        self._high = np.maximum(self._high, model.vertices.max(axis=0))
        names = set(model.bone_names)
        self._bones.update(k for k, name in enumerate(binding.bone_names) if name in names)

    def over(self, pose: PoseBlock) -> Box | None:
        """The box over the times of a block; None where it is not known.

        A vertex is a mean of what its bones make of it, so that it is in the box of what any
        bone makes of any place of the body at rest.
        """
        if not pose.valid.any():
            return np.full(3, np.inf), np.full(3, -np.inf)  # nobody is there
        to_world = pose.to_world[pose.valid]
        if pose.surface is not None:
            return swept_box(to_world, self._of_surface(pose.surface[pose.valid]))
        if pose.bones is None:
            return None
        bones = pose.bones[pose.valid][:, sorted(self._bones)]
        middle, half = 0.5 * (self._low + self._high), 0.5 * (self._high - self._low)
        centres = np.einsum("tbij,j->tbi", bones[..., :3], middle) + bones[..., 3]
        reaches = np.einsum("tbij,j->tbi", np.abs(bones[..., :3]), half) + self._bulge_m
        low, high = (centres - reaches).min(axis=1), (centres + reaches).max(axis=1)
        return swept_box(to_world, np.stack([low, high], axis=1))

    def _of_surface(self, surface: npt.NDArray[np.float32]) -> F64:
        """Boxes (T, 2, 3) around skin that rides on an avatar's vertices (T, A, 3).

        It lies at most so far beyond a triangle, and above it, as its anchors say.
        """
        assert isinstance(self._binding, SurfaceBinding)
        anchors = self._binding.anchors.values()
        beyond = [np.maximum(-each.weights, 0.0).sum(axis=1).max(initial=0.0) for each in anchors]
        above = [np.abs(each.offset_m).max(initial=0.0) for each in anchors]
        low, high = surface.min(axis=1).astype(np.float64), surface.max(axis=1).astype(np.float64)
        more = 2.0 * max(beyond, default=0.0) * (high - low).max(axis=1, keepdims=True)
        more += max(above, default=0.0) + self._bulge_m
        return np.stack([low - more, high + more], axis=1)


def _longest_side(model: PerceptualModel) -> float:
    """Longest side of all triangles of a model, metres."""
    corners = model.vertices[model.triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(sides.max(initial=0.0))


def swept_box(matrices: F64, bounds: F64) -> Box:
    """Box around all positions of rotating boxes, from each time to the next.

    Parameters
    ----------
    matrices : (T, 4, 4) float64
        Places of the boxes' space in the world.
    bounds : (T, 2, 3) float64
        Lowest and highest corners.
    """
    there = np.ones((len(matrices), 1), np.bool_)
    low, high = swept_boxes(matrices[:, None], bounds[:, None], there)
    return low[0], high[0]


def swept_boxes(matrices: F64, bounds: F64, there: npt.NDArray[np.bool_]) -> Box:
    """Boxes of N moving volumes at once: corners (N, 3); infinite where a number is NaN.

    Parameters
    ----------
    matrices : (T, N, 4, 4) float64
    bounds : (T, N, 2, 3) float64
    there : (T, N) bool
        What is not there at a time counts for nothing; if it never is, its box is empty.
    """
    middle, half = bounds.mean(axis=2), 0.5 * (bounds[:, :, 1] - bounds[:, :, 0])
    linear, origins = matrices[..., :3, :3], matrices[..., :3, 3]
    counts = there[..., None]
    centres = np.einsum("tnij,tnj->tni", linear, middle) + origins
    reaches = np.einsum("tnij,tnj->tni", np.abs(linear), half)
    known = ~there | (np.isfinite(centres) & np.isfinite(reaches)).all(axis=2)
    low = (centres - reaches).min(axis=0, initial=np.inf, where=counts)
    high = (centres + reaches).max(axis=0, initial=-np.inf, where=counts)
    arms = np.einsum("tnij,tnj->tni", np.abs(linear), np.abs(middle) + half)
    first = linear[there.argmax(axis=0), np.arange(there.shape[1])]
    turns = ((linear != first) & counts[..., None]).any(axis=(0, 2, 3))
    longest = np.sqrt(np.square(arms).sum(axis=2).max(axis=0, initial=0.0, where=there))
    more = np.where(turns, longest, 0.0) + _ROUNDING * np.maximum(np.abs(low), np.abs(high)).max(
        axis=1
    )
    sure = known.all(axis=0)[:, None]
    with np.errstate(invalid="ignore"):  # of what is never there
        low, high = low - more[:, None], high + more[:, None]
    return np.where(sure, low, -np.inf), np.where(sure, high, np.inf)
