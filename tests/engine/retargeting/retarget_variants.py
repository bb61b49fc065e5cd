# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars with a known answer: generated variants of the base mesh and of the shipped avatar.

Every variant keeps the base mesh's vertices, which gives the truth: a perceptual vertex stays at
the same point of the same triangle under any shape, pose or scale.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.body.model import Avatar, PerceptualModel, SkinWeights, load_avatar
from hfx_blender.engine.retargeting import retarget
from hfx_blender.engine.retargeting.layers import Layer
from hfx_blender.engine.retargeting.target import TargetAvatar
from hfx_blender.engine.stepwise import finish
from hfx_tools.body_building import skeleton, source

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

RIGS = {
    "default": ("standard/rig.default.json", "standard/weights.default.json"),
    "mixamo": ("standard/rig.mixamo.json", "standard/weights.mixamo.json"),
    "game_engine": ("standard/rig.game_engine.json", "standard/weights.game_engine.json"),
    "cmu": ("standard/rig.cmu_mb.json", "standard/weights.cmu_mb.json"),
    "rigify": ("rigify/rig.human_toes.json", "rigify/weights.human_toes.json"),
}

_MACRO = "targets/macrodetails/"
_LOCAL_SHARE = 0.7
LOCAL = {
    "fat thighs": ("legs/l-upperleg-fat-incr", "legs/r-upperleg-fat-incr",
                   "hip/hip-scale-horiz-incr", "buttocks/buttocks-volume-incr"),
    "muscular": ("legs/l-upperleg-muscle-incr", "legs/r-upperleg-muscle-incr",
                 "legs/l-lowerleg-muscle-incr", "legs/r-lowerleg-muscle-incr",
                 "arms/l-upperarm-muscle-incr", "arms/r-upperarm-muscle-incr"),
    "long legs": ("legs/upperlegs-height-incr", "legs/lowerlegs-height-incr"),
    "short legs": ("legs/upperlegs-height-decr", "legs/lowerlegs-height-decr"),
    "pregnant": ("stomach/stomach-pregnant-incr",),
    "slim waist": ("hip/hip-scale-depth-decr", "stomach/stomach-tone-incr",
                   "hip/hip-scale-vert-incr"),
}  # fmt: skip
"""People shaped by targets of single body parts, of which the shipped shapes know nothing."""


def _locally(*targets: str) -> dict[str, float]:
    return {
        **source.AVERAGE_ADULT,
        **{f"targets/{name}.target.gz": _LOCAL_SHARE for name in targets},
    }


SHAPES: Mapping[str, Mapping[str, float]] = {
    "base": {},
    "average": source.AVERAGE_ADULT,
    "woman": {
        f"{_MACRO}asian-female-young.target.gz": 1.0,
        f"{_MACRO}universal-female-young-averagemuscle-averageweight.target.gz": 1.0,
    },
    "man": {
        f"{_MACRO}african-male-young.target.gz": 1.0,
        f"{_MACRO}universal-male-young-maxmuscle-averageweight.target.gz": 1.0,
    },
    "heavy": {
        f"{_MACRO}caucasian-male-young.target.gz": 1.0,
        f"{_MACRO}universal-male-young-averagemuscle-maxweight.target.gz": 1.0,
    },
    "thin": {
        f"{_MACRO}caucasian-female-young.target.gz": 1.0,
        f"{_MACRO}universal-female-young-minmuscle-minweight.target.gz": 1.0,
    },
    "tall": {
        **source.AVERAGE_ADULT,
        f"{_MACRO}height/male-young-averagemuscle-averageweight-maxheight.target.gz": 0.5,
    },
    "old": {
        f"{_MACRO}caucasian-female-old.target.gz": 1.0,
        f"{_MACRO}universal-female-old-averagemuscle-averageweight.target.gz": 1.0,
    },
    "child": {
        f"{_MACRO}african-female-child.target.gz": 1.0,
        f"{_MACRO}universal-female-child-averagemuscle-averageweight.target.gz": 1.0,
    },
    **{name: _locally(*targets) for name, targets in LOCAL.items()},
}


def folder() -> Path:
    """Return the folder of the MakeHuman data; raises ``InputError`` if not installed."""
    named = os.environ.get("HFX_MAKEHUMAN_DATA")
    return source.locate(Path(named) if named else None)


@lru_cache(maxsize=1)
def _average() -> source.Source:
    return source.read(folder())


@lru_cache(maxsize=1)
def _base() -> F64:
    """Return the unshaped base mesh, decimetres, Y up."""
    return source.read_obj(folder() / source.BASE_MESH)[0]


def shaped(shape: str) -> source.Source:
    """Return the base mesh as a person of :data:`SHAPES`, metres, Z up."""
    vertices = _base().copy()
    for name, share in SHAPES[shape].items():
        moved, offsets = source.read_target(folder() / name)
        vertices[moved] += share * offsets
    return replace(_average(), vertices=0.1 * vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0))


