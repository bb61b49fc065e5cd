# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice and union of the meshes of an avatar that show the body.

The canonical avatar is posed to the rig's joints; each vertex votes for the mesh with the nearest
used layer. Meshes without a region of the body (eyes, teeth, covered skin, hair above a head,
swords) are left out.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..arrays import F64
from ..body.model import Avatar, SkinWeights
from .bone_regions import REGIONS
from .canonical_pose import matrices, posed
from .joints import dominant, skeletons_of
from .layers import Layer, leaving_out
from .surface import TargetSurface, vertex_normals
from .target import RigMapping, TargetAvatar, vertex_areas

# Smallest fraction of a region's surface shown by a chosen mesh; excludes eyes and teeth
_SHOWS: Final = 0.1
# Largest distance of a mesh from the posed canonical body, metres at canonical size
_REACH_M: Final = 0.12


def skin_of(
    avatar: Avatar, targets: Sequence[TargetAvatar], mapping: RigMapping, layer: Layer = "visible"
) -> Generator[float, None, list[int]]:
    """Generator: indices of the meshes of the body, largest area first; yields progress 0..1.

    A mesh of the armature is chosen if it is nearest to at least a tenth of any region of the posed
    canonical body. ``layer`` ("visible" or "skin") has the haptic vertices where clothes cover
    skin. Raises InputError: joints are missing or not human.
    """
    shown = yield from _shown(avatar, targets, mapping, layer)
    whole = np.maximum(shown.sum(axis=0), 1e-30)
    is_needed = (shown / whole >= _SHOWS).any(axis=1)
    return [k for k in np.argsort(-shown.sum(axis=1), kind="stable").tolist() if is_needed[k]]


def _shown(
    avatar: Avatar, targets: Sequence[TargetAvatar], mapping: RigMapping, layer: Layer
) -> Generator[float, None, F64]:
    """Generator: area (M, R) of the posed canonical body nearest to each of M meshes, by region,
    without unused layers; 0 for meshes without triangles or weights. Yields progress 0..1."""
    shown_areas = np.zeros((len(targets), len(REGIONS)))
    used = [k for k, t in enumerate(targets) if len(t.triangles) and len(t.weights.bones)]
    if not used:
        return shown_areas
    union = joined([targets[k] for k in used])
    bodies = skeletons_of(avatar, union, mapping)
    triangles = avatar.triangles
    body, shares = posed(avatar, matrices(avatar, bodies)), bodies.avatar_shares
    normals = vertex_normals(body, triangles)
    surface = TargetSurface(bodies.points, union.triangles, bodies.target_shares)
    surface.leave_out((yield from leaving_out(surface, layer, body, bodies)))
    places = surface.nearest(body, normals, shares, _REACH_M)
    # Votes: each canonical vertex gives its area to the mesh of its nearest place.
    mesh = np.repeat(used, [len(targets[k].triangles) for k in used])[places.triangle]
    area = vertex_areas(body, triangles)
    np.add.at(shown_areas, (mesh[places.found], dominant(shares)[places.found]), area[places.found])
    return shown_areas


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
