# SPDX-License-Identifier: GPL-3.0-or-later
"""People of MakeHuman's shapes in clothes, in other poses and rigs, with known positions.

A garment is the skin below, lifted off: each vertex of the shipped avatar keeps a counterpart on
the visible surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import retarget_variants as variants
from retarget_variants import RigBone, Variant

from hfx_blender.engine.body.model import SkinWeights, load_avatar
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.retargeting.surface import vertex_normals
from hfx_blender.engine.retargeting.target import TargetAvatar

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_WAIST_M, _HEM_M, _ANKLE_M, _SHAFT_M = 1.02, 0.60, 0.10, 0.30
"""Heights on the shipped avatar, 1.8 m tall."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A mesh of a dressed avatar."""

    name: str
    target: TargetAvatar
    is_seen: Mask  # (F,) visible skin, or close to the skin
    is_skin: bool = True  # felt; hair over a head is not
    is_optional: bool = False  # optional: a skirt, or hidden layers


@dataclass(frozen=True, eq=False)
class Dressed:
    """An avatar of several meshes, and the visible counterpart of each canonical vertex."""

    pieces: tuple[Piece, ...]
    places: F64  # (A, 3)
    known: Mask  # (A,)
    height: float  # in the pose


class _Tailor:
    """Bare person with methods to add clothes."""

    def __init__(self, variant: Variant) -> None:
        from scipy.spatial import cKDTree

        avatar = load_avatar()
        self.target, self.places = variant.target, variant.places.copy()
        off, self.of = cKDTree(variant.places).query(variant.target.vertices)
        self.bare = off < 1e-6  # not the eyeballs and the mouth
        self.rest = avatar.vertices.astype(np.float64)[self.of]
        self.part = np.array(PARTS)[avatar.part[self.of]]
        self.known = np.ones(len(self.places), bool)
        self.normals = vertex_normals(variant.target.vertices, variant.target.triangles)
        self.kept = np.ones(len(variant.target.triangles), bool)
        self.hidden = ~self.inside(self.bare)
        self.lift = np.zeros(len(self.rest))  # of the outermost layer
        self.pieces: list[Piece] = []
        self.unit = np.ptp(variant.target.vertices[:, 2]) / np.ptp(self.rest[:, 2])

    def is_of(self, *parts: str) -> Mask:
        return np.isin(self.part, parts) & self.bare

    def inside(self, vertices: Mask) -> Mask:
        """Return a mask of triangles with all corners among the given vertices."""
        is_inside: Mask = vertices[self.target.triangles].all(axis=1)
        return is_inside

    def cover(
        self,
        name: str,
        vertices: Mask,
        lift_m: F64 | float,
        *,
        is_cut: bool = False,
        is_skin: bool = True,
        shaped: Callable[[F64], F64] = lambda points: points,
    ) -> None:
        """Lay a mesh over the skin; ``is_cut`` deletes the skin below, as games do."""
        triangles = self.inside(vertices)
        lift = np.broadcast_to(lift_m, len(self.rest)) * self.unit
        points = shaped(self.target.vertices + lift[:, None] * self.normals)
        piece = self._piece(name, points, triangles, is_skin)
        is_outer = lift > self.lift
        self.pieces.append(replace(piece, is_seen=self.inside(is_outer)[triangles]))
        if not is_skin:
            return
        worn = np.zeros(len(self.rest), bool)
        worn[self.target.triangles[triangles].ravel()] = True
        worn &= is_outer
        self.lift[worn] = lift[worn]
        self.places[self.of[worn]] = points[worn]
        if is_cut:
            self.kept &= ~triangles
        self.hidden |= triangles

    def _piece(self, name: str, points: F64, triangles: Mask, is_skin: bool = True) -> Piece:
        used, corners = np.unique(self.target.triangles[triangles], return_inverse=True)
        order = np.random.default_rng(1).permutation(len(used))  # no mesh is recognised
        target = replace(
            self.target,
            vertices=points[used][order],
            triangles=np.argsort(order)[corners.reshape(-1, 3)],
            weights=variants.rows_of(self.target.weights, used[order]),
        )
        return Piece(name, target, ~self.hidden[triangles], is_skin)

    def dressed(self, height: float) -> Dressed:
        body = self._piece("body", self.target.vertices, self.kept)
        return Dressed((body, *self.pieces), self.places, self.known, height)


