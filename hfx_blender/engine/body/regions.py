# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions of the body as people name them and devices are worn: finer than the body parts.

A region follows from a vertex's part, from the bone that moves it most, and from where its skin
faces: front or back of trunk and legs, inner (the palm's) or outer side of a forearm.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from .areas import transferred
from .model import PerceptualModel, load_model
from .parts import CENTRE, PARTS, SIDES
from .region_names import REGIONS, Region

_DENSEST: Final = "hfx-vibration-1"
_FRONT: Final = np.array([0.0, -1.0, 0.0])  # in rest space


class _Skin:
    """Properties that tell regions apart, for all vertices of a model."""

    def __init__(self, model: PerceptualModel) -> None:
        self._part = model.part
        self._bone = np.array(model.bone_names)[strongest_bones(model)]
        self.is_front: Bool = model.normals @ _FRONT > 0.0
        depth = model.vertices @ _FRONT
        head = depth[self.part("head")]
        self.is_of_face: Bool = depth > (head.min() + head.max()) / 2.0  # nostrils, too
        self.is_inner = self._faces_like_palms(model)

    def part(self, *names: str) -> Bool:
        """Vertices on body parts."""
        return np.isin(self._part, [PARTS.index(name) for name in names])

    def bone(self, *starts: str) -> Bool:
        """Vertices that bones move, by the beginnings of their names."""
        found = np.zeros(len(self._bone), np.bool_)
        for start in starts:
            found |= np.char.startswith(self._bone, start)
        return found

    def _faces_like_palms(self, model: PerceptualModel) -> Bool:
        is_inner = np.zeros(len(model), np.bool_)
        for side in range(len(SIDES)):
            on_side = model.side == side
            palm = model.normals[on_side & self.part("hand_palm")].sum(axis=0)
            is_inner |= on_side & (model.normals @ palm > 0.0)
        return is_inner


def _neck(skin: _Skin) -> Bool:
    return skin.bone("neck") | (skin.part("torso") & skin.bone("head"))


def _shoulders(skin: _Skin) -> Bool:
    return skin.part("torso") & skin.bone("clavicle", "shoulder", "upperarm")


def _trunk(skin: _Skin, *bones: str) -> Bool:
    return skin.part("torso") & skin.bone(*bones)


_UPPER: Final = ("spine01", "spine02", "breast")
_LOW: Final = ("spine05", "pelvis", "upperleg")


def _toes(skin: _Skin) -> Bool:
    return skin.part("foot_dorsum", "foot_sole") & skin.bone("toe")


def _finger(number: int) -> Callable[[_Skin], Bool]:
    """A finger, from 1 for the thumb; skin between fingers goes with the metacarpal bone."""
    bones = (f"finger{number}", f"metacarpal{number - 1}")
    return lambda skin: skin.part("fingers") & skin.bone(*bones)


_FLAGS: Final[dict[str, Callable[[_Skin], Bool]]] = {
    "face": lambda s: s.part("head") & ~_neck(s) & s.is_of_face,
    "back_of_head": lambda s: s.part("head") & ~_neck(s) & ~s.is_of_face,
    "neck": _neck,
    "shoulders": _shoulders,
    "chest": lambda s: _trunk(s, *_UPPER) & s.is_front,
    "belly": lambda s: _trunk(s, "spine03", "spine04", *_LOW) & s.is_front,
    "upper_back": lambda s: _trunk(s, *_UPPER) & ~s.is_front,
    "lower_back": lambda s: _trunk(s, "spine03", "spine04") & ~s.is_front,
    "buttocks": lambda s: _trunk(s, *_LOW) & ~s.is_front,
    "upper_arm_front": lambda s: s.part("upper_arm") & s.is_front,
    "upper_arm_back": lambda s: s.part("upper_arm") & ~s.is_front,
    "forearm_inner": lambda s: s.part("forearm") & s.is_inner,
    "forearm_outer": lambda s: s.part("forearm") & ~s.is_inner,
    "thumb": _finger(1),
    "index_finger": _finger(2),
    "middle_finger": _finger(3),
    "ring_finger": _finger(4),
    "little_finger": _finger(5),
    "thigh_front": lambda s: s.part("upper_leg") & s.is_front,
    "thigh_back": lambda s: s.part("upper_leg") & ~s.is_front,
    "shin": lambda s: s.part("lower_leg") & s.is_front,
    "calf": lambda s: s.part("lower_leg") & ~s.is_front,
    "top_of_foot": lambda s: s.part("foot_dorsum") & ~_toes(s),
    "sole": lambda s: s.part("foot_sole") & ~_toes(s),
    "toes": _toes,
}


def strongest_bones(model: PerceptualModel) -> I64:
    """Bone that moves each vertex most, (V,)."""
    weights = model.weights
    row = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    order = np.lexsort((weights.values, row))
    last = np.flatnonzero(np.diff(row[order], append=-1))
    found: I64 = weights.bones[order][last].astype(np.int64)
    return found


@lru_cache(maxsize=8)
def finest(model_id: str) -> dict[str, Bool]:
    """Masks (V,) of the finest regions by id; each vertex is in one."""
    skin = _Skin(load_model(model_id))
    masks = {name: flags(skin) for name, flags in _FLAGS.items()}
    return masks | {name: skin.part(name) for name in ("hand_palm", "hand_dorsum")}


def region_weights(model: PerceptualModel, region: str, side: str = "both") -> F64:
    """Weights (V,) of a region of ``REGIONS``: 1 on its vertices, 0 elsewhere.

    Where a coarse model has no vertex in it, its nearest ones take its share.

    Parameters
    ----------
    side : "left", "right" or "both"
    """
    weights = _mask(model, region, side).astype(np.float64)
    if not weights.any():
        densest = load_model(_DENSEST)
        weights = transferred(densest, _mask(densest, region, side).astype(np.float64), model)
    return weights


def _mask(model: PerceptualModel, region: str, side: str) -> Bool:
    if region in PARTS:
        found: Bool = model.part == PARTS.index(region)
    else:
        found = finest(model.id)[region]
    if side != "both":
        found = found & np.isin(model.side, (CENTRE, SIDES.index(side)))
    return found


def region_at(model: PerceptualModel, vertex: int) -> Region:
    """The finest region that a vertex belongs to."""
    name = next(name for name, mask in finest(model.id).items() if mask[vertex])
    return next(region for region in REGIONS if region.id == name)
