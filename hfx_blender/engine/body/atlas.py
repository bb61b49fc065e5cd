# SPDX-License-Identifier: GPL-3.0-or-later
"""Atlas of a perceptual model: a picture with a texel for the cell of each vertex."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from ..arrays import I64
from .model import PerceptualModel, load_model
from .parts import HEAD, REGIONS, RIGHT, Region
from .regions import finest_masks

_CLOSED = 0.5  # length of the mean normal below which a region goes round a limb
_FLAT = 0.8  # vertical part of the mean normal above which a region is seen from above or below


@lru_cache(maxsize=4)
def texels(model_id: str) -> tuple[I64, tuple[int, int]]:
    """Column and row (V, 2) of each vertex, rows from the bottom, and width and height of the
    picture. Each region, on limbs of one side, is a chart, seen from outside or unrolled around the
    limb. Charts stand in rows by menu group, hands on top, the person's right on the left, with a
    free texel around each, and spread over the width: their names need room."""
    model = load_model(model_id)
    places, width = np.zeros((len(model), 2), np.int64), int(1.5 * len(model) ** 0.5) + 16
    left = bottom = height = 0
    group = ""
    rows: list[list[I64]] = []
    ends = []  # free columns at the right of each row begin here
    for region, chart in charts(model):
        at = _chart(model, chart)
        size = at.max(axis=0) + 2
        if left + size[0] > width or region.group != group:
            left, bottom, height = 0, bottom + height, 0
            rows.append([])
            ends.append(0)
        group, width = region.group, max(width, int(size[0]) + 1)
        places[chart] = at + np.array((left + 1, bottom + 1))
        left, height = left + int(size[0]), max(height, int(size[1]))
        rows[-1].append(chart)
        ends[-1] = left
    for row, end in zip(rows, ends, strict=True):
        for number, chart in enumerate(row):
            places[chart, 0] += number * (width - end) // len(row)
    return places, (width + 1, bottom + height + 1)


def charts(model: PerceptualModel) -> Iterator[tuple[Region, I64]]:
    """Yield the region and the vertices (n,) of each chart, in the order of the picture from the
    lower left."""
    masks, is_right = finest_masks(model.id), model.side == RIGHT
    for region in reversed([region for region in REGIONS if region.id in masks]):
        sides = (True,) if region.group == HEAD else (is_right, ~is_right)
        for is_on_side in sides:
            chart = np.flatnonzero(masks[region.id] & is_on_side)
            if len(chart):
                yield region, chart


def _chart(model: PerceptualModel, chart: I64) -> I64:
    """Column and row (n, 2), from 0, of vertices ``chart`` (n,); no two have the same."""
    points = model.vertices[chart].astype(np.float64)
    points -= points.mean(axis=0)
    mean = model.normals[chart].astype(np.float64).mean(axis=0)
    upward = np.array([0.0, 0.0, 1.0] if abs(mean[2]) < _FLAT else [0.0, -1.0, 0.0])
    if np.linalg.norm(mean) < _CLOSED:  # unrolled around the longest direction, cut at the back
        axis = np.linalg.svd(points, full_matrices=False)[2][0]
        axis *= np.sign(axis @ upward) or 1.0
        front = np.array([0.0, -1.0, 0.0] if abs(axis[1]) < _FLAT else [0.0, 0.0, 1.0])
        right = np.cross(axis, front)
        radius_m = np.linalg.norm(points - np.outer(points @ axis, axis), axis=1).mean()
        flat = np.arctan2(points @ right, points @ front) * radius_m
    else:
        axis = upward - (upward @ mean) * mean / (mean @ mean)
        axis /= np.linalg.norm(axis)
        flat = points @ np.cross(axis, mean / np.linalg.norm(mean))
    up = points @ axis
    cell_m2 = np.median(model.areas_m2[chart])
    spacing = np.sqrt(np.clip(np.ptp(up) * np.ptp(flat) / len(chart), 0.25 * cell_m2, cell_m2))
    row = np.floor((up - up.min()) / spacing).astype(np.int64)
    column = np.zeros(len(chart), np.int64)
    for number in np.unique(row):
        members = np.flatnonzero(row == number)
        members = members[np.argsort(flat[members], kind="stable")]
        wanted = np.round((flat[members] - flat.min()) / spacing)
        count = np.arange(len(members))
        # Pushed apart to the right where a texel is taken, then back by half of the push.
        taken = np.maximum.accumulate(wanted - count) + count
        column[members] = taken - np.round((taken - wanted).mean())
    return np.column_stack([column - column.min(), row])
