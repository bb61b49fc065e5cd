# SPDX-License-Identifier: GPL-3.0-or-later
"""Editing painted areas: weights (V,) in 0..1 over the vertices of one perceptual model.

Every function yields new weights and leaves its argument alone. Vertices are one two-point
threshold apart, so a step from neighbour to neighbour is the finest that can be felt.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, Literal

import numpy as np

from ..arrays import F64, I64
from .model import PerceptualModel

Blend = Literal["replace", "add", "subtract", "multiply"]
BLENDS: Final[tuple[Blend, ...]] = ("replace", "add", "subtract", "multiply")

_CLOSEST: Final = 3  # vertices that one between them takes its weight from


@lru_cache(maxsize=8)
def _links(model: PerceptualModel) -> tuple[I64, I64]:
    """Directed edges of a model's mesh: from and to, (2 E,) each, both directions of every edge."""
    triangles = model.triangles.astype(np.int64)
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    return ends[:, 0], ends[:, 1]


def grow(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Dilate an area: each vertex takes the largest weight around it, ``steps`` times."""
    one, other = _links(model)
    for _ in range(steps):
        grown = weights.copy()
        np.maximum.at(grown, one, weights[other])
        weights = grown
    return weights


def shrink(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Erode an area: each vertex takes the smallest weight around it, ``steps`` times."""
    return 1.0 - grow(model, 1.0 - weights, steps)


def smooth(model: PerceptualModel, weights: F64, steps: int = 1) -> F64:
    """Smooth an area: each vertex moves half way to the mean of its neighbours, ``steps`` times."""
    one, other = _links(model)
    count = np.maximum(np.bincount(one, minlength=len(weights)), 1)
    for _ in range(steps):
        mean = np.bincount(one, weights[other], minlength=len(weights)) / count
        weights = 0.5 * (weights + mean)
    return weights


def mirrored(model: PerceptualModel, weights: F64) -> F64:
    """Mirror an area to the other side of the body."""
    found: F64 = weights[model.mirror]
    return found


def symmetric(model: PerceptualModel, weights: F64, source_side: int) -> F64:
    """Copy the side ``source_side`` (index into ``parts.SIDES``) of an area to the other one."""
    found = weights.copy()
    others = model.side[model.mirror] == source_side
    others &= model.side != source_side
    found[others] = weights[model.mirror[others]]
    return found


def blended(weights: F64, other: F64, blend: Blend) -> F64:
    """Two areas put together, clipped to 0..1."""
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
    """Transfer an area from one modality's model to another.

    A vertex of a coarser model takes the mean over the skin that lies nearest to it, one of
    a finer model a weight between those of the nearest vertices, always of its own body part.
    """
    from scipy.spatial import cKDTree

    found = np.zeros(len(target))
    for part in np.unique(target.part):
        mine = np.flatnonzero(target.part == part)
        theirs = np.flatnonzero(source.part == part)
        if not len(theirs):
            continue
        places, from_places = target.vertices[mine], source.vertices[theirs]
        near = min(_CLOSEST, len(theirs))
        distance, nearest = cKDTree(from_places).query(places, k=[*range(1, near + 1)])
        share = 1.0 / np.maximum(distance, 1e-9)
        between = (weights[theirs][nearest] * share).sum(axis=1) / share.sum(axis=1)
        _, owner = cKDTree(places).query(from_places)
        areas = source.areas_m2[theirs].astype(np.float64)
        covered = np.bincount(owner, areas, minlength=len(mine))
        felt = np.bincount(owner, areas * weights[theirs], minlength=len(mine))
        several = np.bincount(owner, minlength=len(mine)) > 1
        mean = np.divide(felt, covered, out=np.zeros_like(felt), where=covered > 0.0)
        found[mine] = np.where(several, mean, between)
    return np.clip(found, 0.0, 1.0)


def from_image(pixels: F64, uv: F64) -> F64:
    """Weights (V,) from a picture at the places (V, 2) of its map, each in 0..1 of its size.

    Between the centres of pixels the value goes over evenly; the map repeats beyond its edges.
    A place that is not finite has no weight.

    Parameters
    ----------
    pixels : (H, W) float64
        0..1, the first row at v = 0.
    uv : (V, 2) float64
    """
    height, width = pixels.shape
    known = np.isfinite(uv).all(axis=1)
    place = np.where(known[:, None], uv, 0.0) * [width, height] - 0.5
    low = np.floor(place)
    x, y = (place - low).T
    left, under = low.astype(np.int64).T
    columns = np.stack([left, left + 1]) % width
    rows = np.stack([under, under + 1]) % height
    bottom = pixels[rows[0], columns[0]] * (1 - x) + pixels[rows[0], columns[1]] * x
    top = pixels[rows[1], columns[0]] * (1 - x) + pixels[rows[1], columns[1]] * x
    return np.where(known, np.clip(bottom * (1 - y) + top * y, 0.0, 1.0), 0.0)
