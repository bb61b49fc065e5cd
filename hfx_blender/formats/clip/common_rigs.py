# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone names of common rigs for the canonical skeleton.

VRM 1.0 (Unity and Godot capitalize its names), Mixamo and Unreal's mannequin.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Final


@dataclass(frozen=True)
class RigNames:
    """Names of a joint; empty where a rig has no such joint."""

    human: str = ""
    mixamo: str = ""
    unreal: str = ""


_MIDDLE: Final = (
    (r"root|pelvis.*", RigNames("hips", "Hips", "pelvis")),
    (r"spine0[54]", RigNames("spine", "Spine", "spine_01")),
    (r"spine0[32]", RigNames("chest", "Spine1", "spine_02")),
    (r"spine01|breast", RigNames("upperChest", "Spine2", "spine_03")),
    (r"neck0\d", RigNames("neck", "Neck", "neck_01")),
    (r"jaw|tongue.*|oris0[1267]|special04", RigNames("jaw", "Head", "head")),
    (
        r"head|eye|special.*|oris.*|levator.*|orbicularis.*|temporalis.*|oculi.*|risorius.*",
        RigNames("head", "Head", "head"),
    ),
)
"""Patterns of canonical names of the joints on the midline, and the bones that follow them."""

_SIDED: Final = (
    (r"clavicle|shoulder01", RigNames("Shoulder", "Shoulder", "clavicle")),
    (r"upperarm0\d", RigNames("UpperArm", "Arm", "upperarm")),
    (r"lowerarm0\d", RigNames("LowerArm", "ForeArm", "lowerarm")),
    (r"wrist|metacarpal\d", RigNames("Hand", "Hand", "hand")),
    (r"upperleg0\d", RigNames("UpperLeg", "UpLeg", "thigh")),
    (r"lowerleg0\d", RigNames("LowerLeg", "Leg", "calf")),
    (r"foot", RigNames("Foot", "Foot", "foot")),
    (r"toe.*", RigNames("Toes", "ToeBase", "ball")),
)
"""Patterns of canonical names of limb joints, without side."""

_DIGITS: Final = (("thumb", "Thumb"), ("index",) * 2, ("middle",) * 2, ("ring",) * 2,
                  ("little", "Pinky"))  # fmt: skip
_PHALANGES: Final = ("Proximal", "Intermediate", "Distal")
_OF_THUMB: Final = ("Metacarpal", "Proximal", "Distal")


@cache
def rig_names(bone: str) -> RigNames:
    """Names of the joint of a canonical bone such as ``wrist.L`` in other rigs, side included.
    Fingers have ``finger1-1`` (thumb) to ``finger5-3``. All names are empty for an unknown bone."""
    stem, _, side = bone.partition(".")
    for pattern, names in _MIDDLE:
        if re.fullmatch(pattern, stem):
            return names
    # Limbs and fingers have a side.
    if side not in ("L", "R"):
        return RigNames()
    long, short = ("left", "l") if side == "L" else ("right", "r")
    finger = re.fullmatch(r"finger([1-5])-([1-3])", stem)
    if finger:
        digit, joint = int(finger[1]) - 1, int(finger[2]) - 1
        human, mixamo = _DIGITS[digit]
        phalanx = (_PHALANGES if digit else _OF_THUMB)[joint]
        unreal = "pinky" if digit == 4 else human
        return RigNames(
            f"{long}{human.capitalize()}{phalanx}",
            f"{long.capitalize()}Hand{mixamo.capitalize()}{joint + 1}",
            f"{unreal}_0{joint + 1}_{short}",
        )
    for pattern, names in _SIDED:
        if re.fullmatch(pattern, stem):
            mixamo = f"{long.capitalize()}{names.mixamo}"
            return RigNames(f"{long}{names.human}", mixamo, f"{names.unreal}_{short}")
    return RigNames()
