# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat patch of skin for tests of spots: equal triangles of a given side, in the plane z = 0."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights


def plane(spacing_m: float = 0.02, rows: int = 21, modality: str = "vibration") -> PerceptualModel:
    """Return a plane of equal triangles; vertex ``rows * rows // 2`` is at the origin."""
    j, i = np.divmod(np.arange(rows * rows), rows)
    points = np.stack([i + 0.5 * (j % 2), j * np.sqrt(3.0) / 2.0, 0.0 * i], axis=1) * spacing_m
    points -= points[rows * rows // 2]
    corner = np.arange(rows * rows).reshape(rows, rows)
    triangles = []
    for row in range(rows - 1):
        low, high = corner[row], corner[row + 1]
        shift = 1 if row % 2 else 0
        for k in range(rows - 1):
            if shift:
                triangles += [(low[k], low[k + 1], high[k + 1]), (low[k], high[k + 1], high[k])]
            else:
                triangles += [(low[k], low[k + 1], high[k]), (low[k + 1], high[k + 1], high[k])]
    count = len(points)
    return PerceptualModel(
        id=f"plane-{modality}",
        modality=modality,
        vertices=points.astype(np.float32),
        triangles=np.array(triangles, np.int32),
        normals=np.tile(np.float32([0, 0, 1]), (count, 1)),
        areas_m2=np.full(count, spacing_m**2 * np.sqrt(3.0) / 2.0, np.float32),
        part=np.ones(count, np.uint8),  # torso
        side=np.zeros(count, np.uint8),
        mirror=np.arange(count, dtype=np.int32),
        bone_names=("root",),
        weights=SkinWeights(
            np.arange(count + 1, dtype=np.int32), np.zeros(count, np.int32), np.ones(count, "f4")
        ),
        avatar_vertices=np.zeros((count, 3), np.int32),
        avatar_weights=np.zeros((count, 3), np.float32),
        avatar_offset_m=np.zeros(count, np.float32),
        provenance={},
    )
