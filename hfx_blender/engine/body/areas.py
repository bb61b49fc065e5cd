# SPDX-License-Identifier: GPL-3.0-or-later
"""Editing of painted areas: weights (V,) in 0..1 over the vertices of a perceptual model.

Every function returns a new array. A step from a vertex to its neighbour is one two-point
threshold.
"""

from functools import lru_cache
from typing import Final, Literal

import numpy as np

from ..arrays import F64, I64
from .model import PerceptualModel

Blend = Literal["replace", "add", "subtract", "multiply"]
BLENDS: Final[tuple[Blend, ...]] = ("replace", "add", "subtract", "multiply")

_NEAREST_COUNT: Final = 3  # source vertices to interpolate a target vertex from


@lru_cache(maxsize=8)
def _directed_edges(model: PerceptualModel) -> tuple[I64, I64]:
    """Start and end vertices of mesh edges, (2 E,) each; every edge in both directions."""
    triangles = model.triangles.astype(np.int64)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    return ends[:, 0], ends[:, 1]


def grow(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Dilate an area: maximum of the weights (V,) of each vertex and all its neighbours, ``steps``
    times."""
    starts, ends = _directed_edges(model)
    for _ in range(steps):
        grown = weights.copy()
        np.maximum.at(grown, starts, weights[ends])
        weights = grown
    return weights


def shrink(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Erode an area ``steps`` times: minimum of the weights (V,) of a vertex and its neighbours."""
    return 1.0 - grow(model, 1.0 - weights, steps)


def smooth(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Smooth an area ``steps`` times: each weight (V,) becomes the mean of itself and the mean of
    its neighbours' weights, half of itself without neighbours."""
    starts, ends = _directed_edges(model)
    count = np.maximum(np.bincount(starts, minlength=len(weights)), 1)
    for _ in range(steps):
        mean = np.bincount(starts, weights[ends], minlength=len(weights)) / count
        weights = 0.5 * (weights + mean)
    return weights


def mirrored(model: PerceptualModel, weights: F64) -> F64:
    """Weights (V,) with left and right sides swapped, by ``model.mirror``; a new array."""
    return np.asarray(weights[model.mirror])


def symmetric(model: PerceptualModel, weights: F64, source_side: int) -> F64:
    """Copy the weights of one side to the opposite side; the source side and the midline stay.
    ``source_side`` is an index into ``parts.SIDES``."""
    result = weights.copy()
    is_opposite = model.side[model.mirror] == source_side
    is_opposite &= model.side != source_side
    result[is_opposite] = weights[model.mirror[is_opposite]]
    return result


def blended(weights: F64, other: F64, blend: Blend) -> F64:
    """Combine an area with another area by a blend mode; sums and differences are clipped to 0..1.
    "replace" returns ``other`` itself. Raises ValueError: unknown blend mode."""
    if blend == "replace":
        return other
    if blend == "add":
        return np.minimum(weights + other, 1.0)
    if blend == "subtract":
        return np.maximum(weights - other, 0.0)
    if blend == "multiply":
        return weights * other
    raise ValueError(f"blend: expected one of {', '.join(BLENDS)}, got '{blend}'")


def transferred(source: PerceptualModel, weights: F64, target: PerceptualModel) -> F64:
    """Resample an area onto the vertices of another model, body part by body part.

    A target vertex nearest to two or more source vertices takes their area-weighted mean; otherwise
    the three nearest source vertices are interpolated (inverse distance). 0 where the source model
    has no vertex of the body part.
    """
    from scipy.spatial import cKDTree

    result = np.zeros(len(target))
    for part in np.unique(target.part):
        target_ids = np.flatnonzero(target.part == part)
        source_ids = np.flatnonzero(source.part == part)
        if not len(source_ids):
            continue
        target_points, source_points = target.vertices[target_ids], source.vertices[source_ids]
        near = min(_NEAREST_COUNT, len(source_ids))
        # Finer target: interpolation between source vertices.
        distance, nearest = cKDTree(source_points).query(target_points, k=[*range(1, near + 1)])
        # Inverse distances; 1e-9 m lets a vertex at the same place win.
        share = 1.0 / np.maximum(distance, 1e-9)
        interpolated = (weights[source_ids][nearest] * share).sum(axis=1) / share.sum(axis=1)
        # Coarser target: mean over the source vertices in the Voronoi cell of each target vertex.
        _, owner = cKDTree(target_points).query(source_points)
        areas = source.areas_m2[source_ids].astype(np.float64)
        covered = np.bincount(owner, areas, minlength=len(target_ids))
        weighted = np.bincount(owner, areas * weights[source_ids], minlength=len(target_ids))
        has_several = np.bincount(owner, minlength=len(target_ids)) > 1
        mean = np.divide(weighted, covered, out=np.zeros_like(weighted), where=covered > 0.0)
        result[target_ids] = np.where(has_several, mean, interpolated)
    return np.clip(result, 0.0, 1.0)


def from_image(pixels: F64, uv: F64) -> F64:
    """Weights (V,) sampled bilinearly from a picture that repeats beyond its edges. ``pixels`` (H,
    W) are in 0..1, the first row is at v = 0. ``uv`` (V, 2) is 1 at the width and height of the
    picture; NaN gives weight 0."""
    height, width = pixels.shape
    is_finite = np.isfinite(uv).all(axis=1)
    position = np.where(is_finite[:, None], uv, 0.0) * [width, height] - 0.5
    low = np.floor(position)
    x, y = (position - low).T
    left, below = low.astype(np.int64).T  # pixel centres are at half integers
    columns = np.stack([left, left + 1]) % width
    rows = np.stack([below, below + 1]) % height
    bottom = pixels[rows[0], columns[0]] * (1 - x) + pixels[rows[0], columns[1]] * x
    top = pixels[rows[1], columns[0]] * (1 - x) + pixels[rows[1], columns[1]] * x
    return np.where(is_finite, np.clip(bottom * (1 - y) + top * y, 0.0, 1.0), 0.0)
