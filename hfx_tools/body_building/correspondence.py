# SPDX-License-Identifier: GPL-3.0-or-later
"""Correspondence between two models of one body: vertex ids at equal points of skin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hfx_blender.engine.arrays import I32
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.files.atomic import atomic_file


def nearest_ids(of: PerceptualModel, onto: PerceptualModel) -> I32:
    """Nearest vertex in ``onto`` for each vertex, in rest space.

    Candidates have the same part and side; without any, the same part; without any, all vertices.
    So a finger never maps to the palm next to it.

    Returns (V,) int32: ids in ``onto``.
    """
    from scipy.spatial import cKDTree

    ids = np.zeros(len(of), np.int32)
    for part in np.unique(of.part):
        for side in np.unique(of.side):
            members = np.flatnonzero((of.part == part) & (of.side == side))
            if not len(members):
                continue
            candidates = np.flatnonzero((onto.part == part) & (onto.side == side))
            if not len(candidates):
                candidates = np.flatnonzero(onto.part == part)
            if not len(candidates):
                candidates = np.arange(len(onto))
            nearest = cKDTree(onto.vertices[candidates]).query(of.vertices[members])[1]
            ids[members] = candidates[nearest]
    return ids


def save(model: PerceptualModel, canonical: PerceptualModel, path: Path) -> None:
    """Write the maps from a model to the canonical model and back.

    The ``.npz`` has ``to_canonical`` (V,), ``from_canonical`` (C,) and id and hash of both models.
    """
    with atomic_file(path) as file:
        np.savez_compressed(
            file,
            to_canonical=nearest_ids(model, canonical),
            from_canonical=nearest_ids(canonical, model),
            model=np.array([model.id, model.content_hash]),
            canonical=np.array([canonical.id, canonical.content_hash]),
        )
