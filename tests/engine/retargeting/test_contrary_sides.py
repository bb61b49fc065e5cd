# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones with names of both sides, no side or the wrong side are mapped by position."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from rig_conventions import LIMBS, MIXAMO, rig_of

from hfx_blender.engine.body.rigs.mapping import RigBone, map_bones

NAMES = "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot ToeBase".split()
FINGERS = "Thumb Index Middle Ring Little".split()
TRUNK = {
    "root": "Hips", "spine03": "Spine", "spine02": "Chest", "spine01": "UpperChest",
    "neck01": "Neck", "head": "Head",
}  # fmt: skip
HALVES = {
    "vroid with a suffix": ("J_Bip_L_{}.L", "J_Bip_L_{}.R"),
    "a letter before": ("L_L_{}", "R_L_{}"),
    "a suffix on both": ("L_{}.R", "R_{}.R"),
    "a copy": ("{}_L", "{}_L.001"),
    "a copy of the right": ("{}.R.001", "{}.R"),
    "word and letter": ("Left{}_L", "Left{}_R"),
    "letters of both cases": ("L_{}_l", "L_{}_r"),
    "biped with a suffix": ("Bip01 L {}.L", "Bip01 L {}.R"),
    "namespace": ("mixamorig:Left{}", "mixamorig:Left{}_right"),
    "words of both": ("Left_{}", "Left_{}_Right"),
    "no side on one half": ("{}", "{}_R"),
    "no name for a half": ("Left{}", "{}.001"),
}


def table_of(left: str, right: str) -> dict[str, str]:
    table = dict(TRUNK)
    for side, pattern in (("L", left), ("R", right)):
        table |= {f"{b}.{side}": pattern.format(n) for b, n in zip(LIMBS, NAMES, strict=True)}
        table |= {
            f"finger{number}-{joint}.{side}": pattern.format(f"{finger}{joint}")
            for number, finger in enumerate(FINGERS, start=1)
            for joint in (1, 2, 3)
        }
    return table


def turned(bones: list[RigBone]) -> list[RigBone]:
    """Return bones turned, scaled and shifted at random, in another order."""
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    matrix = 100.0 * turn * np.linalg.det(turn)
    turned_bones = [
        replace(b, head=tuple(matrix @ b.head + 3.0), tail=tuple(matrix @ b.tail + 3.0))
        for b in bones
    ]
    random.Random(3).shuffle(turned_bones)
    return turned_bones


@pytest.mark.parametrize("case", HALVES)
def test_halves_with_sides_that_say_little(case: str) -> None:
    table = table_of(*HALVES[case])
    mapping = map_bones(turned(rig_of(table)))
    assert mapping.bones == table
    assert mapping.convention != "geometry"


def test_limbs_whose_bones_hang_on_nothing() -> None:
    """Some exporters leave bones without parents."""
    table = table_of("J_Bip_L_{}.L", "J_Bip_L_{}.R")
    bones = [replace(bone, parent=None) for bone in turned(rig_of(table))]
    limbs = {bone: name for bone, name in table.items() if bone[:-2] in LIMBS}
    assert limbs.items() <= map_bones(bones).bones.items()


def swapped(table: dict[str, str], *stems: str) -> dict[str, str]:
    """Exchange left and right among the names of some canonical bones."""
    second = {"L": "R", "R": "L"}
    return {
        bone: table[bone[:-1] + second[bone[-1]]] if bone.startswith(stems) else name
        for bone, name in table.items()
    }


ARM = ("clavicle", "upperarm01", "lowerarm01", "wrist", "finger")
LEG = ("upperleg01", "lowerleg01", "foot", "toe")


@pytest.mark.parametrize(
    ("stems", "count"), [(ARM, 38), (LEG, 8), (("wrist", "finger"), 32), (("foot", "toe"), 4)]
)
def test_limbs_that_are_named_after_the_other_side(stems: tuple[str, ...], count: int) -> None:
    table = swapped(MIXAMO, *stems)
    mapping = map_bones(turned(rig_of(table)))
    assert mapping.bones == table
    (remark,) = [sentence for sentence in mapping.report if "other side" in sentence]
    assert f" {count}, '" in remark


def test_no_remark_where_names_and_positions_agree() -> None:
    for table in (MIXAMO, table_of("J_Bip_L_{}.L", "J_Bip_L_{}.R")):
        assert not any("side" in sentence for sentence in map_bones(rig_of(table)).report)


def test_a_helper_with_both_sides_is_no_hand() -> None:
    """A bone between both hands, as in engines, next to hands with a side in the name."""
    mapping = map_bones(rig_of(MIXAMO, [("hand_l_r", "LeftHand"), ("Foot_L_R", "Hips")]))
    assert mapping.bones == MIXAMO


def test_crossed_limbs_keep_their_names() -> None:
    """Hands on the opposite thigh, and crossed ankles."""
    head_by_bone = {
        "LeftHand": (-0.15, -0.1, 0.9), "RightHand": (0.15, -0.12, 0.9),
        "LeftFoot": (-0.05, 0.0, 0.08), "LeftToeBase": (-0.06, -0.12, 0.02),
        "RightFoot": (0.05, -0.1, 0.08), "RightToeBase": (0.06, -0.22, 0.02),
    }  # fmt: skip
    bones = [replace(b, head=head_by_bone.get(b.name, b.head)) for b in rig_of(MIXAMO)]
    assert map_bones(bones).bones == MIXAMO
