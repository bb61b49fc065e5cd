# SPDX-License-Identifier: GPL-3.0-or-later
"""Detects volumes that come near skin: only of these the inside of a mesh must be known.

Boxes here are larger than those that the engine tests, so that it never asks for more than the
bounds of what counts as far.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..engine.body.model import load_model
from ..engine.scene import BodyDescription, PoseBlock, SkinBinding
from .scene_rows import EffectRow

F64 = npt.NDArray[np.float64]

_ROUNDING = 1e-6
"""Margin on all sides of a box, as a share of the largest coordinate."""

_CORNERS = np.stack(np.meshgrid((0, 1), (0, 1), (0, 1), indexing="ij"), axis=-1).reshape(8, 3)

Box = tuple[F64, F64]
"""Lowest and highest corner in the world, (3,) each."""


class SkinBoxes:
    """Boxes around all skin of a body that volumes of some modalities can meet.

    Parameters
    ----------
    body : BodyDescription
    model_ids : set of str
        The perceptual models that these volumes are felt on.
    """

    def __init__(self, body: BodyDescription, model_ids: set[str]) -> None:
        self._binding = body.binding
        self._parts: list[tuple[F64, list[int]]] = []
        if not isinstance(body.binding, SkinBinding):
            return
        number = {name: k for k, name in enumerate(body.binding.bone_names)}
        for model_id in sorted(model_ids):
            model, fitted = load_model(model_id), body.binding.fitted.get(model_id)
            model = model if fitted is None else fitted.of(model)
            ends = np.stack([model.vertices.min(axis=0), model.vertices.max(axis=0)])
            corners = ends[_CORNERS, np.arange(3)].astype(np.float64)
            self._parts.append((corners, [number[b] for b in model.bone_names if b in number]))

    def over(self, pose: PoseBlock) -> Box | None:
        """The box over the times of a block; None where it is not known.

        A vertex is a mean of what its bones make of it, so that it is in the box of what any
        bone makes of any place of the body at rest.
        """
        if not isinstance(self._binding, SkinBinding):
            return None
        if not pose.valid.any():
            return np.full(3, np.inf), np.full(3, -np.inf)  # nobody is there
        if pose.bones is None:
            return None
        bones, to_world = pose.bones[pose.valid], pose.to_world[pose.valid]
        lows, highs = [], []
        for corners, which in self._parts:
            moved = bones[:, which, :, :3] @ corners.T + bones[:, which, :, 3:]
            lows.append(moved.min(axis=(1, 3)))
            highs.append(moved.max(axis=(1, 3)))
        return swept_box(to_world, np.stack([np.min(lows, axis=0), np.max(highs, axis=0)], axis=1))


def swept_box(matrices: F64, bounds: F64) -> Box:
    """Box around all positions of rotating boxes, from each time to the next.

    Parameters
    ----------
    matrices : (T, 4, 4) float64
        Places of the boxes' space in the world.
    bounds : (T, 2, 3) float64
        Lowest and highest corners.
    """
    middle, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
    linear, origins = matrices[:, :3, :3], matrices[:, :3, 3]
    centres = np.einsum("tij,tj->ti", linear, middle) + origins
    reaches = np.einsum("tij,tj->ti", np.abs(linear), half)
    low, high = (centres - reaches).min(axis=0), (centres + reaches).max(axis=0)
    arms = np.einsum("tij,tj->ti", np.abs(linear), np.abs(middle) + half)
    more = _ROUNDING * float(np.maximum(np.abs(low), np.abs(high)).max())
    if (linear != linear[0]).any():
        more += float(np.sqrt(np.square(arms).sum(axis=1).max()))
    return low - more, high + more


def comes_near(rows: Sequence[EffectRow], skins: Sequence[Box | None]) -> bool:
    """Test that a volume may meet any of some boxes at these times, or between two of them."""
    on = [row for row in rows if not row.level <= 0.0]
    if not on:
        return False
    if any(row.matrix is None or row.shape is None for row in on):
        return True
    matrices = np.stack([row.matrix for row in on if row.matrix is not None])
    bounds = np.stack([row.shape.bounds for row in on if row.shape is not None])
    low, high = swept_box(matrices, bounds)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return True
    # Not "and": a box that is no number may be anywhere.
    return any(
        skin is None or not ((low > skin[1]).any() or (high < skin[0]).any()) for skin in skins
    )
