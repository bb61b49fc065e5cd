# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadric decimation of each part alone, as in the paper.

Danieau et al. (VRST 2018, section 3.1) decimated each part down to the target mean distance
between neighbours. This module uses fast-simplification (quadric error metrics, Garland and
Heckbert 1997) on the left half of the skin. Parts are cut apart, so two unconnected rows of
vertices remain along each border.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.parts import PARTS

from ..left_skin import Half, LeftSkin, Samples
from . import mesh_edges
from .remesher import HEXAGON

METHOD: Final = "quadric decimation of each part by itself (Danieau et al. 2018), mirrored"

_STEPS: Final = 6
_CLOSE: Final = 0.005  # of the target


def decimate(skin: LeftSkin, spacing_m: F64) -> Half:
    """Decimate every part of the left half down to its mean target spacing, within 0.5 %.

    ``spacing_m`` (parts,) float64.
    """
    labels = skin.medium.part[skin.quads[:, 0]]
    points: list[F64] = []
    triangles: list[I64] = []
    part: list[int] = []
    for number in range(len(PARTS)):
        quads = skin.quads[labels == number]
        if not len(quads):
            continue
        used, inverse = np.unique(quads, return_inverse=True)
        corners = inverse.reshape(-1, 4)
        dense = np.concatenate((corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]))
        few, faces = _decimate_part(skin.points[used], dense, float(spacing_m[number]))
        triangles.append(faces + len(part))
        points.append(few)
        part += [number] * len(few)
    every = np.concatenate(points)
    return Half(every, np.concatenate(triangles), np.array(part, np.uint8), every[:, 0] == 0.0)


def _decimate_part(points: F64, triangles: I64, spacing_m: float) -> tuple[F64, I64]:
    import fast_simplification

    corners = points[triangles]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    # A triangular grid has two triangles per vertex.
    count = 2.0 * float(area.sum()) / (HEXAGON * spacing_m**2)
    fewer_points, fewer = points, triangles
    for _ in range(_STEPS):
        target = int(np.clip(round(count), 4, len(triangles)))
        fewer_points, fewer = fast_simplification.simplify(points, triangles, target_count=target)
        fewer_points, fewer = fewer_points.astype(np.float64), fewer.astype(np.int64)
        ends = np.unique(np.sort(fewer[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        mean = float(
            np.linalg.norm(fewer_points[ends[:, 0]] - fewer_points[ends[:, 1]], axis=1).mean()
        )
        if abs(mean / spacing_m - 1.0) < _CLOSE or target in (4, len(triangles)):
            break
        count *= (mean / spacing_m) ** 2
    used, inverse = np.unique(fewer, return_inverse=True)
    return fewer_points[used], inverse.reshape(-1, 3).astype(np.int64)


def areas_m2(half: Half, samples: Samples) -> F64:
    """Skin (V,) of each vertex of the left half: a third of the adjacent triangles, scaled so that
    each part has the area of its skin samples.
    """
    size = np.linalg.norm(mesh_edges.triangle_normals(half.points, half.triangles), axis=1) / 6.0
    count = len(half.points)
    share = sum(np.bincount(corner, size, minlength=count) for corner in half.triangles.T)
    of_mesh = np.bincount(half.part, share, minlength=len(PARTS))
    of_skin = np.bincount(samples.part, samples.areas_m2, minlength=len(PARTS))
    return share * (of_skin / np.maximum(of_mesh, 1e-30))[half.part]
