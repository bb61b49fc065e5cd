# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of an avatar's surface: skin, and clothes over it.

A layer is a connected piece of the surface, in whatever mesh it is. Where one lies over another,
the outer one is seen and felt, or the inner one if the skin is asked for. Hair and hats are never
felt where there is a head under them.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from .joints import Skeletons
from .regions import REGIONS, above
from .surface import TargetSurface
from .target import areas_of, connected_pieces, weld

Layer = Literal["visible", "skin"]

_DEPTHS_M: Final = (0.003, 0.01, 0.02, 0.032)
"""Heights over a place at which another layer is looked for (of a body 1.8 m tall)."""

_DEEPEST_M: Final = 0.04
"""Farthest that clothes lie over the skin that they hide; a cape or a wide skirt hides none."""

_ASIDE_M: Final = 0.014
"""Distance beside the way outwards at which another layer is found: half a cut triangle."""

_ALIKE: Final = 0.3
"""Least cosine between the normals of two layers of the same skin."""

_NEAR_M: Final = 0.16
"""Farthest from the body that layers are looked for: no fit reaches farther (big heads, capes)."""

_LARGE: Final = 0.004
"""Share of the surface from which a piece hides what lies under it: no button, no eyelash."""

_EYES_M: Final = np.array([0.0, -0.01, 0.07])
"""Way from the canonical head's joint to between its eyes and ears."""

_AHEAD: Final = 0.5
"""Least share of a direction of sight that points ahead: 60 degrees aside, up and down."""

_STEP: Final = 0.15
"""Step between directions from within the head, as a difference of unit vectors."""

_CHIN: Final = -0.35
"""Least height of a direction from within the head in which hats and hair are looked for."""

_HEAD: Final = REGIONS.index("head")


def leaving_out(
    surface: TargetSurface, layer: Layer, body: F64, bodies: Skeletons
) -> Generator[float, None, npt.NDArray[np.bool_]]:
    """Find the cut triangles of a surface that are not felt, (N,), in steps.

    Parameters
    ----------
    body : (V, 3) float64
        The canonical avatar in the target's pose.
    """
    from scipy.spatial import cKDTree

    pieces = connected_pieces(weld(surface.points)[surface.triangles])
    areas = np.bincount(pieces, areas_of(surface.points, surface.triangles))
    out = np.zeros(len(surface.parent), bool)
    if np.count_nonzero(areas >= _LARGE * areas.sum()) < 2:
        return out
    piece, region = pieces[surface.parent], surface.region[surface.parent]
    is_large = areas[piece] >= _LARGE * areas.sum()
    far, _ = cKDTree(body).query(surface.centres, distance_upper_bound=_NEAR_M, workers=-1)
    asked = np.flatnonzero((is_large | (region == _HEAD)) & (far < np.inf))
    inner, outer = yield from _pairs(surface, asked, piece, region)
    on_head = region[inner] == _HEAD
    out[(inner if layer == "visible" else outer)[~on_head]] = True
    face, beside = _head_pieces(surface, piece, np.flatnonzero(region == _HEAD), bodies)
    out[beside] = True
    inside = on_head & (piece[outer] == face)  # teeth, eyeballs
    out[inner[inside]] = True
    out[outer[on_head & ~inside]] = True
    return out


def _pairs(
    surface: TargetSurface, asked: I64, piece: I64, region: I64
) -> Generator[float, None, tuple[I64, I64]]:
    """Find cut triangles of which the second lies over the first, in steps."""
    from scipy.spatial import cKDTree

    centres, normals = surface.centres[asked], surface.flat_normals[surface.parent[asked]]
    tree = cKDTree(centres)
    inner, outer = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    depths = (*_DEPTHS_M, *(-depth_m for depth_m in _DEPTHS_M))  # out, then inwards
    for number, depth_m in enumerate(depths):
        yield number / len(depths)
        places, reach_m = centres + depth_m * normals, _ASIDE_M + 0.3 * abs(depth_m)
        _, near = tree.query(places, k=6, distance_upper_bound=reach_m, workers=-1)
        row, column = np.nonzero(near < len(asked))
        other = near[row, column]
        way = centres[other] - centres[row]
        height = np.einsum("ni,ni->n", way, normals[row])
        aside = np.linalg.norm(way - height[:, None] * normals[row], axis=1)
        height = np.sign(depth_m) * height
        is_over = (height > 5e-4) & (height < _DEEPEST_M) & (aside < _ASIDE_M)
        is_over &= np.einsum("ni,ni->n", normals[row], normals[other]) > _ALIKE
        is_over &= piece[asked[row]] != piece[asked[other]]
        is_over &= _NEIGHBOURS[region[asked[row]], region[asked[other]]]
        below, above_it = (row, other) if depth_m > 0.0 else (other, row)
        inner.append(asked[below[is_over]])
        outer.append(asked[above_it[is_over]])
    return np.concatenate(inner), np.concatenate(outer)


