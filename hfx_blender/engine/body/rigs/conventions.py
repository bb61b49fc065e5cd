# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming convention of a rig, recognised by bones unique to it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

# The first row with all of its words among the names (lower case, without namespace) wins.
_SIGNATURES: Final = (
    ("makehuman default", ("upperarm01.l", "metacarpal1.l", "spine05")),
    ("makehuman default", ("upperarm01_l", "metacarpal1_l", "spine05")),
    ("rigify", ("def-upper_arm.l",)),
    ("rigify", ("upper_arm.l", "forearm.l", "shin.l", "spine.001")),
    ("vrm", ("j_bip_c_hips",)),
    ("auto-rig pro", ("arm_stretch.l", "thigh_stretch.l")),
    ("mmd", ("上半身", "下半身")),
    ("mmd", ("upper body", "lower body")),
    ("xsens", ("pelvis", "l5", "t8", "leftupperleg")),
    ("smpl", ("pelvis", "l_hip", "l_collar", "spine3")),
    ("second life", ("mpelvis", "mtorso", "mhipleft")),
    ("cmu", ("lhipjoint", "leftupleg")),
    ("mixamo", ("hips", "leftupleg", "leftforearm", "lefttoebase")),
    ("mixamo", ("hips", "leftupleg", "leftforearm", "spine1")),
    ("vrm", ("hips", "leftupperarm", "leftlowerleg")),
    ("daz", ("lshldrbend",)),
    ("daz", ("lshldr", "lforearm")),
    ("daz", ("l_upperarm", "l_forearm", "l_shin")),
    ("game engine", ("upperarm_l", "calf_l", "spine_01", "root", "~game engine")),
    ("unreal", ("upperarm_l", "calf_l", "spine_01")),
)
_PREFIXES: Final = (
    ("mixamo", "mixamorig"),
    ("biped", "valvebiped.bip"),
    ("biped", "bip0"),
    ("character creator", "cc_base_"),
)


def convention_of(names: Iterable[str]) -> str:
    """The convention of a rig's bone names; "plain" if it is none of the known ones."""
    written = list(names)
    for convention, prefix in _PREFIXES:
        if any(name.lower().startswith(prefix) for name in written):
            return convention
    present = {name.rsplit(":", 1)[-1].lower() for name in written}
    if "Root" in written and not any("twist" in name for name in present):
        # MakeHuman's game engine rig is Unreal's first mannequin without its helpers.
        present.add("~game engine")
    for convention, words in _SIGNATURES:
        if present.issuperset(words):
            return convention
    return "plain"
