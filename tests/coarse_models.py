# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models at a level of detail, with all of their arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hfx_blender.engine.arrays import I32, expand
from hfx_blender.engine.body.levels_and_cells import level_of
from hfx_blender.engine.body.model import PerceptualModel, SkinWeights


def at_level(model: PerceptualModel, level: int) -> tuple[PerceptualModel, I32]:
    """Coarser copy of a model, and the mapping from the model's vertices to the copy's vertices.

    Parameters
    ----------
    level : int
        0 returns the model itself; see :func:`level_count`.

    Returns
    -------
    model : PerceptualModel
        Id ``<id>/level-<level>``; areas are sums over the represented vertices.
    coarse_of : (V,) int32
        Vertex of the copy for each vertex of the model.

    Raises
    ------
    InputError
        The model has no such level.
    """
    chosen = level_of(model, level)
    ids = chosen.vertices
    if level == 0:
        return model, ids
    areas = np.bincount(chosen.coarse_of, model.areas_m2, minlength=len(ids))
    coarse = replace(
        model,
        id=f"{model.id}/level-{level}",
        vertices=model.vertices[ids],
        triangles=chosen.triangles,
        normals=model.normals[ids],
        areas_m2=areas.astype(np.float32),
        part=model.part[ids],
        side=model.side[ids],
        mirror=np.searchsorted(ids, model.mirror[ids]).astype(np.int32),
        weights=_rows(model.weights, ids),
        avatar_vertices=model.avatar_vertices[ids],
        avatar_weights=model.avatar_weights[ids],
        avatar_offset_m=model.avatar_offset_m[ids],
    )
    return coarse, chosen.coarse_of


def _rows(weights: SkinWeights, rows: I32) -> SkinWeights:
    """Skin weights of some rows, in the given order."""
    entries, owner = expand(weights.offsets.astype(np.int64), rows.astype(np.int64))
    count = np.bincount(owner, minlength=len(rows))
    offsets = np.concatenate(([0], np.cumsum(count))).astype(np.int32)
    return SkinWeights(offsets, weights.bones[entries], weights.values[entries])
