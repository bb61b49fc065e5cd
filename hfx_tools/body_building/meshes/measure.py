# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements of a mesh against the approximated skin: largest gap and mean error by part."""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.parts import PARTS

from ..joint_gradient import UNIFORM, JointGradient
from ..left_skin import Samples
from .nearest_places import locate

ERROR_STRIDE: Final = 41
"""Stride of the samples for the distance of the skin from the mesh."""


def gaps_m(samples: Samples, points: F64, gradient: JointGradient = UNIFORM) -> F64:
    """Largest distance, by part, from a skin sample of the left half to the nearest vertex.

    Distances are divided by the gradient's relative spacing at the sample.

    ``points`` (V, 3) float64: vertices of the whole body, or of the left half alone.

    Returns (parts,) float64.
    """
    from scipy.spatial import cKDTree

    gaps = np.zeros(len(PARTS))
    distance = cKDTree(points).query(samples.points)[0]
    distance /= gradient.relative(samples.points, samples.part)
    np.maximum.at(gaps, samples.part, distance)
    return gaps


def errors_m(samples: Samples, points: F64, triangles: I64, stride: int = ERROR_STRIDE) -> F64:
    """Area-weighted mean distance, by part, from skin samples of the left half to a mesh.

    Returns (parts,) float64.
    """
    every = slice(None, None, stride)
    points_, part, weight = samples.points[every], samples.part[every], samples.areas_m2[every]
    triangle, shares, _ = locate(points_, points, triangles)
    nearest = np.einsum("ij,ijk->ik", shares, points[triangles[triangle]])
    distance = np.linalg.norm(points_ - nearest, axis=1)
    total = np.bincount(part, weight, minlength=len(PARTS))
    return np.bincount(part, weight * distance, minlength=len(PARTS)) / np.maximum(total, 1e-30)
