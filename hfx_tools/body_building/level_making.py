# SPDX-License-Identifier: GPL-3.0-or-later
"""Building of levels of detail: a model with a subset of its vertices, for quick previews."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.levels_and_cells import LEVELS_FILE, Level
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.body.parts import RIGHT
from hfx_blender.files.atomic import atomic_file

SHARES: Final = (4, 16)
"""Divisors of the number of vertices at levels 1, 2 ..."""

FEWEST: Final = 1000
"""Smallest number of vertices of a model with levels of detail."""


def coarser(model: PerceptualModel, vertices: int) -> Level:
    """Decimate a model by quadrics, recording the coarse vertex of each vertex.

    The left half is decimated and mirrored, so the level is as symmetric as the model. Each coarse
    vertex is a vertex of the model, nearest to the optimum of its merged cluster, so poses, fits
    and bindings of the model apply to its levels too.
    Source: Garland and Heckbert, SIGGRAPH 1997, in fast-simplification.

    ``vertices``: approximate number of remaining vertices; at least 8.

    Raises
    ------
    ValueError
        ``vertices`` is under 8, or not below the model's number of vertices.
    """
    import fast_simplification

    if not 8 <= vertices < len(model):
        raise ValueError(f"vertices: expected 8 to {len(model) - 1}, got {vertices}")
    half = np.flatnonzero(model.side != RIGHT)
    inside = model.triangles[(model.side[model.triangles] != RIGHT).all(axis=1)]
    points = np.ascontiguousarray(model.vertices[half])
    faces = np.searchsorted(half, inside).astype(np.int32)
    target_count = max(4, round(len(faces) * vertices / len(model)))
    _, _, collapses = fast_simplification.simplify(
        points, faces, target_count=target_count, return_collapses=True
    )
    optima, triangles, coarse_of = fast_simplification.replay_simplification(
        points, faces, collapses
    )
    vertex_of = half[_nearest_members(points.astype(np.float64), optima, coarse_of)]
    coarse_id = np.zeros(len(model), np.int64)  # coarse vertex of each fine one
    coarse_id[half] = vertex_of[coarse_of]
    right = np.flatnonzero(model.side == RIGHT)
    coarse_id[right] = model.mirror[coarse_id[model.mirror[right]]]
    on_left = vertex_of[triangles.astype(np.int64)]
    all_triangles = np.concatenate((on_left, model.mirror[on_left][:, ::-1]))
    coarse_ids = np.unique(coarse_id)
    return Level(
        vertices=coarse_ids.astype(np.int32),
        triangles=np.searchsorted(coarse_ids, all_triangles).astype(np.int32),
        coarse_of=np.searchsorted(coarse_ids, coarse_id).astype(np.int32),
    )


def _nearest_members(points: F64, optima: F64, coarse_of: I64) -> I64:
    """Index of the nearest merged point of each coarse vertex, (C,)."""
    distance = np.linalg.norm(points - optima[coarse_of], axis=1)
    order = np.lexsort((distance, coarse_of))
    first = np.flatnonzero(np.diff(coarse_of[order], prepend=-1))
    return order[first]


def save(model: PerceptualModel, folder: Path) -> int:
    """Build and write all levels of a model; returns their number, 0 for a coarse model."""
    if len(model) < FEWEST:
        return 0
    arrays = {}
    for number, share in enumerate(SHARES, start=1):
        level = coarser(model, len(model) // share)
        for name in ("vertices", "triangles", "coarse_of"):
            arrays[f"{number}.{name}"] = getattr(level, name)
    with atomic_file(folder / LEVELS_FILE.format(modality=model.modality)) as file:
        np.savez_compressed(file, model=np.array([model.id, model.content_hash]), **arrays)
    return len(SHARES)