def _head_pieces(
    surface: TargetSurface, piece: I64, asked: I64, bodies: Skeletons
) -> tuple[int, I64]:
    """Find the face and what lies over or in the head.

    The face is the connected piece that is met first in most directions of sight from between the
    eyes. Pieces in a direction in which there is skin of the face are hats, hair, teeth, eyeballs.

    Parameters
    ----------
    piece : (N,) int64
        Connected piece of each cut triangle.
    asked : (n,) int64
        Cut triangles of the head.

    Returns
    -------
    face : int
        The piece; -1 without a head.
    beside : (m,) int64
        Cut triangles that are over or in the head.
    """
    from scipy.spatial import cKDTree

    joint = next((name for name in ("head", "neck") if name in bodies.joints), None)
    if joint is None or not len(asked):
        return -1, asked[:0]
    eyes = bodies.joints[joint] - bodies.canonical[joint] + bodies.canonical["head"] + _EYES_M
    way = surface.centres[asked] - eyes
    off_m = np.linalg.norm(way, axis=1)
    way /= np.maximum(off_m, 1e-9)[:, None]
    face = _face(piece[asked], way, off_m)
    is_face = piece[asked] == face
    above = np.flatnonzero(~is_face & (way[:, 2] > _CHIN))
    if not (is_face.any() and len(above)):
        return face, asked[:0]
    aside, _ = cKDTree(way[is_face]).query(way[above], workers=-1)
    return face, asked[above[aside < _STEP]]


def _face(piece: I64, way: F64, off_m: F64) -> int:
    """Piece of a head's triangles that is met first in most directions ahead; -1 without one.

    A solid that fills the head and reaches out of it behind (a sphere for hair) is met before the
    face too: the face is what lies beyond it ahead, and below it elsewhere.
    """
    pieces, row = np.unique(piece, return_inverse=True)
    steps = np.round(way / _STEP).astype(int)
    cells, column = np.unique(steps, axis=0, return_inverse=True)
    nearest = np.full((len(pieces), len(cells)), np.inf)
    np.minimum.at(nearest, (row, column.ravel()), off_m)
    ahead = cells[:, 1] * _STEP < -_AHEAD  # normalised bodies face -Y
    if not ahead.any():
        return -1
    first = np.bincount(nearest[:, ahead].argmin(axis=0), minlength=len(pieces))
    found = int(first.argmax())
    both = np.isfinite(nearest) & np.isfinite(nearest[found])
    beyond = both & (nearest > nearest[found])
    below = both & (nearest < nearest[found])
    holds = (beyond & ahead).sum(axis=1) > first[found] / 2
    holds &= (below & ~ahead).sum(axis=1) > (both & ~ahead).sum(axis=1) / 2
    if holds.any():
        found = int(np.where(holds, (beyond & ahead).sum(axis=1), -1).argmax())
    return int(pieces[found])


def _neighbours() -> npt.NDArray[np.bool_]:
    """Table (R + 1, R + 1) of the regions that are the same or follow on each other."""
    found = np.zeros((len(REGIONS) + 1, len(REGIONS) + 1), bool)  # the last row: no region
    for number, region in enumerate(REGIONS):
        upper = REGIONS.index(above(region))
        found[number, number] = found[number, upper] = found[upper, number] = True
    return found


_NEIGHBOURS: Final = _neighbours()