def warp(
    avatar: Avatar, target: TargetAvatar, mapping: retarget.BoneMapping, layer: Layer = "visible"
) -> retarget.Warp:
    """Return :func:`retarget.warping` as a single step."""
    return finish(retarget.warping(avatar, target, mapping, layer))


@dataclass(frozen=True, eq=False)
class RigBone:
    """Bone at rest."""

    name: str
    parent: str | None
    head: F64
    tail: F64
    deform: bool = True


@dataclass(frozen=True, eq=False)
class Variant:
    """Target avatar, with a counterpart for each vertex of the shipped avatar."""

    target: TargetAvatar
    places: F64  # (A, 3) counterpart of each vertex of the shipped avatar, target's space

    def truth(self, model: PerceptualModel) -> F64:
        """Return true positions of the vertices of a perceptual model."""
        corners = self.places[model.avatar_vertices]
        return np.einsum("vc,vci->vi", model.avatar_weights.astype(np.float64), corners)


def source_vertices(avatar: Avatar) -> I64:
    """Return the base-mesh vertex of each vertex of the shipped avatar."""
    runs = avatar.provenance["source_vertices"]
    return np.concatenate([np.arange(first, last + 1) for first, last in runs])


def rigged(shape: str, rig: str) -> Variant:
    """Return a shaped base mesh with one of MakeHuman's rigs and the rig's weights."""
    data = shaped(shape)
    rig_file, weight_file = RIGS[rig]
    bones = json.loads((folder() / "rigs" / rig_file).read_bytes())
    bones = bones.get("bones", bones)
    joints = replace(data, rig=bones)
    rig_bones = tuple(
        RigBone(
            name,
            bone["parent"] or None,
            skeleton.joint(joints, bone["head"]),
            skeleton.joint(joints, bone["tail"]),
        )
        for name, bone in bones.items()
    )
    weights_by_bone = json.loads((folder() / "rigs" / weight_file).read_bytes())["weights"]
    used, faces = np.unique(data.faces, return_inverse=True)
    quads = faces.reshape(data.faces.shape)
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    names = tuple(bone.name for bone in rig_bones)
    weights = _weights(weights_by_bone, names, used, len(data.vertices))
    target = TargetAvatar(
        vertices=data.vertices[used],
        triangles=triangles.astype(np.int64),
        weights=weights,
        bone_names=names,
        bones=rig_bones,
    )
    return Variant(target, data.vertices[source_vertices(load_avatar())])


def _weights(
    stored: dict[str, list[tuple[int, float]]], names: tuple[str, ...], used: I64, count: int
) -> SkinWeights:
    index = {name: number for number, name in enumerate(names)}
    vertex_row = np.full(count, -1)
    vertex_row[used] = np.arange(len(used))
    # Rigify's weights name halves of limbs, present only in the generated rig.
    whole = {name: name.removeprefix("DEF-").removesuffix(".001") for name in stored}
    whole |= {name: name for name in stored if name in index}
    rows = [
        (vertex_row[vertex], index[whole[name]], value)
        for name, entries in stored.items()
        if whole[name] in index
        for vertex, value in entries
        if vertex_row[vertex] >= 0 and value > 0.0
    ]
    table = np.array(rows)
    order = np.lexsort((table[:, 1], table[:, 0]))
    table = table[order]
    owners = table[:, 0].astype(np.int64)
    sums = np.bincount(owners, table[:, 2], minlength=len(used))
    offsets = np.searchsorted(owners, np.arange(len(used) + 1))
    return SkinWeights(
        offsets.astype(np.int32),
        table[:, 1].astype(np.int32),
        (table[:, 2] / sums[owners]).astype(np.float32),
    )


def shuffled(variant: Variant, seed: int = 1) -> Variant:
    """Return the variant with shuffled vertices, not recognisable as the base mesh."""
    target = variant.target
    order = np.random.default_rng(seed).permutation(len(target.vertices))
    rank = np.argsort(order)
    return replace(
        variant,
        target=replace(
            target,
            vertices=target.vertices[order],
            triangles=rank[target.triangles],
            weights=rows_of(target.weights, order),
        ),
    )


def rows_of(weights: SkinWeights, rows: I64) -> SkinWeights:
    """Return skin weights of some vertices."""
    counts = np.diff(weights.offsets)[rows]
    offsets = np.append(0, np.cumsum(counts))
    entries = (
        np.repeat(weights.offsets[rows], counts)
        + np.arange(offsets[-1])
        - np.repeat(offsets[:-1], counts)
    )
    return SkinWeights(offsets.astype(np.int32), weights.bones[entries], weights.values[entries])


def decimated(variant: Variant, share: float = 0.4) -> Variant:
    """Return another mesh of the same shape: quadric decimation, weights of the nearest vertex."""
    import fast_simplification
    from scipy.spatial import cKDTree

    target = variant.target
    points, triangles = fast_simplification.simplify(
        target.vertices.astype(np.float32), target.triangles.astype(np.int32), 1.0 - share
    )
    nearest = cKDTree(target.vertices).query(points)[1]
    return replace(
        variant,
        target=replace(
            target,
            vertices=points.astype(np.float64),
            triangles=triangles.astype(np.int64),
            weights=rows_of(target.weights, nearest),
        ),
    )


