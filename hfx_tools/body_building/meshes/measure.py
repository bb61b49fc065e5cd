# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures a mesh against the skin that it approximates: largest gap, mean error by part."""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.parts import PARTS

from ..left_skin import Samples
from .nearest_places import locate

ERROR_STRIDE: Final = 41
"""Stride of the samples at which the distance of the skin from the mesh is measured."""


def gaps_m(samples: Samples, points: F64) -> F64:
    """Distance from the farthest skin of each part of the left half to the nearest vertex.

    Parameters
    ----------
    points : (V, 3) float64
        Of the whole body, or of the left half where that is all there is.

    Returns
    -------
    (parts,) float64
    """
    from scipy.spatial import cKDTree

    found = np.zeros(len(PARTS))
    np.maximum.at(found, samples.part, cKDTree(points).query(samples.points)[0])
    return found


def errors_m(samples: Samples, points: F64, triangles: I64, stride: int = ERROR_STRIDE) -> F64:
    """Mean distance of the skin of each part of the left half from a mesh, by area.

    Returns
    -------
    (parts,) float64
    """
    every = slice(None, None, stride)
    places, part, weight = samples.points[every], samples.part[every], samples.areas_m2[every]
    triangle, shares, _ = locate(places, points, triangles)
    nearest = np.einsum("ij,ijk->ik", shares, points[triangles[triangle]])
    distance = np.linalg.norm(places - nearest, axis=1)
    total = np.bincount(part, weight, minlength=len(PARTS))
    return np.bincount(part, weight * distance, minlength=len(PARTS)) / np.maximum(total, 1e-30)
