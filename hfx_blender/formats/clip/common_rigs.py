# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone names of common rigs for the canonical skeleton.

VRM 1.0 (Unity and Godot capitalize its names), Mixamo and Unreal's mannequin.
"""

import csv
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class RigNames:
    """Names of a joint; empty where a rig has no such joint."""

    human: str = ""
    mixamo: str = ""
    unreal: str = ""


with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _file:
    _JOINTS: Final = tuple(csv.DictReader(_file))
"""Rows with the pattern of the canonical names of joints, ``is_sided`` of a limb (its names are
without side), and the names in other rigs."""

_DIGITS: Final = (("thumb", "Thumb"), ("index",) * 2, ("middle",) * 2, ("ring",) * 2,
                  ("little", "Pinky"))  # fmt: skip
_PHALANGES: Final = ("Proximal", "Intermediate", "Distal")
_OF_THUMB: Final = ("Metacarpal", "Proximal", "Distal")


@cache
def rig_names(bone: str) -> RigNames:
    """Names of the joint of a canonical bone such as ``wrist.L`` in other rigs, side included.
    Fingers have ``finger1-1`` (thumb) to ``finger5-3``. All names are empty for an unknown bone."""
    stem, _, side = bone.partition(".")
    long, short = {"L": ("left", "l"), "R": ("right", "r")}.get(side, ("", ""))
    finger = re.fullmatch(r"finger([1-5])-([1-3])", stem)
    if finger and long:
        digit, joint = int(finger[1]) - 1, int(finger[2]) - 1
        human, mixamo = _DIGITS[digit]
        phalanx = (_PHALANGES if digit else _OF_THUMB)[joint]
        unreal = "pinky" if digit == 4 else human
        return RigNames(
            f"{long}{human.capitalize()}{phalanx}",
            f"{long.capitalize()}Hand{mixamo.capitalize()}{joint + 1}",
            f"{unreal}_0{joint + 1}_{short}",
        )
    for row in _JOINTS:
        if re.fullmatch(row["joint"], stem):
            names = RigNames(row["human"], row["mixamo"], row["unreal"])
            if row["is_sided"] == "0":
                return names
            if long:
                mixamo = f"{long.capitalize()}{names.mixamo}"
                return RigNames(f"{long}{names.human}", mixamo, f"{names.unreal}_{short}")
    return RigNames()
