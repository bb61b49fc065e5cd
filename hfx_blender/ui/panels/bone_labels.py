# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of the canonical skeleton's bones, and their part of the bone table."""

from __future__ import annotations

import re
from functools import cache

_SIDES = {"L": " L", "R": " R"}
_WORDS = {
    "root": "Hips",
    "pelvis": "Pelvis",
    "upperleg01": "Thigh",
    "upperleg02": "Thigh Twist",
    "lowerleg01": "Shin",
    "lowerleg02": "Shin Twist",
    "foot": "Foot",
    "breast": "Breast",
    "clavicle": "Collar Bone",
    "shoulder01": "Shoulder Blade",
    "upperarm01": "Upper Arm",
    "upperarm02": "Upper Arm Twist",
    "lowerarm01": "Forearm",
    "lowerarm02": "Forearm Twist",
    "wrist": "Hand",
    "head": "Head",
    "jaw": "Jaw",
    "eye": "Eye",
}
_SPINE = {f"spine{number:02d}": f"Spine {6 - number}" for number in range(1, 6)}  # from below
_NECK = {f"neck{number:02d}": f"Neck {number}" for number in range(1, 4)}
_BODY = {*_WORDS, *_SPINE, *_NECK} - {"jaw", "eye"}
_DIGIT = re.compile(r"(finger|toe|metacarpal)(\d)(?:-(\d))?")


@cache
def label_of(bone: str) -> str:
    """A canonical bone in words: "upperarm01.L" is "Upper Arm L"."""
    from ...engine.body.rigs.vocabulary import FINGERS

    stem, side = _split(bone)
    words = {**_WORDS, **_SPINE, **_NECK}.get(stem)
    digit = _DIGIT.fullmatch(stem)
    if digit is not None:
        kind, number, joint = digit[1], int(digit[2]), digit[3]
        if kind == "toe":
            words = f"Toe {number} Joint {joint}"
        elif kind == "finger":
            words = f"{FINGERS[number - 1].title()} {joint}"
        else:
            words = f"{FINGERS[number].title()} Palm"
    return (words or stem.title()) + _SIDES.get(side, "")


@cache
def region_of(bone: str) -> str:
    """Part of the table: "BODY", "HANDS", "FEET" or "FACE"."""
    stem, _ = _split(bone)
    if stem in _BODY:
        return "BODY"
    if stem.startswith(("finger", "metacarpal")):
        return "HANDS"
    return "FEET" if stem.startswith("toe") else "FACE"


def _split(bone: str) -> tuple[str, str]:
    stem, dot, side = bone.rpartition(".")
    return (stem, side) if dot and side in _SIDES else (bone, "")
