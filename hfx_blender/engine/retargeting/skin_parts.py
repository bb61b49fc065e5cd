# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars of several meshes: detection of the skin, and its union.

Skin lies under hair and clothes, so of two meshes that cover the same region of the body the one
nearer to the bones is the skin. A mesh that covers no region that the others leave open (hair,
a jacket over a shirt, eyes, teeth) is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..body.model import Avatar, SkinWeights
from .joints import dominant
from .regions import REGIONS, known_regions, region_of
from .target import RigMapping, TargetAvatar, areas_of, group_shares, owners_of

_COVERS: Final = 0.15
"""Area in a region from which a mesh can be its skin, as a share of the canonical body's."""

_COVERED: Final = 0.4
"""Area from which a region has its skin."""

_IS_FINGER: Final = np.array([region.startswith("finger") for region in REGIONS])


@dataclass(frozen=True, eq=False)
class _Part:
    """Coverage of the body by one mesh."""

    cover: F64  # (R,) area in each region, as a share of the canonical body's
    bone_distance: float  # median distance of the vertices from the bones of their regions

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key: meshes that cover more come first, of equals those nearer to the bones."""
        return -int(np.count_nonzero(self.cover[~_IS_FINGER] >= _COVERS)), self.bone_distance


def ranked(avatar: Avatar, targets: Sequence[TargetAvatar], mapping: RigMapping) -> list[int]:
    """Indices of all meshes, the one that covers most of the body first."""
    parts = _parts(avatar, targets, mapping)
    return sorted(range(len(parts)), key=lambda k: (parts[k].rank, k))


def skin_of(avatar: Avatar, targets: Sequence[TargetAvatar], mapping: RigMapping) -> list[int]:
    """Indices of the meshes that together form the skin, in the order of :func:`ranked`.

    Parameters
    ----------
    targets : sequence of TargetAvatar
        Meshes of one armature.
    """
    parts = _parts(avatar, targets, mapping)
    covered = np.zeros(len(REGIONS))
    chosen: list[int] = []
    for number in sorted(range(len(parts)), key=lambda k: (parts[k].rank, k)):
        cover = parts[number].cover
        if np.any((cover >= _COVERS) & (covered < _COVERED)):
            chosen.append(number)
            covered += cover
    return chosen


def joined(targets: Sequence[TargetAvatar]) -> TargetAvatar:
    """The union of meshes of one armature: their vertices one after the other.

    Nothing is welded, so that vertex ``k`` of mesh ``m`` has the number ``k`` plus the number of
    vertices of all meshes before ``m``.
    """
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


def _parts(avatar: Avatar, targets: Sequence[TargetAvatar], mapping: RigMapping) -> list[_Part]:
    stands_for = known_regions(mapping.bones)
    number = {region: k for k, region in enumerate(REGIONS)}
    faces = avatar.faces.astype(np.int64)
    triangles = np.concatenate((faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]))
    names = avatar.skeleton.bone_names
    of_canonical = np.array([number[stands_for[region_of(name)]] for name in names])
    expected = _areas_by_region(
        avatar.vertices.astype(np.float64),
        triangles,
        group_shares(avatar.weights, of_canonical, len(REGIONS)),
    )
    if not targets:
        return []
    scale = _scale(avatar, targets[0], mapping)
    # A rig without, say, fingers has none to cover.
    expected = np.where(expected > 0.0, expected * scale**2, np.inf)
    return [_part(target, mapping, number, expected) for target in targets]


def _part(
    target: TargetAvatar, mapping: RigMapping, number: dict[str, int], expected: F64
) -> _Part:
    if not len(target.weights.bones):
        return _Part(np.zeros(len(REGIONS)), np.inf)
    owners = owners_of(target, {rig_bone: bone for bone, rig_bone in mapping.bones.items()})
    regions = np.array([-1 if o is None else number[region_of(o)] for o in owners], np.int64)
    shares = group_shares(target.weights, regions, len(REGIONS))
    areas = _areas_by_region(target.vertices, target.triangles, shares)
    return _Part(areas / expected, _bone_distance(target, mapping, owners))


def _areas_by_region(points: F64, triangles: I64, shares: F64) -> F64:
    if not len(triangles):
        return np.zeros(len(REGIONS))
    region = dominant(shares[triangles].mean(axis=1))
    kept = region >= 0
    areas = areas_of(points, triangles[kept])
    return np.bincount(region[kept], areas, minlength=len(REGIONS)).astype(np.float64)


def _scale(avatar: Avatar, target: TargetAvatar, mapping: RigMapping) -> float:
    """Size of a rig against the canonical one: spread of the bones that both have."""
    skeleton = avatar.skeleton
    heads = dict(zip(skeleton.bone_names, skeleton.rest[:, :3, 3].astype(float), strict=True))
    rig = {bone.name: np.asarray(bone.head, np.float64) for bone in target.bones}
    pairs = [(heads[bone], rig[own]) for bone, own in mapping.bones.items() if own in rig]
    one, other = (np.array(places).reshape(-1, 3) for places in zip(*pairs, strict=True))
    spread = float(np.linalg.norm(one - one.mean(axis=0)))
    return float(np.linalg.norm(other - other.mean(axis=0))) / spread if spread > 0.0 else 1.0


def _bone_distance(target: TargetAvatar, mapping: RigMapping, owners: list[str | None]) -> float:
    """Median distance of the vertices from the mapped bones that they follow."""
    rig = {bone.name: bone for bone in target.bones}
    owner = [mapping.bones.get(name, "") if name else "" for name in owners]
    known = np.array([name in rig for name in owner])
    starts = np.array([rig[n].head if n in rig else (0.0, 0.0, 0.0) for n in owner], np.float64)
    ends = np.array([rig[n].tail if n in rig else (0.0, 0.0, 0.0) for n in owner], np.float64)
    weights = target.weights
    counts = np.diff(weights.offsets)
    if not counts.any():
        return np.inf
    rows = np.repeat(np.arange(len(counts)), counts)
    order = np.lexsort((-weights.values, rows))
    first = order[np.concatenate(([0], np.cumsum(counts)[:-1]))[counts > 0]]
    bone, vertex = weights.bones[first], rows[first]
    kept = known[bone]
    if not kept.any():
        return np.inf
    bone, points = bone[kept], target.vertices[vertex[kept]]
    along = ends[bone] - starts[bone]
    squares = np.maximum(np.einsum("ni,ni->n", along, along), 1e-30)
    share = np.clip(np.einsum("ni,ni->n", points - starts[bone], along) / squares, 0.0, 1.0)
    feet = starts[bone] + share[:, None] * along
    return float(np.median(np.linalg.norm(points - feet, axis=1)))
