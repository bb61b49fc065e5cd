# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: a perceptual model with fewer vertices, for quick previews."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..model import PerceptualModel

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Level:
    """A coarse stand-in for a model, for display only: nothing refers to its vertex ids."""

    vertices: F32  # (C, 3) rest space, metres
    triangles: I32  # (F, 3)
    coarse_of: I32  # (V,) coarse vertex that stands for each vertex of the model
    nearest: I32  # (C,) vertex of the model whose weights and values a coarse vertex takes


def coarser(model: PerceptualModel, vertices: int) -> Level:
    """Decimate a model by quadrics, keeping where each vertex went.

    Source: Garland and Heckbert, SIGGRAPH 1997, in fast-simplification.

    Parameters
    ----------
    vertices : int
        How many to keep, about; at least 4.

    Raises
    ------
    ValueError
        ``vertices`` is under 4, or not fewer than the model has.
    """
    import fast_simplification
    from scipy.spatial import cKDTree

    if not 4 <= vertices < len(model):
        raise ValueError(f"vertices: expected 4 to {len(model) - 1}, got {vertices}")
    points = np.ascontiguousarray(model.vertices)
    _, _, collapses = fast_simplification.simplify(
        points, model.triangles, target_count=2 * vertices - 4, return_collapses=True
    )
    coarse, triangles, coarse_of = fast_simplification.replay_simplification(
        points, model.triangles, collapses
    )
    nearest = cKDTree(points).query(coarse)[1]
    return Level(
        vertices=coarse.astype(np.float32),
        triangles=triangles.astype(np.int32),
        coarse_of=coarse_of.astype(np.int32),
        nearest=nearest.astype(np.int32),
    )