def _trousers(tailor: _Tailor, lift_m: float = 0.008, flare_m: float = 0.03, *, cut: bool) -> None:
    height = tailor.rest[:, 2]
    legs = tailor.is_of("upper_leg", "lower_leg", "torso") & (height < _WAIST_M)
    down = np.clip((0.9 - height) / (0.9 - _ANKLE_M), 0.0, 1.0)
    tailor.cover("trousers", legs & (height > _ANKLE_M), lift_m + flare_m * down, is_cut=cut)


def _boots(tailor: _Tailor) -> None:
    feet = tailor.is_of("foot_dorsum", "foot_sole", "lower_leg") & (tailor.rest[:, 2] < _SHAFT_M)
    ends = tailor.target.triangles
    toes = canonical_heads()["toe2-1.L"][1]

    def smoothed(points: F64) -> F64:
        moved = points.copy()
        pairs = np.concatenate((ends, np.roll(ends, 1, axis=1))).reshape(-1, 3)[:, :2]
        counts = np.maximum(np.bincount(pairs[:, 0], minlength=len(points)), 1)[:, None]
        for _ in range(12):  # a single tip instead of five toes
            sums = np.zeros_like(moved)
            np.add.at(sums, pairs[:, 0], moved[pairs[:, 1]])
            moved = np.where(front[:, None], sums / counts, moved)
        return moved

    front = feet & (tailor.rest[:, 1] < toes)
    tailor.cover("boots", feet, 0.008, is_cut=True, shaped=smoothed)
    tailor.known[tailor.of[front]] = False


def _hair(tailor: _Tailor) -> None:
    scalp = tailor.is_of("head") & ((tailor.rest[:, 1] > 0.0) | (tailor.rest[:, 2] > 1.74))
    tailor.cover("hair", scalp, 0.03, is_skin=False)


def _shirt(tailor: _Tailor, lift_m: float = 0.006, *parts: str, name: str = "shirt") -> None:
    height = tailor.rest[:, 2]
    worn = tailor.is_of("torso", "upper_arm", *parts) & (height > 0.95) & (height < 1.45)
    tailor.cover(name, worn, lift_m)


def _jacket(tailor: _Tailor) -> None:
    _shirt(tailor)
    under = replace(tailor.pieces.pop(), is_skin=False, is_optional=True)
    _shirt(tailor, 0.02, "forearm", name="jacket")
    tailor.pieces.append(under)


def _skirt(tailor: _Tailor) -> None:
    """Add a cone from the waist to above the knees; skin below has no visible counterpart."""
    height = tailor.rest[:, 2]
    below = tailor.is_of("torso", "upper_leg") & (height < _WAIST_M) & (height > _HEM_M)
    target = tailor.target
    points = target.vertices[below]
    floor, top = points[:, 2].min(), points[:, 2].max()
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ways = np.column_stack((np.cos(angles), np.sin(angles)))
    middle = points[:, :2].mean(axis=0)
    widest = ((points[:, :2] - middle) @ ways.T).max(axis=0)
    rows = []
    for share in np.linspace(0.0, 1.0, 12):
        level = top + share * (floor - top)
        near = points[np.abs(points[:, 2] - level) < 0.05 * tailor.unit]
        girth = ((near[:, :2] - middle) @ ways.T).max(axis=0) if len(near) else widest
        girth = np.maximum(girth, widest if share > 0.3 else 0.0) + 0.01 + 0.06 * share
        rows.append(np.column_stack((middle + girth[:, None] * ways, np.full(48, level))))
    cone = np.concatenate(rows)
    quads = [
        (row * 48 + k, (row + 1) * 48 + k, (row + 1) * 48 + (k + 1) % 48, row * 48 + (k + 1) % 48)
        for row in range(11)
        for k in range(48)
    ]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    from scipy.spatial import cKDTree

    nearest = cKDTree(target.vertices).query(cone)[1]
    worn = replace(
        target,
        vertices=cone,
        triangles=triangles,
        weights=variants.rows_of(target.weights, nearest),
    )
    tailor.pieces.append(Piece("skirt", worn, np.zeros(len(triangles), bool), False, True))
    tailor.known[tailor.of[below]] = False
    tailor.hidden |= tailor.inside(below)


def _no_hands(tailor: _Tailor) -> None:
    hands = tailor.is_of("fingers", "hand_palm", "hand_dorsum")
    tailor.kept &= ~tailor.inside(hands)
    tailor.known[tailor.of[hands]] = False


