# SPDX-License-Identifier: GPL-3.0-or-later
"""Named body regions as sets of vertices; finer than the body parts.

A region follows from a vertex's body part, the bone of largest weight, and the direction of the
normal: front or back of trunk and legs, inner (palm) or outer side of a forearm.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I64, Bool
from .areas import transferred
from .model import PerceptualModel, load_model
from .parts import CENTRE, PARTS, REGIONS, SIDES, Region

_DENSEST: Final = "hfx-vibration-1"
_FRONT: Final = np.array([0.0, -1.0, 0.0])  # in rest space


class _Skin:
    """Attributes of all vertices of a model used to distinguish regions."""

    def __init__(self, model: PerceptualModel) -> None:
        self._part = model.part
        self._bone_names, self._bone = model.bone_names, strongest_bones(model)
        self.is_front: Bool = model.normals @ _FRONT > 0.0
        depth = model.vertices @ _FRONT
        head = depth[self.part("head")]
        self.is_of_face: Bool = depth > (head.min() + head.max()) / 2.0
        # Inner side of an arm: within 90 degrees of the palm's summed normal on the same side.
        self.is_inner: Bool = np.zeros(len(model), np.bool_)
        for side in range(len(SIDES)):
            on_side = model.side == side
            palm = model.normals[on_side & self.part("hand_palm")].sum(axis=0)
            self.is_inner |= on_side & (model.normals @ palm > 0.0)

    def part(self, *names: str) -> Bool:
        """Mask (V,) of vertices on any of the named body parts."""
        return np.isin(self._part, [PARTS.index(name) for name in names])

    def bone(self, *starts: str) -> Bool:
        """Mask (V,) of vertices whose strongest bone's name begins with any of ``starts``."""
        return np.array([name.startswith(starts) for name in self._bone_names])[self._bone]


def _neck(skin: _Skin) -> Bool:
    """Mask (V,) of the neck: moved by a neck bone, or part of the torso moved by a head bone."""
    return skin.bone("neck") | (skin.part("torso") & skin.bone("head"))


def _trunk(skin: _Skin, *bones: str) -> Bool:
    """Mask (V,) of torso vertices whose strongest bone's name begins with any of ``bones``."""
    return skin.part("torso") & skin.bone(*bones)


_UPPER: Final = ("spine01", "spine02", "breast")
_LOW: Final = ("spine05", "pelvis", "upperleg")


def _toes(skin: _Skin) -> Bool:
    return skin.part("foot_dorsum", "foot_sole") & skin.bone("toe")


def _finger(number: int) -> Callable[[_Skin], Bool]:
    """Function from skin attributes to the mask (V,) of finger ``number`` (1 to 5, the thumb
    first), with the skin of the metacarpal bone between the fingers."""
    bones = (f"finger{number}", f"metacarpal{number - 1}")
    return lambda skin: skin.part("fingers") & skin.bone(*bones)


_FLAGS: Final[dict[str, Callable[[_Skin], Bool]]] = {
    "face": lambda s: s.part("head") & ~_neck(s) & s.is_of_face,
    "back_of_head": lambda s: s.part("head") & ~_neck(s) & ~s.is_of_face,
    "neck": _neck,
    "shoulders": lambda s: _trunk(s, "clavicle", "shoulder", "upperarm"),
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
    """Index (V,) into the model's bone names of the bone with the largest weight. Every
    vertex must have a weight; one without shortens the result."""
    weights = model.weights
    row = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    # Sorted by row, then weight: the last entry of a row is the largest.
    order = np.lexsort((weights.values, row))
    last = np.flatnonzero(np.diff(row[order], append=-1))
    return np.asarray(weights.bones[order][last].astype(np.int64))


@lru_cache(maxsize=8)
def finest_masks(model_id: str) -> dict[str, Bool]:
    """Masks (V,) of disjoint regions by id; together they cover the model. Cached."""
    skin = _Skin(load_model(model_id))
    masks = {name: mask_of(skin) for name, mask_of in _FLAGS.items()}
    # Palms and backs of the hands have no finer regions.
    return masks | {name: skin.part(name) for name in ("hand_palm", "hand_dorsum")}


def region_weights(model: PerceptualModel, region: str, side: str = "both") -> F64:
    """Weights (V,) of a region of ``REGIONS``: 1 on its vertices, 0 elsewhere. ``side`` is "left",
    "right" or "both"; the midline belongs to both sides. Resampled from the vibration model where
    ``model`` is too coarse for any vertex in the region."""
    weights = _mask(model, region, side).astype(np.float64)
    if not weights.any():
        densest = load_model(_DENSEST)
        weights = transferred(densest, _mask(densest, region, side).astype(np.float64), model)
    return weights


def _mask(model: PerceptualModel, region: str, side: str) -> Bool:
    """Mask (V,) of a body part or finer region on a side: "left", "right" or "both"; the midline
    belongs to both sides."""
    if region in PARTS:
        mask: Bool = model.part == PARTS.index(region)
    else:
        mask = finest_masks(model.id)[region]
    if side != "both":
        mask = mask & np.isin(model.side, (CENTRE, SIDES.index(side)))
    return mask


def region_at(model: PerceptualModel, vertex: int) -> Region:
    """Finest region of vertex index ``vertex``."""
    name = next(name for name, mask in finest_masks(model.id).items() if mask[vertex])
    return next(region for region in REGIONS if region.id == name)
