# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures in the manner of third-party avatars, made from the shipped avatar, with known positions.

An engine's mannequin with twist bones, a crowd figure of a Biped in centimetres, half a body, and
shoes with thick soles; with other proportions, rest poses, clothes, and rigs with knees and elbows
displaced from the skin's. Each vertex of the shipped avatar keeps a counterpart, so the truth needs
no further data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import retarget_variants as variants
from dressed_avatars import renamed
from retarget_variants import RigBone, Variant
from rig_conventions import CONVENTIONS, MIXAMO

from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.retargeting.surface import vertex_normals

F64 = npt.NDArray[np.float64]

_TWISTS = {
    "upperarm02": "upperarm_twist_01_",
    "lowerarm02": "lowerarm_twist_01_",
    "upperleg02": "thigh_twist_01_",
    "lowerleg02": "calf_twist_01_",
}
ENGINE = CONVENTIONS["unreal 5"][1] | {
    f"{bone}.{side}": name + side.lower() for bone, name in _TWISTS.items() for side in "LR"
}
BIPED = CONVENTIONS["biped"][1]
CENTIMETRES = np.array([[100, 0, 0, 0], [0, 0, 100, 0], [0, -100, 0, 0], [0, 0, 0, 1]], float)
"""Unit and axes of a Biped's file: Y up."""


@dataclass(frozen=True)
class Figure:
    """Recipe of a figure; lengths in metres of a body 1.8 m tall."""

    name: str
    rig: Mapping[str, str] = field(default_factory=lambda: MIXAMO)
    stretches: Mapping[str, float] = field(default_factory=dict)  # segment -> factor
    girths: Mapping[str, float] = field(default_factory=dict)  # part -> factor
    turns: Mapping[str, F64] = field(default_factory=dict)
    clothes: tuple[str, ...] = ()
    lumps_m: float = 0.006  # size of smooth differences of the shape
    knees_m: float = 0.0  # how far the rig's knees lie below the skin's
    elbows_m: float = 0.0
    triangles: float = 0.4  # share of triangles left
    hips_m: float = 0.0  # how far the rig's hips lie above the skin's
    is_blurred: bool = False  # skin weights of a broad brush
    is_bound_anew: bool = False  # skin weights made from the rig's own joints
    seed: int = 1
    space: F64 = field(default_factory=lambda: np.eye(4))


def made(figure: Figure) -> Variant:
    """Build an avatar with the proportions, clothes, rig and skin weights of ``figure``."""
    person = variants.canonical()
    stretches = {
        f"{limb}{half}.{side}": factor
        for limb, factor in figure.stretches.items()
        for half in ("01", "02")
        for side in "LR"
    }
    person = _girded(person, figure.girths)
    person = variants.posed(person, figure.turns, stretches)
    person = _lumpy(person, figure.lumps_m, figure.seed)
    for piece in figure.clothes:
        person = CLOTHES[piece](person)
    person = variants.decimated(person, figure.triangles)
    if figure.is_blurred:
        person = _blurred(person)
    person = _with_displaced_joints(person, figure)
    if figure.is_bound_anew:
        person = _rebound(person)
    person = replace(renamed(person, figure.rig), places=person.places)
    if figure.rig is ENGINE:
        person = _with_flat_twists(person)
    return (
        variants.moved(person, figure.space) if not np.allclose(figure.space, np.eye(4)) else person
    )


def _part_names() -> npt.NDArray[np.str_]:
    return np.array(PARTS)[load_avatar().part]


def _girded(person: Variant, girths: Mapping[str, float]) -> Variant:
    """Enlarge parts about the axis of the bones, with smooth transitions."""
    heads = canonical_heads()
    axes = {
        "upper_leg": ("upperleg01", "lowerleg01"), "lower_leg": ("lowerleg01", "foot"),
        "upper_arm": ("upperarm01", "lowerarm01"), "forearm": ("lowerarm01", "wrist"),
    }  # fmt: skip
    points, names = person.places.copy(), _part_names()
    for part, factor in girths.items():
        for side in "LR":
            near = names == part
            if part in axes:
                start, end = (heads[f"{bone}.{side}"] for bone in axes[part])
                way = end - start
                along = (points - start) @ way / (way @ way)
                near &= np.sign(points[:, 0]) == (1 if side == "L" else -1)
                hat = np.clip(4.0 * np.minimum(along, 1.0 - along), 0.0, 1.0) * near
                axis = start + along[:, None] * way
            else:
                if side == "R":
                    continue
                centre = heads["head"] if part == "head" else points[near].mean(axis=0)
                flat = np.array([1.0, 1.0, 0.0]) if part == "torso" else np.ones(3)
                if part == "head":
                    hat = np.clip((points[:, 2] - centre[2] + 0.05) / 0.05, 0.0, 1.0) * near
                else:
                    height = (points[:, 2] - 0.9) / 0.6
                    hat = np.clip(4.0 * np.minimum(height, 1.0 - height), 0.0, 1.0) * near
                axis = centre * flat + points * (1.0 - flat)
            points += (factor - 1.0) * hat[:, None] * (points - axis)
    bones = person.target.bones
    if "head" in girths:
        centre = heads["head"]
        below = {
            bone.name for bone in bones if bone.name == "head" or _is_below(bones, bone, "head")
        }
        bones = tuple(
            RigBone(b.name, b.parent, *((girths["head"] * (np.asarray(e) - centre) + centre)
                                        if b.name in below else np.asarray(e)
                                        for e in (b.head, b.tail)))
            for b in bones
        )  # fmt: skip
    return Variant(replace(person.target, vertices=points, bones=bones), points)


