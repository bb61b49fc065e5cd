# SPDX-License-Identifier: GPL-3.0-or-later
"""Correspondence between two models of one body: ids of vertices at the same skin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hfx_blender.engine.arrays import I32
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.files.atomic import atomic_file


def nearest_ids(of: PerceptualModel, onto: PerceptualModel) -> I32:
    """Nearest vertex of another model for each vertex, in rest space.

    The same part and side is kept where the other model has it: a finger never maps to its
    neighbour's palm. A midline vertex may map to either side, a side's vertex to the midline.

    Returns
    -------
    (V,) int32
        Ids in ``onto``.
    """
    from scipy.spatial import cKDTree

    found = np.zeros(len(of), np.int32)
    for part in np.unique(of.part):
        for side in np.unique(of.side):
            asked = np.flatnonzero((of.part == part) & (of.side == side))
            if not len(asked):
                continue
            offered = np.flatnonzero((onto.part == part) & (onto.side == side))
            if not len(offered):
                offered = np.flatnonzero(onto.part == part)
            if not len(offered):
                offered = np.arange(len(onto))
            place = cKDTree(onto.vertices[offered]).query(of.vertices[asked])[1]
            found[asked] = offered[place]
    return found


def save(model: PerceptualModel, canonical: PerceptualModel, path: Path) -> None:
    """Write both directions between a model and the canonical one.

    The ``.npz`` holds ``to_canonical`` (V,), ``from_canonical`` (C,) and the two ids with
    their hashes.
    """
    with atomic_file(path) as file:
        np.savez_compressed(
            file,
            to_canonical=nearest_ids(model, canonical),
            from_canonical=nearest_ids(canonical, model),
            model=np.array([model.id, model.content_hash]),
            canonical=np.array([canonical.id, canonical.content_hash]),
        )
