# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of an avatar's surface: skin, and clothes above the skin.

A layer is a connected piece of surface, regardless of meshes. Where layers overlap, the outer layer
is used ("visible") or the inner layer ("skin"). Hair and hats above a head are never used.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from .bone_regions import REGIONS, above
from .joints import Skeletons
from .surface import TargetSurface
from .target import areas_of, connected_pieces, weld

Layer = Literal["visible", "skin"]

# Heights of the search for another layer, metres at canonical size (1.8 m)
_DEPTHS_M: Final = (0.003, 0.01, 0.02, 0.032)
# Largest distance from clothes to covered skin; capes and wide skirts cover no skin
_DEEPEST_M: Final = 0.04
# Largest lateral distance to another layer: half the size of a cut triangle
_ASIDE_M: Final = 0.014
# Edge of grid cells of the coarse search; at least the distance of layers
_CELL_M: Final = 0.045
# Smallest cosine between the normals of two layers
_ALIKE: Final = 0.3
# Largest distance of layers from the posed body (big heads, capes)
_NEAR_M: Final = 0.16
# Smallest fraction of the surface of a covering piece; smaller are buttons, eyelashes
_LARGE: Final = 0.004
# Offset from the canonical head joint to the point between eyes and ears
_EYES_M: Final = np.array([0.0, -0.01, 0.07])
# Smallest forward component of a viewing direction (60 degrees to all sides)
_AHEAD: Final = 0.5
# Cell size of viewing directions, as a difference of unit vectors
_STEP: Final = 0.15
# Smallest upward component of directions to hats and hair
_CHIN: Final = -0.35
_HEAD: Final = REGIONS.index("head")


def leaving_out(
    surface: TargetSurface, layer: Layer, body: F64, bodies: Skeletons
) -> Generator[float, None, npt.NDArray[np.bool_]]:
    """Generator: mask (N,) of the cut triangles of unused layers; yields progress 0..1.

    ``body`` (V, 3) is the canonical avatar in the target's pose, normalised space. All False for a
    surface with a single large piece.
    """
    from scipy.spatial import cKDTree

    pieces = connected_pieces(weld(surface.points)[surface.triangles])
    areas = np.bincount(pieces, areas_of(surface.points, surface.triangles))
    is_left_out = np.zeros(len(surface.parent), bool)
    if np.count_nonzero(areas >= _LARGE * areas.sum()) < 2:
        return is_left_out
    piece, region = pieces[surface.parent], surface.region[surface.parent]
    is_large = areas[piece] >= _LARGE * areas.sum()
    far, _ = cKDTree(body).query(surface.centres, distance_upper_bound=_NEAR_M, workers=-1)
    candidates = np.flatnonzero((is_large | (region == _HEAD)) & (far < np.inf))
    # Clothes: the layer that is not wanted. Heads: the outer layer (hats, hair) in any case,
    # except over the face itself, where the inner one (teeth, eyeballs) goes.
    inner, outer = yield from _pairs(surface, candidates, piece, region, layer)
    on_head = region[inner] == _HEAD
    is_left_out[(inner if layer == "visible" else outer)[~on_head]] = True
    face, covering = _head_pieces(surface, piece, np.flatnonzero(region == _HEAD), bodies)
    is_left_out[covering] = True
    is_inside_face = on_head & (piece[outer] == face)  # teeth, eyeballs
    is_left_out[inner[is_inside_face]] = True
    is_left_out[outer[on_head & ~is_inside_face]] = True
    return is_left_out


def _pairs(
    surface: TargetSurface, candidates: I64, piece: I64, region: I64, layer: Layer
) -> Generator[float, None, tuple[I64, I64]]:
    """Generator: pairs (inner, outer) of overlapping cut triangles; yields progress 0..1.

    The outer triangle belongs to another piece, at most 4 cm above the inner, with a similar normal
    and an equal or adjacent region. Triangles already known to be left out are not searched again.
    """
    from scipy.spatial import cKDTree

    centres, normals = surface.centres[candidates], surface.flat_normals[surface.parent[candidates]]
    own = piece[candidates]
    tree = cKDTree(centres)
    inner, outer = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    is_settled = np.zeros(len(candidates), bool)
    depths = [depth_m for sign in (1.0, -1.0) for depth_m in sign * np.array(_DEPTHS_M)]
    if layer == "skin":  # starting at the layers to leave out settles most triangles early
        depths.reverse()
    for number, depth_m in enumerate(depths):
        yield number / len(depths)
        # Grid test once per direction: most triangles have no other piece nearby.
        if number % len(_DEPTHS_M) == 0:
            is_near_other = _near_other_piece(centres, own, ~is_settled)
        looks_from_left_out = number < len(_DEPTHS_M)
        # A second pass from the remaining layer finds pairs missed by the first: it asks all.
        is_queried = is_near_other & ~is_settled if looks_from_left_out else is_near_other
        queried = np.flatnonzero(is_queried)
        places = centres[queried] + depth_m * normals[queried]
        reach_m = _ASIDE_M + 0.3 * abs(depth_m)
        _, near = tree.query(places, k=6, distance_upper_bound=reach_m, workers=-1)
        row, column = np.nonzero(near < len(candidates))
        row, hit = queried[row], near[row, column]
        is_over = own[row] != own[hit]
        row, hit = row[is_over], hit[is_over]
        way = centres[hit] - centres[row]
        height = np.einsum("ni,ni->n", way, normals[row])
        aside = np.linalg.norm(way - height[:, None] * normals[row], axis=1)
        height = np.sign(depth_m) * height
        # Layers of the same skin: close above each other, of similar normals and near regions.
        is_over = (height > 5e-4) & (height < _DEEPEST_M) & (aside < _ASIDE_M)
        is_over &= np.einsum("ni,ni->n", normals[row], normals[hit]) > _ALIKE
        is_over &= _NEIGHBOURS[region[candidates[row]], region[candidates[hit]]]
        row, hit = row[is_over], hit[is_over]
        below, above_it = (row, hit) if depth_m > 0.0 else (hit, row)
        inner.append(candidates[below])
        outer.append(candidates[above_it])
        dropped = below if layer == "visible" else above_it
        is_settled[dropped[region[candidates[below]] != _HEAD]] = True
    return np.concatenate(inner), np.concatenate(outer)