def _is_below(bones: tuple[RigBone, ...], bone: RigBone, name: str) -> bool:
    parents = {item.name: item.parent for item in bones}
    at = bone.parent
    while at is not None and at != name:
        at = parents[at]
    return at is not None


def _lumpy(person: Variant, size_m: float, seed: int) -> Variant:
    """Return smooth random differences of the shape along the normals."""
    random = np.random.default_rng(seed)
    waves = random.normal(size=(24, 3)) * 12.0
    phases, sizes = random.uniform(0.0, 2.0 * np.pi, 24), random.normal(size=24)
    rest = load_avatar().vertices.astype(np.float64)
    heights = np.sin(rest @ waves.T + phases) @ sizes / np.sqrt(12.0)
    names = _part_names()
    heights *= np.where(np.isin(names, ("fingers", "hand_palm", "hand_dorsum")), 0.2, 1.0)
    normals = vertex_normals(person.target.vertices, person.target.triangles)
    points = person.target.vertices + size_m * heights[:, None] * normals
    return Variant(replace(person.target, vertices=points), points)


def _lifted(person: Variant, lift_m: F64) -> Variant:
    normals = vertex_normals(person.target.vertices, person.target.triangles)
    points = person.target.vertices + lift_m[:, None] * normals
    return Variant(replace(person.target, vertices=points), points)


def _soles(person: Variant, thick_m: float, heel_m: float) -> Variant:
    """Add shoes: soles move down, the heel farther than the ball; the rig's feet stay."""
    rest, names = load_avatar().vertices.astype(np.float64), _part_names()
    heads = canonical_heads()
    foot = np.isin(names, ("foot_sole", "foot_dorsum", "lower_leg"))
    shoe = np.clip((0.13 - rest[:, 2]) / 0.02, 0.0, 1.0) * foot
    ball, back = heads["toe2-1.L"][1], rest[foot, 1].max()
    behind = np.clip((rest[:, 1] - ball) / (back - ball), 0.0, 1.0)
    person = _lifted(person, 0.008 * shoe)
    points = person.target.vertices.copy()
    deep = np.clip((0.035 - rest[:, 2]) / 0.02, 0.0, 1.0) * foot
    points[:, 2] -= deep * (thick_m + heel_m * behind)
    return Variant(replace(person.target, vertices=points), points)


def _coat(person: Variant) -> Variant:
    rest, names = load_avatar().vertices.astype(np.float64), _part_names()
    worn = np.isin(names, ("torso", "upper_arm", "forearm")) & (rest[:, 2] < 1.45)
    worn |= (names == "upper_leg") & (rest[:, 2] > 0.6)
    return _lifted(person, 0.03 * worn + 0.02 * (worn & (names == "torso")))


def _trousers(person: Variant) -> Variant:
    rest, names = load_avatar().vertices.astype(np.float64), _part_names()
    legs = np.isin(names, ("upper_leg", "lower_leg")) & (rest[:, 2] > 0.1)
    return _lifted(person, legs * (0.008 + 0.03 * np.clip((0.9 - rest[:, 2]) / 0.8, 0.0, 1.0)))


def _gloves(person: Variant) -> Variant:
    worn = np.isin(_part_names(), ("fingers", "hand_palm", "hand_dorsum"))
    return _lifted(person, 0.004 * worn)


