# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of an avatar's surface: skin, and clothes above the skin.

A layer is a connected piece of surface, regardless of meshes. Where layers overlap, the outer layer
is used ("visible") or the inner layer ("skin"). Hair and hats above a head are never used. Of an
avatar's meshes, those with a used layer nearest to the posed canonical body show the body; eyes,
teeth, covered skin, hair above a head and swords do not.
"""

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from ..body.model import Avatar, SkinWeights
from ..body.rigs.mapping import BoneMapping
from .bone_regions import REGIONS, above
from .canonical_pose import matrices, posed
from .joints import Skeletons, dominant, skeletons_of
from .surface import TargetSurface, vertex_normals
from .target import TargetAvatar, areas_of, connected_pieces, vertex_areas, weld

Layer = Literal["visible", "skin"]

# Heights of the search for another layer, metres at canonical size (1.8 m)
_DEPTHS_M: Final = (0.003, 0.01, 0.02, 0.032)
# Largest distance from clothes to covered skin; capes and wide skirts cover no skin
_DEEPEST_M: Final = 0.04
# Largest lateral distance to another layer: half the size of a cut triangle
_ASIDE_M: Final = 0.014
_CELL_M: Final = 0.045  # edge of grid cells of the coarse search; at least the distance of layers
_ALIKE: Final = 0.3  # smallest cosine between the normals of two layers
_NEAR_M: Final = 0.16  # largest distance of layers from the posed body (big heads, capes)
# Smallest fraction of the surface of a covering piece; smaller are buttons, eyelashes
_LARGE: Final = 0.004
# Offset from the canonical head joint to the point between eyes and ears
_EYES_M: Final = np.array([0.0, -0.01, 0.07])
_AHEAD: Final = 0.5  # smallest forward component of a viewing direction (60 degrees to all sides)
_STEP: Final = 0.15  # cell size of viewing directions, as a difference of unit vectors
_CHIN: Final = -0.35  # smallest upward component of directions to hats and hair
_HEAD: Final = REGIONS.index("head")
# Number of the parent of each region
_ABOVE: Final = np.array([REGIONS.index(above(region)) for region in REGIONS])
# Smallest fraction of a region's surface shown by a chosen mesh; excludes eyes and teeth
_SHOWS: Final = 0.1
# Largest distance of a mesh from the posed canonical body, metres at canonical size
_SHOWN_M: Final = 0.12


def leaving_out(
    surface: TargetSurface, layer: Layer, body: F64, bodies: Skeletons
) -> Generator[float, None, npt.NDArray[np.bool_]]:
    """Generator: mask (N,) of the cut triangles of unused layers; yields progress 0..1. ``body``
    (V, 3) is the canonical avatar in the target's pose, normalised space. All False for a surface
    with a single large piece."""
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
    """Generator: pairs (inner, outer) of overlapping cut triangles; yields progress 0..1. The outer
    triangle belongs to another piece, at most 4 cm above the inner, with a similar normal and an
    equal or adjacent region. Triangles already known to be left out are not searched again."""
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
        # Positive along the direction of search.
        height = np.sign(depth_m) * height
        # Layers of the same skin: close above each other, of similar normals and near regions.
        is_over = (height > 5e-4) & (height < _DEEPEST_M) & (aside < _ASIDE_M)
        is_over &= np.einsum("ni,ni->n", normals[row], normals[hit]) > _ALIKE
        first, second = region[candidates[row]], region[candidates[hit]]
        is_adjacent = (first == second) | (_ABOVE[first] == second) | (first == _ABOVE[second])
        is_over &= is_adjacent & (first >= 0) & (second >= 0)
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
    # Distances of unit vectors: about the angles to the nearest direction of face skin.
    aside, _ = cKDTree(way[is_face]).query(way[above], workers=-1)
    return face, head_triangles[above[aside < _STEP]]


def _face(piece: I64, way: F64, off_m: F64) -> int:
    """Piece hit first in most forward directions; -1 if no triangle lies ahead. A solid inside the
    head that comes out behind (a sphere as hair) is also hit before the face. Then the face is the
    piece behind the solid ahead, and below it elsewhere."""
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


def skin_of(
    avatar: Avatar, targets: Sequence[TargetAvatar], mapping: BoneMapping, layer: Layer = "visible"
) -> Generator[float, None, list[int]]:
    """Generator: indices of the meshes of the body, largest area first; yields progress 0..1.

    A mesh of the armature is chosen if it is nearest to at least a tenth of any region of the posed
    canonical body. ``layer`` ("visible" or "skin") has the haptic vertices where clothes cover
    skin. Raises InputError: joints are missing or not human.
    """
    used = [k for k, t in enumerate(targets) if len(t.triangles) and len(t.weights.bones)]
    if not used:
        return []
    union = joined([targets[k] for k in used])
    bodies = skeletons_of(avatar, union, mapping)
    triangles = avatar.triangles
    body, shares = posed(avatar, matrices(avatar, bodies)), bodies.avatar_shares
    normals = vertex_normals(body, triangles)
    surface = TargetSurface(bodies.points, union.triangles, bodies.target_shares)
    surface.leave_out((yield from leaving_out(surface, layer, body, bodies)))
    places = surface.nearest(body, normals, shares, _SHOWN_M)
    # Votes: each canonical vertex gives its area to the mesh of its nearest place.
    mesh = np.repeat(used, [len(targets[k].triangles) for k in used])[places.triangle]
    area = vertex_areas(body, triangles)
    shown = np.zeros((len(targets), len(REGIONS)))
    np.add.at(shown, (mesh[places.found], dominant(shares)[places.found]), area[places.found])
    is_needed = (shown / np.maximum(shown.sum(axis=0), 1e-30) >= _SHOWS).any(axis=1)
    return [k for k in np.argsort(-shown.sum(axis=1), kind="stable").tolist() if is_needed[k]]


def joined(targets: Sequence[TargetAvatar]) -> TargetAvatar:
    """Union of the meshes of one armature, with concatenated vertices (nothing is welded); a single
    mesh itself. Vertex ``k`` of mesh ``m`` has the number ``k`` plus the vertex counts of all
    meshes before ``m``."""
    if len(targets) == 1:
        return targets[0]
    names = tuple(dict.fromkeys(name for target in targets for name in target.bone_names))
    column = {name: number for number, name in enumerate(names)}
    triangles, offsets, bones, values = [], [np.zeros(1, np.int64)], [], []
    vertex = entry = 0
    for target in targets:
        weights = target.weights
        own = np.array([column[name] for name in target.bone_names], np.int32)
        triangles.append(target.triangles + vertex)
        offsets.append(weights.offsets[1:].astype(np.int64) + entry)
        bones.append(own[weights.bones])
        values.append(weights.values)
        vertex += len(target.vertices)
        entry += len(weights.bones)
    return replace(
        targets[0],
        vertices=np.concatenate([target.vertices for target in targets]),
        triangles=np.concatenate(triangles),
        weights=SkinWeights(
            np.concatenate(offsets).astype(np.int32), np.concatenate(bones), np.concatenate(values)
        ),
        bone_names=names,
    )