def _near_other_piece(
    places: F64, piece: I64, is_counted: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Mask (N,) of points with a point of another piece, of those in ``is_counted``, in the same or
    an adjacent grid cell of 45 mm."""
    from scipy.ndimage import maximum_filter, minimum_filter

    cell = np.floor((places - places.min(axis=0, initial=0.0)) / _CELL_M).astype(np.int64)
    size = cell.max(axis=0, initial=0) + 1
    cell = np.ravel_multi_index(tuple(cell.T), tuple(size))
    lowest, highest = np.full(size.prod(), len(places)), np.full(size.prod(), -1)
    _, number = np.unique(piece, return_inverse=True)
    np.minimum.at(lowest, cell[is_counted], number[is_counted])
    np.maximum.at(highest, cell[is_counted], number[is_counted])
    # A cell neighbourhood has another piece if its lowest or highest piece number differs.
    lowest = minimum_filter(lowest.reshape(size), 3, mode="nearest").ravel()
    highest = maximum_filter(highest.reshape(size), 3, mode="nearest").ravel()
    return (lowest[cell] < number) | (highest[cell] > number)


def _head_pieces(
    surface: TargetSurface, piece: I64, head_triangles: I64, bodies: Skeletons
) -> tuple[int, I64]:
    """Piece of the face (-1 without a head), and cut triangles above or inside the head.

    The face is the piece hit first in most viewing directions from between the eyes. Pieces in the
    direction of face skin are hats, hair, teeth or eyeballs. ``piece`` (N,) is the piece of each
    cut triangle, ``head_triangles`` (n,) are the cut triangles of the head.
    """
    from scipy.spatial import cKDTree

    joint = next((name for name in ("head", "neck") if name in bodies.joints), None)
    if joint is None or not len(head_triangles):
        return -1, head_triangles[:0]
    eyes = bodies.joints[joint] - bodies.canonical[joint] + bodies.canonical["head"] + _EYES_M
    way = surface.centres[head_triangles] - eyes
    off_m = np.linalg.norm(way, axis=1)
    way /= np.maximum(off_m, 1e-9)[:, None]
    face = _face(piece[head_triangles], way, off_m)
    is_face = piece[head_triangles] == face
    above = np.flatnonzero(~is_face & (way[:, 2] > _CHIN))
    if not (is_face.any() and len(above)):
        return face, head_triangles[:0]
    aside, _ = cKDTree(way[is_face]).query(way[above], workers=-1)
    return face, head_triangles[above[aside < _STEP]]


def _face(piece: I64, way: F64, off_m: F64) -> int:
    """Piece hit first in most forward directions; -1 if no triangle lies ahead.

    A solid inside the head that comes out behind (a sphere as hair) is also hit before the face.
    Then the face is the piece behind the solid ahead, and below it elsewhere.
    """
    pieces, row = np.unique(piece, return_inverse=True)
    steps = np.round(way / _STEP).astype(int)
    cells, column = np.unique(steps, axis=0, return_inverse=True)
    # Distance of each piece in each cell of viewing directions; inf without a triangle there.
    nearest = np.full((len(pieces), len(cells)), np.inf)
    np.minimum.at(nearest, (row, column.ravel()), off_m)
    ahead = cells[:, 1] * _STEP < -_AHEAD  # normalised bodies face -Y
    if not ahead.any():
        return -1
    first = np.bincount(nearest[:, ahead].argmin(axis=0), minlength=len(pieces))
    face = int(first.argmax())
    # A piece hidden ahead by the winner but in front of it elsewhere is the true face.
    both = np.isfinite(nearest) & np.isfinite(nearest[face])
    beyond = both & (nearest > nearest[face])
    below = both & (nearest < nearest[face])
    holds = (beyond & ahead).sum(axis=1) > first[face] / 2
    holds &= (below & ~ahead).sum(axis=1) > (both & ~ahead).sum(axis=1) / 2
    if holds.any():
        face = int(np.where(holds, (beyond & ahead).sum(axis=1), -1).argmax())
    return int(pieces[face])


def _neighbours() -> npt.NDArray[np.bool_]:
    """Table (R + 1, R + 1) of equal or adjacent regions; the last row is "no region"."""
    table = np.zeros((len(REGIONS) + 1, len(REGIONS) + 1), bool)
    for number, region in enumerate(REGIONS):
        upper = REGIONS.index(above(region))
        table[number, number] = table[number, upper] = table[upper, number] = True
    return table


_NEIGHBOURS: Final = _neighbours()