def _cut(person: Variant, below_m: float) -> Variant:
    """Return half a body: no skin below a height of the shipped avatar, except the arms."""
    rest, names = load_avatar().vertices.astype(np.float64), _part_names()
    arms = np.isin(names, ("upper_arm", "forearm", "hand_palm", "hand_dorsum", "fingers"))
    is_remaining = (rest[:, 2] > below_m) | arms
    triangles = person.target.triangles[is_remaining[person.target.triangles].all(axis=1)]
    used, corners = np.unique(triangles, return_inverse=True)
    target = replace(
        person.target,
        vertices=person.target.vertices[used],
        triangles=corners.reshape(-1, 3),
        weights=variants.rows_of(person.target.weights, used),
    )
    places = person.places.copy()
    places[~is_remaining] = np.nan
    return Variant(target, places)


CLOTHES: Mapping[str, Callable[[Variant], Variant]] = {
    "soles": lambda person: _soles(person, 0.04, 0.0),
    "platforms": lambda person: _soles(person, 0.07, 0.03),
    "heels": lambda person: _soles(person, 0.01, 0.08),
    "coat": _coat,
    "trousers": _trousers,
    "gloves": _gloves,
    "cut at the waist": lambda person: _cut(person, 1.0),
    "cut at the chest": lambda person: _cut(person, 1.18),
    "no legs": lambda person: _cut(person, 0.86),
}


def _blurred(person: Variant) -> Variant:
    """Smooth skin weights: the mean of the neighbours, several times."""
    from scipy.sparse import coo_array, csr_array, diags_array

    target, count = person.target, len(person.target.vertices)
    ends = np.concatenate([target.triangles[:, [0, 1]], target.triangles[:, [1, 2]]])
    pairs = np.concatenate([ends, ends[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)])
    near = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
    near = diags_array(1.0 / np.asarray(near.sum(axis=1)).ravel()) @ near
    weights = csr_array(
        (target.weights.values.astype(float), target.weights.bones, target.weights.offsets),
        shape=(count, len(target.bone_names)),
    )
    for _ in range(4):
        weights = near @ weights
    from foreign_avatars import sparse

    return replace(person, target=replace(target, weights=sparse(weights.toarray())))


def _with_displaced_joints(person: Variant, figure: Figure) -> Variant:
    heads = {bone.name: np.asarray(bone.head) for bone in person.target.bones}
    moved = {}
    for first, joint, last, off in (
        ("upperleg01", "lowerleg01", "foot", figure.knees_m),
        ("upperarm01", "lowerarm01", "wrist", figure.elbows_m),
    ):
        for side in "LR":
            way = heads[f"{last}.{side}"] - heads[f"{first}.{side}"]
            moved[f"{joint}.{side}"] = off * way / np.linalg.norm(way)
            moved[f"upperleg01.{side}"] = np.array([0.0, 0.0, figure.hips_m])
    bones = tuple(
        RigBone(b.name, b.parent, np.asarray(b.head) + moved.get(b.name, 0.0), np.asarray(b.tail))
        for b in person.target.bones
    )
    return replace(person, target=replace(person.target, bones=bones))


def _rebound(person: Variant) -> Variant:
    """Bind the skin again, with the weights changing at the rig's joints."""
    from foreign_avatars import sparse

    target = person.target
    heads = {bone.name: np.asarray(bone.head) for bone in target.bones}
    owners = np.repeat(np.arange(len(target.vertices)), np.diff(target.weights.offsets))
    dense = np.zeros((len(target.vertices), len(target.bone_names)))
    np.add.at(dense, (owners, target.weights.bones), target.weights.values)
    for upper, lower, last in (
        ("upperleg", "lowerleg", "foot"),
        ("upperarm", "lowerarm", "wrist"),
    ):
        for side in "LR":
            names = [f"{limb}{half}.{side}" for limb in (upper, lower) for half in ("01", "02")]
            columns = [target.bone_names.index(name) for name in names]
            whole = dense[:, columns].sum(axis=1)
            way = heads[f"{last}.{side}"] - heads[names[0]]
            along = (target.vertices - heads[names[2]]) @ way / np.linalg.norm(way)
            below = np.clip(0.5 + along / 0.08, 0.0, 1.0)
            dense[:, columns] = 0.0
            dense[:, columns[0]], dense[:, columns[2]] = whole * (1.0 - below), whole * below
    return replace(person, target=replace(target, weights=sparse(dense)))


def _with_flat_twists(person: Variant) -> Variant:
    """Parent limbs to each other as in an engine, with separate twist bones."""
    parents = {"lowerarm": "upperarm", "hand": "lowerarm", "calf": "thigh", "foot": "calf"}
    bones = tuple(
        replace(b, parent=f"{parents[b.name[:-2]]}{b.name[-2:]}")
        if b.name[:-2] in parents and b.name[-2:] in ("_l", "_r")
        else b
        for b in person.target.bones
    )
    return replace(person, target=replace(person.target, bones=bones))
