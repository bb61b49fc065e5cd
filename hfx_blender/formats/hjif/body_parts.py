# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF body part masks of vertices and of actuator places."""

from typing import Final

import numpy as np

from ...engine.arrays import U32
from ...engine.body.model import PerceptualModel
from ...engine.body.parts import LEFT, PARTS, RIGHT
from ...engine.rendering.device_config import BodyPlace, Place, RoomPlace

BITS: Final = (
    "head front,head back,head right,head left,right upper chest,left upper chest,abdomen,waist,"
    "upper back,lower back,right upper arm,left upper arm,right forearm,left forearm,right wrist,"
    "left wrist,right palm,left palm,right hand dorsum,left hand dorsum,right fingers,"
    "left fingers,right thigh,left thigh,right calf,left calf,right sole,left sole,"
    "right foot dorsum,left foot dorsum,right toes,left toes"
).split(",")
"""Body part of each mask bit; right and left of the wearer."""

# Heights on the shipped body (1.8 m, rest pose) of the borders between the parts of the torso.
_CHEST_M: Final = 1.25
_ABDOMEN_M: Final = 1.08
_LOWER_BACK_M: Final = 1.20

_RIGHT_BIT: Final = {  # the left one is the next
    "upper_arm": 10,
    "forearm": 12,
    "hand_palm": 16,
    "hand_dorsum": 18,
    "fingers": 20,
    "upper_leg": 22,
    "lower_leg": 24,
    "foot_sole": 26,
    "foot_dorsum": 28,
}


def vertex_masks(model: PerceptualModel) -> U32:
    """Body part mask of each vertex, (V,) uint32, by part, side, normal and height.

    One bit each; two bits on the midline of a part with sides. The model is in rest space: facing
    -Y, left +X.
    """
    masks = np.zeros(len(model), np.uint32)
    x, _, z = model.vertices.T
    # Normals separate front from back: places alone are ambiguous on limbs and folds.
    normal_x, normal_y, _ = model.normals.T
    # A vertex without a side has the side of its x; both sides at x = 0.
    is_right = (model.side == RIGHT) | ((model.side != LEFT) & (x <= 0.0))
    is_left = (model.side == LEFT) | ((model.side != RIGHT) & (x >= 0.0))
    for index, part in enumerate(PARTS):
        is_part = model.part == index
        if part == "head":
            # The head has four bits, by the direction that its skin faces.
            is_sideways = np.abs(normal_x) > np.abs(normal_y)
            to_side, to_front = np.where(is_right, 2, 3), np.where(normal_y < 0.0, 0, 1)
            bit = np.where(is_sideways, to_side, to_front)
            masks[is_part] = (1 << bit[is_part]).astype(np.uint32)
        elif part == "torso":
            is_front = normal_y < 0.0
            chest = np.where(is_right, 1 << 4, 0) | np.where(is_left, 1 << 5, 0)
            front = np.where(z > _CHEST_M, chest, np.where(z > _ABDOMEN_M, 1 << 6, 1 << 7))
            back = np.where(z > _LOWER_BACK_M, 1 << 8, 1 << 9)
            masks[is_part] = np.where(is_front, front, back)[is_part].astype(np.uint32)
        else:
            bit_value = 1 << _RIGHT_BIT[part]
            both = np.where(is_right, bit_value, 0) | np.where(is_left, bit_value << 1, 0)
            masks[is_part] = both[is_part].astype(np.uint32)
    return masks


def place_mask(place: Place, *, is_mirrored: bool = False) -> int:
    """Body part mask of an actuator's place; 0 for a place of vertices. A centre selects one bit
    per part, mirrored in x for ``is_mirrored``. Without a centre all bits of a part are set, or
    those of the place's side."""
    if isinstance(place, RoomPlace):
        parts: tuple[str, ...] = place.parts
        centre, side = None, None
    elif isinstance(place, BodyPlace):
        parts, centre, side = place.parts, place.centre_m, place.side
    else:
        return 0
    mask = 0
    x, y, z = centre or (0.0, 0.0, 0.0)
    x = -x if is_mirrored else x
    for part in parts:
        # Without a centre all bits of the part are set; otherwise the same borders as for
        # vertices.
        if part == "head":
            mask |= 0b1111 if centre is None else (0b0001 if y < 0.0 else 0b0010)
        elif part == "torso":
            if centre is None:
                # Bits 4 to 9: chest, abdomen, waist and back.
                mask |= 0b1111110000
            elif y < 0.0:
                chest = 1 << (5 if x > 0.0 else 4)
                mask |= chest if z > _CHEST_M else 1 << (6 if z > _ABDOMEN_M else 7)
            else:
                mask |= 1 << (8 if z > _LOWER_BACK_M else 9)
        else:
            bit = _RIGHT_BIT[part]
            is_left = x > 0.0 if centre is not None else side == "left"
            both = centre is None and side is None
            mask |= 0b11 << bit if both else 1 << (bit + (1 if is_left else 0))
    return mask


def described(mask: int) -> str:
    """Names of a mask's parts; "all of the body" or "nowhere" for all or no bits."""
    names = [name for bit, name in enumerate(BITS) if mask >> bit & 1]
    return "all of the body" if len(names) == len(BITS) else ", ".join(names) or "nowhere"
