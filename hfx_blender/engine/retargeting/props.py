# SPDX-License-Identifier: GPL-3.0-or-later
"""Props moved by an avatar's rig that are not skin: weapons, backpacks, wings.

A prop is a connected piece, or a whole mesh on one bone, protruding from the body and weighted only
to bones outside of the body, or to one hand, finger or forearm. Clothes, hair, and the only skin
of a region (a hand as separate mesh) are not props.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64, I64
from ..body.model import Avatar
from ..body.rigs.mapping import BoneMapping
from .bone_regions import region_of
from .canonical_pose import matrices, posed
from .joints import skeletons_of
from .layers import joined
from .target import TargetAvatar, areas_of, connected_pieces, owners_of, weld, with_ancestors

# Smallest distance of a protruding vertex from the body, metres at canonical size
_REACH_M: Final = 0.12
_BESIDE_M: Final = 0.06  # smallest distance of a surface outside of the body
_MOSTLY: Final = 0.5  # smallest fraction of a protruding surface outside of the body
_ALONE: Final = 0.99  # smallest skin weight of a vertex on a single bone

# Words of bones of hair and clothes (see :mod:`.layers`)
_WORN: Final = re.compile(
    "hair|bang|braid|tail_?hair|pony|cloth|skirt|cape|cloak|mantle|coat|dress|sleeve|scarf|robe|"
    "ribbon|hood|collar|jacket|shirt|pants|belt|tassel|\u9aea|\u30b9\u30ab\u30fc\u30c8|\u30de\u30f3\u30c8|\u8896",
    re.IGNORECASE,
)

_HOLDING: Final = ("hand", "finger", "forearm")


@dataclass(frozen=True)
class Prop:
    """Prop excluded from an avatar's skin."""

    mesh: int  # index of the avatar's mesh
    bone: str  # bone with the largest weight
    share: float  # fraction of the mesh's surface, 0..1


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Possible prop."""

    triangles: I64  # (n,) of the union
    bone: str
    region: str


def without_props(
    avatar: Avatar, targets: Sequence[TargetAvatar], mapping: BoneMapping
) -> tuple[list[TargetAvatar], list[Prop]]:
    """Copies of an avatar's meshes without the triangles of props, and the props: pieces that
    follow bones without a joint of the body, or one hand or forearm alone, and stick out of the
    body. If joints are missing or not human, the meshes are returned unchanged with an empty
    list."""
    union = joined(targets)
    candidates = _candidates(targets, union, mapping) if len(union.triangles) else []
    if not candidates:
        return list(targets), []
    try:
        whole = skeletons_of(avatar, union, mapping)
        rest = _without_candidates(union, candidates)
        bodies = skeletons_of(avatar, rest, mapping) if len(rest.triangles) else whole
        body = posed(avatar, matrices(avatar, bodies))
    except InputError:  # no body without the candidates
        return list(targets), []
    from scipy.spatial import cKDTree

    off_m, _ = cKDTree(body).query(bodies.points)
    areas = areas_of(bodies.points, union.triangles)
    held = [prop for prop in candidates if _sticks_out(prop, union, off_m, areas)]
    held.sort(key=lambda prop: float(off_m[union.triangles[prop.triangles]].max()))
    # Without all props a region may lack skin: give back, nearest first, props of lost regions.
    while held:
        try:
            lost = set(skeletons_of(avatar, _without_candidates(union, held), mapping).absent)
        except InputError:
            return list(targets), []
        lost -= set(whole.absent)
        needed = next((prop for prop in held if prop.region in lost), None)
        if needed is None:
            break
        held.remove(needed)
    return _split(targets, held, areas)


def _candidates(
    targets: Sequence[TargetAvatar], union: TargetAvatar, mapping: BoneMapping
) -> list[_Candidate]:
    """Pieces weighted to no bone of the body, or to one bone at the end of an arm. Pieces of a mesh
    on the same bone outside of the body form one candidate, as does a whole mesh on one bone.
    Pieces with unweighted vertices, on the head, or on bones of hair or clothes are skipped."""
    canonical = {rig_bone: bone for bone, rig_bone in mapping.bones.items()}
    owners = owners_of(union, canonical)
    carrying = with_ancestors({bone.name: bone.parent for bone in union.bones}, canonical)
    is_body = np.array([name in carrying for name in union.bone_names])
    regions = [region_of(owner) if owner else "torso" for owner in owners]
    weights = union.weights
    vertex = np.repeat(np.arange(len(union.vertices)), np.diff(weights.offsets))
    is_single = np.zeros(len(union.vertices), np.bool_)
    single = np.full(len(union.vertices), -1)
    alone = weights.values >= _ALONE
    is_single[vertex[alone]], single[vertex[alone]] = True, weights.bones[alone]
    on_body = np.zeros(len(union.vertices))
    np.add.at(on_body, vertex, weights.values * is_body[weights.bones])
    strongest = np.zeros(len(union.vertices), np.int64)
    # Ascending by weight: the last assignment to a vertex is the strongest bone.
    by_weight = np.lexsort((weights.values, vertex))
    strongest[vertex[by_weight]] = weights.bones[by_weight]
    is_bare = np.diff(weights.offsets) == 0

    piece = connected_pieces(weld(union.vertices)[union.triangles])
    mesh = np.repeat(np.arange(len(targets)), [len(target.triangles) for target in targets])
    groups: dict[tuple[str, int, int, int], list[I64]] = {}
    order = np.argsort(piece, kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(piece[order])) + 1):
        corners = np.unique(union.triangles[own])
        bone = int(strongest[corners[0]])
        if is_bare[corners].any():
            continue
        if (on_body[corners] < 1.0 - _ALONE).all():
            bones = {union.bone_names[k] for k in np.unique(strongest[corners])}
            if regions[bone] != "head" and not any(map(_WORN.search, bones)):
                groups.setdefault(("beside", int(mesh[own[0]]), bone, -1), []).append(own)
        elif is_single[corners].all() and (single[corners] == bone).all():
            if regions[bone].rstrip("12345.LR") in _HOLDING:
                whole = union.triangles[mesh == mesh[own[0]]]
                is_whole = bool((single[whole] == bone).all())
                number = -1 if is_whole else int(piece[own[0]])
                groups.setdefault(("held", int(mesh[own[0]]), bone, number), []).append(own)
    return [
        _Candidate(np.concatenate(rows), union.bone_names[key[2]], regions[key[2]])
        for key, rows in groups.items()
    ]


def _without_candidates(union: TargetAvatar, out: Sequence[_Candidate]) -> TargetAvatar:
    """Copy of the union without the triangles of the candidates ``out``; vertices stay."""
    is_left = np.ones(len(union.triangles), np.bool_)
    for candidate in out:
        is_left[candidate.triangles] = False
    return replace(union, triangles=union.triangles[is_left])


def _sticks_out(candidate: _Candidate, union: TargetAvatar, off_m: F64, areas: F64) -> bool:
    """True if any vertex is over 12 cm from the body, or over half of the area over 6 cm. ``off_m``
    (A,) are distances of vertices from the body, ``areas`` (F,) of triangles."""
    own = off_m[union.triangles[candidate.triangles]]
    area = areas[candidate.triangles]
    beside = float(area[own.mean(axis=1) > _BESIDE_M].sum())
    return bool(own.max() > _REACH_M) or beside > _MOSTLY * float(area.sum())


def _split(
    targets: Sequence[TargetAvatar], held: Sequence[_Candidate], areas: F64
) -> tuple[list[TargetAvatar], list[Prop]]:
    """Copies of the meshes without the triangles of ``held``, numbered in the union, and a prop for
    each of these. ``areas`` (F,) of the union's triangles."""
    counts = [len(target.triangles) for target in targets]
    mesh = np.repeat(np.arange(len(targets)), counts)
    starts = np.cumsum(counts) - counts
    is_left: npt.NDArray[np.bool_] = np.ones(len(mesh), np.bool_)
    props = []
    for candidate in held:
        is_left[candidate.triangles] = False
        number = int(mesh[candidate.triangles[0]])
        share = areas[candidate.triangles].sum() / max(float(areas[mesh == number].sum()), 1e-30)
        props.append(Prop(number, candidate.bone, float(share)))
    remaining = [
        replace(target, triangles=target.triangles[is_left[start : start + count]])
        for target, start, count in zip(targets, starts, counts, strict=True)
    ]
    return remaining, props