def moved(variant: Variant, matrix: F64) -> Variant:
    """Return the avatar in another space: turned axes, centimetres."""

    def apply(points: F64) -> F64:
        return points @ matrix[:3, :3].T + matrix[:3, 3]

    target = variant.target
    bones = tuple(
        RigBone(bone.name, bone.parent, apply(np.asarray(bone.head)), apply(np.asarray(bone.tail)))
        for bone in target.bones
    )
    return Variant(
        replace(target, vertices=apply(target.vertices), bones=bones), apply(variant.places)
    )


def posed(variant: Variant, turns: Mapping[str, F64], stretches: Mapping[str, float]) -> Variant:
    """Return a new rest pose: bones turned about the heads, and stretched with all children.

    Parameters
    ----------
    turns : mapping of bone to (3, 3)
        Turns in the space of the avatar.
    stretches : mapping of bone to factor
        Factor along the bone; children move along.
    """
    target = variant.target
    index = {bone.name: number for number, bone in enumerate(target.bones)}
    matrices: dict[str, F64] = {}

    def matrix_of(name: str) -> F64:
        if name not in matrices:
            bone = target.bones[index[name]]
            above = np.eye(4) if bone.parent is None else _unstretched(bone.parent)
            if bone.parent in stretches:  # starts at the new end of the parent
                parent = target.bones[index[bone.parent]]
                axis = np.asarray(parent.tail) - np.asarray(parent.head)
                along = axis / np.linalg.norm(axis)
                reach = (np.asarray(bone.head) - np.asarray(parent.head)) @ along
                push = np.eye(4)
                push[:3, 3] = (stretches[bone.parent] - 1.0) * reach * along
                above = above @ push
            turn = np.eye(4)
            turn[:3, :3] = turns.get(name, np.eye(3))
            head = np.asarray(bone.head)
            turn[:3, 3] = head - turn[:3, :3] @ head
            matrices[name] = above @ turn
        return matrices[name]

    def _unstretched(name: str) -> F64:
        return matrix_of(name)

    def stretched(name: str) -> F64:
        matrix = matrix_of(name)
        if name not in stretches:
            return matrix
        bone = target.bones[index[name]]
        head, axis = np.asarray(bone.head), np.asarray(bone.tail) - np.asarray(bone.head)
        along = axis / np.linalg.norm(axis)
        pull = np.eye(4)
        pull[:3, :3] += (stretches[name] - 1.0) * np.outer(along, along)
        pull[:3, 3] = head - pull[:3, :3] @ head
        return matrix @ pull

    skinning = np.stack([stretched(bone.name) for bone in target.bones])

    def skin(points: F64, weights: SkinWeights) -> F64:
        owners = np.repeat(np.arange(len(points)), np.diff(weights.offsets))
        blended = np.zeros((len(points), 4, 4))
        np.add.at(blended, owners, weights.values[:, None, None] * skinning[weights.bones])
        blended /= blended[:, 3:, 3:]
        return np.einsum("vij,vj->vi", blended[:, :3, :3], points) + blended[:, :3, 3]

    bones = tuple(
        RigBone(
            bone.name,
            bone.parent,
            *(
                skinning[number, :3, :3] @ np.asarray(end) + skinning[number, :3, 3]
                for end in (bone.head, bone.tail)
            ),
        )
        for number, bone in enumerate(target.bones)
    )
    new = skin(target.vertices, target.weights)
    from scipy.spatial import cKDTree

    nearest = cKDTree(target.vertices).query(variant.places)[1]
    places = skin(variant.places, rows_of(target.weights, nearest))
    return Variant(replace(target, vertices=new, bones=bones), places)


def turn(axis: int, degrees: float) -> F64:
    """Return a turn about a coordinate axis."""
    angle = np.radians(degrees)
    eye = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    if axis == 1:
        i, j = j, i
    eye[i, i] = eye[j, j] = np.cos(angle)
    eye[i, j], eye[j, i] = -np.sin(angle), np.sin(angle)
    return eye


def canonical() -> Variant:
    """Return the shipped avatar with the shipped skeleton and weights."""
    avatar = load_avatar()
    skeleton_ = avatar.skeleton
    names = skeleton_.bone_names
    rest = skeleton_.rest.astype(np.float64)
    bones = tuple(
        RigBone(
            name,
            names[parent] if parent >= 0 else None,
            matrix[:3, 3],
            matrix[:3, 3] + float(length) * matrix[:3, 1],
        )
        for name, parent, matrix, length in zip(
            names, skeleton_.parents, rest, skeleton_.lengths_m, strict=True
        )
    )
    quads = avatar.faces.astype(np.int64)
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    vertices = avatar.vertices.astype(np.float64)
    return Variant(TargetAvatar(vertices, triangles, avatar.weights, names, bones), vertices)