CLOTHES: Mapping[str, Callable[[_Tailor], None]] = {
    "nothing": lambda tailor: None,
    "tight trousers": lambda tailor: _trousers(tailor, 0.006, 0.0, cut=False),
    "loose trousers": lambda tailor: _trousers(tailor, cut=True),
    "boots": _boots,
    "hair": _hair,
    "shirt and jacket": _jacket,
    "no hands": _no_hands,
    "skirt, hair": lambda tailor: [_skirt(tailor), _hair(tailor)],  # type: ignore[return-value, func-returns-value]
    "chibi head": lambda tailor: None,
    "shirt, trousers, boots, hair": lambda tailor: [  # type: ignore[return-value, func-returns-value]
        _shirt(tailor),
        _trousers(tailor, cut=True),
        _boots(tailor),
        _hair(tailor),
    ],
}
"""What an avatar wears; each is laid over what is worn below it."""

POSES: Mapping[str, Mapping[str, F64]] = {
    "A": {},
    "T": {"upperarm01.L": variants.turn(1, -45), "upperarm01.R": variants.turn(1, 45)},
    "leaning": {"root": variants.turn(0, -20)},
    "sitting": {
        **{f"upperleg01.{side}": variants.turn(0, -80) for side in "LR"},
        **{f"lowerleg01.{side}": variants.turn(0, 80) for side in "LR"},
    },
}


def dressed(shape: str, clothes: str, pose: str, names: Mapping[str, str]) -> Dressed:
    """Return a person of a shape, in clothes and a rest pose, with bones of a convention.

    Parameters
    ----------
    names : mapping of canonical bone to name
        Weights of unnamed bones go to the parent.
    """
    person = variants.rigged(shape, "default")
    height = float(np.ptp(person.places[:, 2]))
    if clothes == "chibi head":
        person = _with_large_head(person, 1.6)
    person = variants.posed(person, POSES[pose], {})
    tailor = _Tailor(renamed(person, names))
    CLOTHES[clothes](tailor)
    return tailor.dressed(height)


def _with_large_head(person: Variant, factor: float) -> Variant:
    """Enlarge everything weighted to the head, about the head's joint."""
    from scipy.spatial import cKDTree

    target = person.target
    parents = {bone.name: bone.parent for bone in target.bones}

    def is_of_head(name: str | None) -> bool:
        return name is not None and (name == "head" or is_of_head(parents[name]))

    centre = next(np.asarray(bone.head) for bone in target.bones if bone.name == "head")
    column = np.array([is_of_head(name) for name in target.bone_names], np.float64)
    owners = np.repeat(np.arange(len(target.vertices)), np.diff(target.weights.offsets))
    share = np.bincount(
        owners, target.weights.values * column[target.weights.bones], len(target.vertices)
    )

    def grown(points: F64, shares: F64) -> F64:
        return points + (factor - 1.0) * shares[:, None] * (points - centre)

    def bone_grown(bone: RigBone) -> RigBone:
        ends = np.array([bone.head, bone.tail])
        head, tail = grown(ends, np.full(2, float(is_of_head(bone.name))))
        return replace(bone, head=head, tail=tail)

    nearest = cKDTree(target.vertices).query(person.places)[1]
    bones = tuple(bone_grown(bone) for bone in target.bones)  # type: ignore[arg-type]
    return Variant(
        replace(target, vertices=grown(target.vertices, share), bones=bones),
        grown(person.places, share[nearest]),
    )


def renamed(person: Variant, names: Mapping[str, str]) -> Variant:
    target = person.target
    parents = {bone.name: bone.parent for bone in target.bones}

    def kept(bones: Iterable[str | None]) -> list[str]:
        nearest_named = []
        for bone in bones:
            at = bone
            while at is not None and at not in names:
                at = parents[at]
            nearest_named.append(names[at] if at is not None else names["root"])
        return nearest_named

    bones = tuple(
        RigBone(
            names[bone.name],
            kept([bone.parent])[0] if bone.name != "root" else None,
            np.asarray(bone.head),
            np.asarray(bone.tail),
        )
        for bone in target.bones
        if bone.name in names
    )
    columns = tuple(bone.name for bone in bones)
    index = np.array([columns.index(name) for name in kept(target.bone_names)])
    count = len(target.vertices)
    owners = np.repeat(np.arange(count), np.diff(target.weights.offsets))
    dense = np.zeros((count, len(columns)))
    np.add.at(dense, (owners, index[target.weights.bones]), target.weights.values)
    rows, used = np.nonzero(dense)
    weights = SkinWeights(
        np.searchsorted(rows, np.arange(count + 1)).astype(np.int32),
        used.astype(np.int32),
        dense[rows, used].astype(np.float32),
    )
    return Variant(replace(target, weights=weights, bone_names=columns, bones=bones), person.places)
