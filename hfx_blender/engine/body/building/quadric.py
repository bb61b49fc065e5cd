# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's own way to thin a body: quadric decimation of each part by itself.

Danieau et al. (VRST 2018, section 3.1) ran a decimation on each part until the mean distance
between neighbours was the target. Here the same is done with fast-simplification (quadric
error metrics, Garland and Heckbert 1997) on the left half of the skin, to be held against the
even cells. Parts are cut apart for it, so that this way gives no closed model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..mesh_edit import F64, I64
from ..nearest import locate
from ..parts import PARTS
from .left_skin import LeftSkin
from .remesh import HEXAGON

_STEPS: Final = 6
_CLOSE: Final = 0.005  # of the target


@dataclass(frozen=True)
class Decimated:
    """One part of the left half, decimated. Distances in metres."""

    part: str
    vertices: int
    mean_m: float
    sd_m: float
    gap_m: float  # farthest skin from a vertex
    error_m: float  # mean distance of the skin from the mesh


def decimate(skin: LeftSkin, spacing_m: F64) -> list[Decimated]:
    """Decimate every part until its mean spacing is the target.

    Parameters
    ----------
    spacing_m : (parts,) float64
    """
    labels = skin.medium.part[skin.quads[:, 0]]
    found = []
    for number, part in enumerate(PARTS):
        quads = skin.quads[labels == number]
        if not len(quads):
            continue
        used, inverse = np.unique(quads, return_inverse=True)
        corners = inverse.reshape(-1, 4)
        triangles = np.concatenate((corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]))
        found.append(_decimate_part(part, skin.points[used], triangles, float(spacing_m[number])))
    return found


def _decimate_part(part: str, points: F64, triangles: I64, spacing_m: float) -> Decimated:
    import fast_simplification
    from scipy.spatial import cKDTree

    corners = points[triangles]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    count = 2.0 * float(area.sum()) / (HEXAGON * spacing_m**2)
    fewer_points, fewer = points, triangles
    mean = sd = float("nan")
    for _ in range(_STEPS):
        wanted = int(np.clip(round(count), 4, len(triangles)))
        fewer_points, fewer = fast_simplification.simplify(points, triangles, target_count=wanted)
        fewer_points, fewer = fewer_points.astype(np.float64), fewer.astype(np.int64)
        ends = np.unique(np.sort(fewer[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        lengths = np.linalg.norm(fewer_points[ends[:, 0]] - fewer_points[ends[:, 1]], axis=1)
        mean, sd = float(lengths.mean()), float(lengths.std())
        if abs(mean / spacing_m - 1.0) < _CLOSE or wanted in (4, len(triangles)):
            break
        count *= (mean / spacing_m) ** 2
    used = np.unique(fewer)
    gap = float(cKDTree(fewer_points[used]).query(points)[0].max())
    _, _, offset = locate(points[:: max(1, len(points) // 5000)], fewer_points, fewer)
    return Decimated(part, len(used), mean, sd, gap, float(np.abs(offset).mean()))
