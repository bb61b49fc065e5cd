# SPDX-License-Identifier: GPL-3.0-or-later
"""Mapping avatars' bones: each convention's names against counterparts written by hand."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body.rigs import mapping as bone_mapping
from hfx_blender.engine.body.rigs.mapping import BoneMapping, RigBone
from hfx_blender.engine.body.rigs.names import read_names
from hfx_blender.engine.body.rigs.rig import canonical_heads, canonical_parents
from hfx_blender.errors import InputError
from hfx_blender.maintenance.body_building import source

FINGERS = ("thumb", "index", "middle", "ring", "pinky")
LIMBS = "clavicle upperarm01 lowerarm01 wrist upperleg01 lowerleg01 foot toe2-1".split()


def _table(trunk: str, limbs: str, fingers: str, sides: tuple[str, str]) -> dict[str, str]:
    """Canonical bone -> name. ``*`` in a limb or finger name stands for the side.

    trunk: "canonical=name" pairs; limbs: one name for each of LIMBS ("-" for none);
    fingers: one pattern for each finger, ``#`` stands for the joint, or "-".
    """
    table = dict(pair.split("=") for pair in trunk.split(";"))
    for side, word in zip("LR", sides, strict=True):
        for bone, name in zip(LIMBS, limbs.split(";"), strict=True):
            if name != "-":
                table[f"{bone}.{side}"] = name.replace("*", word)
        for number, pattern in enumerate(fingers.split(";"), start=1):
            for joint in "123":
                if pattern != "-":
                    name = pattern.replace("*", word).replace("#", joint)
                    table[f"finger{number}-{joint}.{side}"] = name
    return table


def _with_sides(table: dict[str, str], sides: tuple[str, str], **more: str) -> dict[str, str]:
    added = {
        f"{bone}.{side}": name.replace("*", word)
        for side, word in zip("LR", sides, strict=True)
        for bone, name in more.items()
    }
    return table | added


_MIXAMO_LIMBS = "*Shoulder;*Arm;*ForeArm;*Hand;*UpLeg;*Leg;*Foot;*ToeBase"
_MIXAMO_FINGERS = "*HandThumb#;*HandIndex#;*HandMiddle#;*HandRing#;*HandPinky#"
_MIXAMO_TRUNK = "root=Hips;spine03=Spine;spine02=Spine1;spine01=Spine2;neck01=Neck;head=Head"
_WORDS = ("Left", "Right")
_UE_LIMBS = "clavicle_*;upperarm_*;lowerarm_*;hand_*;thigh_*;calf_*;foot_*;ball_*"
_UE_FINGERS = "thumb_0#_*;index_0#_*;middle_0#_*;ring_0#_*;pinky_0#_*"
_LOW = ("l", "r")


def _prefixed(prefix: str, table: dict[str, str]) -> dict[str, str]:
    return {bone: prefix + name for bone, name in table.items()}


def _unity_fingers(table: dict[str, str], thumb: str) -> dict[str, str]:
    """Unity's and VRM's joints have words for numbers; VRM 1 renamed those of the thumb."""
    names = dict(table)
    for side, word in zip("LR", ("left", "right"), strict=True):
        for number, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Little"), start=1):
            joints = thumb if finger == "Thumb" else "Proximal Intermediate Distal"
            for joint, called in enumerate(joints.split(), start=1):
                names[f"finger{number}-{joint}.{side}"] = f"{word}{finger}{called}"
    return names


_VRM = _table(
    "root=hips;spine04=spine;spine02=chest;spine01=upperChest;neck01=neck;head=head;jaw=jaw;"
    "eye.L=leftEye;eye.R=rightEye",
    "*Shoulder;*UpperArm;*LowerArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toes",
    "-;-;-;-;-",
    ("left", "right"),
)
_MIXAMO = _table(_MIXAMO_TRUNK, _MIXAMO_LIMBS, _MIXAMO_FINGERS, _WORDS)
_DAZ8 = _with_sides(
    _table(
        "root=hip;spine05=abdomenLower;spine03=abdomenUpper;spine02=chestLower;"
        "spine01=chestUpper;neck01=neckLower;neck03=neckUpper;head=head;jaw=lowerJaw",
        "*Collar;*ShldrBend;*ForearmBend;*Hand;*ThighBend;*Shin;*Foot;-",
        "*Thumb#;*Index#;*Mid#;*Ring#;*Pinky#",
        _LOW,
    ),
    _LOW,
    **{f"metacarpal{n}": f"*Carpal{n}" for n in (1, 2, 3, 4)},
    **{"lowerarm02": "*ForearmTwist", "breast": "*Pectoral", "eye": "*Eye"},
    **{"toe1-1": "*BigToe", "toe1-2": "*BigToe_2"},
    **{f"toe{n + 1}-1": f"*SmallToe{n}" for n in (1, 2, 3, 4)},
    **{f"toe{n + 1}-2": f"*SmallToe{n}_2" for n in (1, 2, 3, 4)},
)
_BIPED_TRUNK = (
    "root=Bip01 Pelvis;spine04=Bip01 Spine;spine02=Bip01 Spine1;spine01=Bip01 Spine2;"
    "neck01=Bip01 Neck;head=Bip01 Head"
)


def _biped() -> dict[str, str]:
    table = _table(
        _BIPED_TRUNK,
        "Bip01 * Clavicle;Bip01 * UpperArm;Bip01 * Forearm;Bip01 * Hand;Bip01 * Thigh;"
        "Bip01 * Calf;Bip01 * Foot;Bip01 * Toe0",
        "-;-;-;-;-",
        ("L", "R"),
    )
    for side in "LR":
        for number in range(1, 6):
            for joint, digit in enumerate(("", "1", "2"), start=1):
                table[f"finger{number}-{joint}.{side}"] = f"Bip01 {side} Finger{number - 1}{digit}"
    return table


def _metacarpals(pattern: str, sides: tuple[str, str]) -> dict[str, str]:
    names = ("index", "middle", "ring", "pinky")
    return _with_sides(
        {},
        sides,
        **{f"metacarpal{n}": pattern.replace("#", f) for n, f in enumerate(names, start=1)},
    )


_UE5_HELPERS = [
    ("root", None),
    *((f"{bone}_{side}", f"{parent}_{side}") for side in _LOW for bone, parent in (
        ("upperarm_twist_01", "upperarm"), ("upperarm_correctiveRoot", "upperarm"),
        ("upperarm_bicep", "upperarm"), ("lowerarm_twist_01", "lowerarm"),
        ("lowerarm_twist_02", "lowerarm"), ("lowerarm_in", "lowerarm"),
        ("wrist_inner", "hand"), ("thigh_twist_01", "thigh"), ("calf_twist_02", "calf"),
        ("calf_knee", "calf"), ("ankle_bck", "foot"), ("clavicle_scap", "clavicle"),
    )),
    ("ik_foot_root", "root"), ("ik_foot_l", "ik_foot_root"), ("ik_hand_gun", "root"),
    ("ik_hand_l", "ik_hand_gun"), ("VB Hand_r_Hand_l", "root"),
    ("spine_04_latissimus_l", "spine_04"),
    ("center_of_mass", "root"),
]  # fmt: skip

_MMD = _with_sides(
    _table(
        "root=下半身;spine04=上半身;spine02=上半身2;neck01=首;head=頭",
        "*肩;*腕;*ひじ;*手首;*足;*ひざ;*足首;*足先EX",
        "-;*人指#;*中指#;*薬指#;*小指#",
        ("左", "右"),
    ),
    ("左", "右"),
    # Their digits are of full width.
    **{f"finger1-{joint}": f"*親指{chr(0xFF10 + joint - 1)}" for joint in (1, 2, 3)},
    eye="*目",
)
_MMD_HELPERS: list[tuple[str, str | None]] = [
    ("全ての親", None), ("センター", "全ての親"), ("グルーブ", "センター"), ("腰", "グルーブ"),
    ("左足ＩＫ", "全ての親"), ("左つま先ＩＫ", "左足ＩＫ"), ("左つま先", "左足首"), ("両目", "頭"),
    ("左腕捩", "左腕"), ("左手捩", "左ひじ"), ("左肩P", "上半身2"), ("左ダミー", "左手首"),
    ("左胸操作", "上半身2"), ("腰キャンセル左", "下半身"), ("右スカート_0_1", "下半身"),
]  # fmt: skip

_ARP = _with_sides(
    _table(
        "root=root.x;spine04=spine_01.x;spine02=spine_02.x;spine01=spine_03.x;neck01=neck.x;"
        "head=head.x",
        "shoulder.*;arm_stretch.*;forearm_stretch.*;hand.*;thigh_stretch.*;leg_stretch.*;foot.*;"
        "toes_01.*",
        "-;-;-;-;-",
        _LOW,
    ),
    _LOW,
    **{f"finger1-{j}": f"{'' if j == 1 else 'c_'}thumb{j}.*" for j in (1, 2, 3)},
    **{
        f"finger{n}-{j}": f"{'' if j == 1 else 'c_'}{FINGERS[n - 1]}{j}.*"
        for n in (2, 3, 4, 5) for j in (1, 2, 3)
    },
    **{f"metacarpal{n}": f"c_{FINGERS[n]}1_base.*" for n in (1, 2, 3, 4)},
)  # fmt: skip
_ARP_CONTROLS: list[tuple[str, str | None]] = [
    ("c_pos", None), ("c_traj", "c_pos"), ("c_root_master.x", "c_traj"),
    *((f"{name}.{s}", f"{above}.{s}") for s in _LOW for name, above in (
        ("arm", "shoulder"), ("forearm", "arm"), ("c_arm_fk", "shoulder"), ("c_hand_ik", "hand"),
        ("c_hand_fk", "hand"), ("thigh", "hand"), ("leg", "thigh"), ("c_foot_ik", "hand"),
        ("c_thumb1", "hand"), ("c_index1", "hand"), ("c_pinky1", "hand"), ("c_shoulder", "hand"),
        ("c_toes_fk", "foot"), ("c_arms_pole", "hand"),
    )),
]  # fmt: skip

CONVENTIONS: dict[str, tuple[str, dict[str, str], list[tuple[str, str | None]]]] = {
    "mixamo": (
        "mixamo",
        _prefixed("mixamorig:", _MIXAMO),
        [
            (f"mixamorig:{name}", f"mixamorig:{parent}")
            for name, parent in (
                ("HeadTop_End", "Head"),
                ("LeftToe_End", "LeftToeBase"),
                ("LeftHandThumb4", "LeftHandThumb3"),
                ("LeftHandIndex4", "LeftHandIndex3"),
                ("RightHandPinky4", "RightHandPinky3"),
            )
        ],
    ),
    "mixamo, numbered": ("mixamo", _prefixed("mixamorig1:", _MIXAMO), []),
    "mixamo, no colon": ("mixamo", _prefixed("mixamorig", _MIXAMO), []),
    "mixamo, no prefix": ("mixamo", _MIXAMO, [("HeadTop_End", "Head")]),
    "vrm 0": (
        "vrm",
        _unity_fingers(_VRM, "Proximal Intermediate Distal"),
        [("hair1_L", "head"), ("leftSkirt", "hips")],
    ),
    "vrm 1": ("vrm", _unity_fingers(_VRM, "Metacarpal Proximal Distal"), []),
    "vroid": (
        "vrm",
        _table(
            "root=J_Bip_C_Hips;spine04=J_Bip_C_Spine;spine02=J_Bip_C_Chest;"
            "spine01=J_Bip_C_UpperChest;neck01=J_Bip_C_Neck;head=J_Bip_C_Head;"
            "eye.L=J_Adj_L_FaceEye;eye.R=J_Adj_R_FaceEye",
            "J_Bip_*_Shoulder;J_Bip_*_UpperArm;J_Bip_*_LowerArm;J_Bip_*_Hand;J_Bip_*_UpperLeg;"
            "J_Bip_*_LowerLeg;J_Bip_*_Foot;J_Bip_*_ToeBase",
            "J_Bip_*_Thumb#;J_Bip_*_Index#;J_Bip_*_Middle#;J_Bip_*_Ring#;J_Bip_*_Little#",
            ("L", "R"),
        ),
        [
            ("J_Sec_Hair1_01", "J_Bip_C_Head"),
            ("J_Sec_L_Bust1", "J_Bip_C_UpperChest"),
            ("J_Sec_R_SkirtFront_01", "J_Bip_C_Hips"),
            ("J_Bip_L_Thumb3_end", "J_Bip_L_Thumb3"),
        ],
    ),
    "unreal 4": (
        "unreal",
        _table(
            "root=pelvis;spine04=spine_01;spine02=spine_02;spine01=spine_03;neck01=neck_01;"
            "head=head",
            _UE_LIMBS,
            _UE_FINGERS,
            _LOW,
        ),
        [h for h in _UE5_HELPERS if not h[0].startswith("spine_04")],
    ),
    "unreal 5": (
        "unreal",
        _table(
            "root=pelvis;spine05=spine_01;spine04=spine_02;spine03=spine_03;spine02=spine_04;"
            "spine01=spine_05;neck01=neck_01;neck03=neck_02;head=head",
            _UE_LIMBS,
            _UE_FINGERS,
            _LOW,
        )
        | _metacarpals("#_metacarpal_*", _LOW),
        _UE5_HELPERS,
    ),
    "cmu": (
        "cmu",
        _with_sides(
            _table(
                "root=Hips;spine04=LowerBack;spine02=Spine;spine01=Spine1;neck01=Neck;"
                "neck03=Neck1;head=Head",
                _MIXAMO_LIMBS,
                "-;-;-;-;-",
                _WORDS,
            ),
            _WORDS,
            **{"metacarpal1": "*FingerBase", "finger2-1": "*HandIndex1"},
        )
        | {"finger1-1.L": "LThumb", "finger1-1.R": "RThumb"}
        | {"pelvis.L": "LHipJoint", "pelvis.R": "RHipJoint"},
        [],
    ),
    "daz 8": (
        "daz",
        _DAZ8 | {"pelvis.L": "pelvis", "pelvis.R": "pelvis"},
        [
            ("lThighTwist", "lThighBend"),
            ("lShldrTwist", "lShldrBend"),
            ("lMetatarsals", "lFoot"),
            ("lToe", "lMetatarsals"),
            ("upperFaceRig", "head"),
        ],
    ),
    "daz 9": (
        "daz",
        _table(
            "root=hip;spine05=spine1;spine03=spine2;spine02=spine3;spine01=spine4;"
            "neck01=neck1;neck03=neck2;head=head",
            "*_shoulder;*_upperarm;*_forearm;*_hand;*_thigh;*_shin;*_foot;*_toes",
            "*_thumb#;*_index#;*_mid#;*_ring#;*_pinky#",
            _LOW,
        )
        | _metacarpals("*_#metacarpal", _LOW)
        | {"metacarpal2.L": "l_midmetacarpal", "metacarpal2.R": "r_midmetacarpal"},
        [
            ("l_upperarmtwist1", "l_upperarm"),
            ("l_forearmtwist1", "l_forearm"),
            ("l_thightwist2", "l_thigh"),
            ("l_metatarsal", "l_foot"),
        ],
    ),
    "biped": (
        "biped",
        _biped(),
        [
            ("Bip01", None),
            ("Bip01 Footsteps", "Bip01"),
            ("Bip01 L Finger0Nub", "Bip01 L Finger02"),
            ("Bip01 HeadNub", "Bip01 Head"),
            ("Bip01 L ForeTwist", "Bip01 L Forearm"),
            ("Bip01 Ponytail1", "Bip01 Head"),
        ],
    ),
    "character creator 4": (
        "character creator",
        _with_sides(
            _prefixed(
                "CC_Base_",
                _table(
                    "root=Hip;spine05=Waist;spine03=Spine01;spine01=Spine02;neck01=NeckTwist01;"
                    "neck02=NeckTwist02;head=Head;jaw=JawRoot",
                    "*_Clavicle;*_Upperarm;*_Forearm;*_Hand;*_Thigh;*_Calf;*_Foot;-",
                    "*_Thumb#;*_Index#;*_Mid#;*_Ring#;*_Pinky#",
                    ("L", "R"),
                ),
            ),
            ("L", "R"),
            **{"pelvis": "CC_Base_Pelvis", "eye": "CC_Base_*_Eye", "breast": "CC_Base_*_Breast"},
            **{
                f"toe{n}-1": f"CC_Base_*_{name}Toe1"
                for n, name in enumerate(("Big", "Index", "Mid", "Ring", "Pinky"), start=1)
            },
        ),
        [
            ("CC_Base_BoneRoot", None),
            *(
                (f"CC_Base_{s}_{name}", f"CC_Base_{s}_{above}")
                for s in "LR"
                for name, above in (
                    ("UpperarmTwist01", "Upperarm"),
                    ("UpperarmTwist02", "Upperarm"),
                    ("ForearmTwist01", "Forearm"),
                    ("ThighTwist01", "Thigh"),
                    ("CalfTwist01", "Calf"),
                    ("ElbowShareBone", "Forearm"),
                    ("KneeShareBone", "Calf"),
                    ("ToeBase", "Foot"),
                    ("ToeBaseShareBone", "Foot"),
                    ("RibsTwist", "Clavicle"),
                )
            ),
            ("CC_Base_FacialBone", "CC_Base_Head"),
        ],
    ),
    "mikumikudance": ("mmd", _MMD, _MMD_HELPERS),
    "mikumikudance, sides at the end": (
        "mmd",
        {
            bone: f"{name[1:]}.{ {'左': 'L', '右': 'R'}[name[0]] }" if name[0] in "左右" else name
            for bone, name in _MMD.items()
        },
        [],
    ),
    "mikumikudance, english": (
        "mmd",
        _with_sides(
            _table(
                "root=lower body;spine04=upper body;spine02=upper body2;neck01=neck;head=head",
                "shoulder_*;arm_*;elbow_*;wrist_*;leg_*;knee_*;ankle_*;-",
                "-;fore#_*;middle#_*;third#_*;little#_*",
                ("L", "R"),
            ),
            ("L", "R"),
            eye="eye_*",
            **{f"finger1-{joint}": f"thumb{joint - 1}_*" for joint in (1, 2, 3)},
        ),
        [
            ("center", None),
            ("groove", "center"),
            ("waist", "groove"),
            ("leg IK_L", None),
            ("toe IK_L", "leg IK_L"),
            ("toe_L", "ankle_L"),
            ("arm twist_L", "arm_L"),
            ("wrist twist_L", "elbow_L"),
            ("shoulderP_L", "upper body2"),
            ("eyes", "head"),
        ],
    ),
    "auto-rig pro": ("auto-rig pro", _ARP, _ARP_CONTROLS),
    "xsens": (
        "xsens",
        _table(
            "root=Pelvis;spine05=L5;spine03=L3;spine02=T12;spine01=T8;neck01=Neck;head=Head",
            "*Shoulder;*UpperArm;*ForeArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toe",
            "-;-;-;-;-",
            _WORDS,
        ),
        [],
    ),
    "rokoko": (
        "plain",
        _table(
            "root=Hips;spine04=Spine1;spine03=Spine2;spine02=Spine3;spine01=Spine4;neck01=Neck;"
            "head=Head",
            "*Shoulder;*Arm;*ForeArm;*Hand;*Thigh;*Shin;*Foot;*Toe",
            "-;-;-;-;-",
            _WORDS,
        ),
        [("LeftToeTip", "LeftToe"), ("HeadVertex", "Head")],
    ),
    "smpl": (
        "smpl",
        _table(
            "root=Pelvis;spine04=Spine1;spine03=Spine2;spine02=Spine3;neck01=Neck;head=Head",
            "*_Collar;*_Shoulder;*_Elbow;*_Wrist;*_Hip;*_Knee;*_Ankle;*_Foot",
            "-;-;-;-;-",
            ("L", "R"),
        ),
        [("L_Hand", "L_Wrist"), ("R_Hand", "R_Wrist")],
    ),
    "advanced skeleton": (
        "plain",
        _table(
            "root=Root_M;spine04=Spine1_M;spine01=Chest_M;neck01=Neck_M;head=Head_M;jaw=Jaw_M",
            "Scapula_*;Shoulder_*;Elbow_*;Wrist_*;Hip_*;Knee_*;Ankle_*;Toes_*",
            "ThumbFinger#_*;IndexFinger#_*;MiddleFinger#_*;RingFinger#_*;PinkyFinger#_*",
            ("L", "R"),
        ),
        [
            ("ToesEnd_L", "Toes_L"),
            ("HipPart1_L", "Hip_L"),
            ("ShoulderPart1_L", "Shoulder_L"),
            ("Cup_L", "Wrist_L"),
            ("Head_M_end", "Head_M"),
        ],
    ),
    "second life": (
        "second life",
        _table(
            "root=mPelvis;spine04=mTorso;spine02=mChest;neck01=mNeck;head=mHead",
            "mCollar*;mShoulder*;mElbow*;mWrist*;mHip*;mKnee*;mAnkle*;mToe*",
            "mHandThumb#*;mHandIndex#*;mHandMiddle#*;mHandRing#*;mHandPinky#*",
            _WORDS,
        ),
        [("mFootLeft", "mAnkleLeft"), ("mSkull", "mHead"), ("mWingsRoot", "mChest")],
    ),
    "vrchat, words": (
        "plain",
        _table(
            "root=Hips;spine04=Spine;spine02=Chest;spine01=Upper Chest;neck01=Neck;head=Head",
            "Shoulder.*;Upper Arm.*;Lower Arm.*;Hand.*;Upper Leg.*;Lower Leg.*;Foot.*;Toes.*",
            "Thumb #.*;Index #.*;Middle #.*;Ring #.*;Little #.*",
            ("L", "R"),
        ),
        [("Ear.L", "Head"), ("Tail", "Hips"), ("Butt.L", "Hips"), ("Skirt Front", "Hips")],
    ),
    "plain, joints named": (
        "plain",
        _table(
            "root=Hips;spine04=Spine;spine02=Chest;neck01=Neck;head=Head",
            "* shoulder;* arm;* elbow;* wrist;* leg;* knee;* ankle;* toe",
            "Thumb#_*;IndexFinger#_*;MiddleFinger#_*;RingFinger#_*;LittleFinger#_*",
            _WORDS,
        ),
        [("Breast_Root", "Chest"), ("Left arm pole", "Hips")],
    ),
    "plain, own prefix": (
        "plain",
        _prefixed(
            "Hero3_",
            _table(
                "root=pelvis;spine03=spine1;spine01=spine2;neck01=neck;head=head",
                "clavicle-*;upper-arm-*;lower-arm-*;hand-*;upper-leg-*;lower-leg-*;foot-*;toe-*",
                "thumb-#-*;pointer-#-*;mid-#-*;ring-#-*;little-#-*",
                ("left", "right"),
            ),
        ),
        [("Hero3_hand-ik-left", None), ("Hero3_foot-roll-left", None)],
    ),
    "plain, glued": (
        "plain",
        _table(
            "root=hips;spine03=spine;spine01=chest;neck01=neck;head=head",
            "*clavicle;*upperarm;*forearm;*hand;*thigh;*shin;*foot;*toe",
            "*thumb#;*index#;*middle#;*ring#;*pinky#",
            ("left", "right"),
        ),
        [],
    ),
}


def _rig(
    table: dict[str, str], more: Iterable[tuple[str, str | None]] = (), scale: float = 1.0
) -> list[RigBone]:
    """Bones at the canonical places, hung as the canonical ones are; further ones at a parent."""
    heads, parents, bones = canonical_heads(), canonical_parents(), {}
    for canonical in parents:
        if canonical not in table:
            continue
        above = parents[canonical]
        while above is not None and above not in table:
            above = parents[above]
        head = heads[canonical] * scale
        if table[canonical] not in bones:
            bones[table[canonical]] = RigBone(
                table[canonical],
                None if above is None else table[above],
                tuple(head),
                (head[0], head[1], head[2] + 0.01),
            )
    for name, parent in more:
        at = bones[parent].head if parent in bones else (0.0, 0.0, 0.0)
        bones[name] = RigBone(name, parent, at, (at[0] + 0.01, at[1], at[2]))
    return list(bones.values())


def _check_complete(mapping: BoneMapping) -> None:
    assert mapping.bones.keys() | mapping.fallbacks.keys() == canonical_parents().keys()
    assert not mapping.bones.keys() & mapping.fallbacks.keys()


@pytest.mark.parametrize("case", CONVENTIONS)
def test_convention_is_mapped_as_by_hand(case: str) -> None:
    convention, table, more = CONVENTIONS[case]
    bones = _rig(table, more)
    random.Random(1).shuffle(bones)
    mapping = bone_mapping.map_bones(bones)
    assert mapping.bones == table
    assert mapping.convention == convention
    _check_complete(mapping)


def test_tables_hold_the_main_bones_and_fingers() -> None:
    for case, (_, table, _more) in CONVENTIONS.items():
        assert len(table) >= 50 or case in ("cmu", "xsens", "rokoko", "smpl"), case
        assert len({bone for bone in table if not bone.startswith("finger")}) >= 20, case


@pytest.mark.parametrize(
    "name",
    [
        "hand_ik.L", "upper_arm_fk.L", "MCH-thigh.L", "ORG-hand.L", "elbow_pole.L", "foot_roll_R",
        "knee target L", "head_ctrl", "VB Hand_r_Hand_l", "thumb_03_end_l", "ArmHelper.L",
        "LeftHandProp", "spine_tweak", "neckTie", "footstool", "ringmaster", "handle", "toenail.L",
        "Bip01 HeadNub", "upperarm_bicep_l", "J_Sec_L_Bust1", "eyebrow.L", "armor_l",
        "hand_l_r",
    ],
)  # fmt: skip
def test_look_alikes_are_not_joints(name: str) -> None:
    assert read_names([name]) == {}


def _rigify_rig() -> list[RigBone]:
    """A generated rig as Blender 4.5 makes it: split limbs hang on bones that do not deform."""
    table = {
        bone: f"DEF-{name}"
        for bone, name in _with_sides(
            {
                "root": "spine", "spine04": "spine.001", "spine02": "spine.002",
                "spine01": "spine.003", "neck01": "spine.004", "neck03": "spine.005",
                "head": "spine.006", "jaw": "jaw",
            },
            ("L", "R"),
            **{
                "pelvis": "pelvis.*", "upperleg01": "thigh.*", "lowerleg01": "shin.*",
                "lowerleg02": "shin.*.001", "foot": "foot.*", "toe2-1": "toe.*",
                "clavicle": "shoulder.*", "upperarm01": "upper_arm.*",
                "lowerarm01": "forearm.*", "lowerarm02": "forearm.*.001", "wrist": "hand.*",
                "breast": "breast.*",
                **{f"metacarpal{n}": f"palm.0{n}.*" for n in (1, 2, 3, 4)},
                **{
                    f"finger{n}-{j}": f"{'' if n == 1 else 'f_'}{FINGERS[n - 1]}.0{j}.*"
                    for n in (1, 2, 3, 4, 5) for j in (1, 2, 3)
                },
            },
        ).items()
    }  # fmt: skip
    bones = {bone.name: bone for bone in _rig(table)}
    for bone in list(bones.values()):
        original = bone.name.replace("DEF-", "ORG-")
        above = bone.parent and bone.parent.replace("DEF-", "ORG-")
        bones[original] = replace(bone, name=original, parent=above)
        if ".001" not in bone.name and "spine" not in bone.name and bone.parent:
            bones[bone.name] = replace(bone, parent=above)
        bones[bone.name[4:]] = replace(bone, name=bone.name[4:], parent=above)
    for side in "LR":  # split in the middle: no counterpart of a bone that begins at 0.29
        upper, fore = (np.array(bones[f"DEF-{n}.{side}"].head) for n in ("upper_arm", "forearm"))
        middle = tuple((upper + fore) / 2)
        second = RigBone(f"DEF-upper_arm.{side}.001", f"DEF-upper_arm.{side}", middle, tuple(fore))
        bones[second.name] = second
        bones[f"DEF-forearm.{side}"] = replace(bones[f"DEF-forearm.{side}"], parent=second.name)
        for control in ("hand_ik", "upper_arm_fk", "upper_arm_ik_target", "VIS_thigh_ik_pole"):
            bones[f"{control}.{side}"] = RigBone(f"{control}.{side}", None, middle, middle)
    return list(bones.values())


def test_rigify_takes_only_bones_that_deform() -> None:
    mapping = bone_mapping.map_bones(_rigify_rig())
    assert mapping.convention == "rigify"
    assert all(name.startswith("DEF-") for name in mapping.bones.values())
    for canonical, name in {
        "root": "DEF-spine", "spine04": "DEF-spine.001", "spine01": "DEF-spine.003",
        "neck01": "DEF-spine.004", "neck03": "DEF-spine.005", "head": "DEF-spine.006",
        "upperarm01.L": "DEF-upper_arm.L", "lowerarm01.R": "DEF-forearm.R",
        "lowerarm02.R": "DEF-forearm.R.001", "wrist.L": "DEF-hand.L",
        "upperleg01.R": "DEF-thigh.R", "lowerleg01.L": "DEF-shin.L", "foot.R": "DEF-foot.R",
        "toe2-1.L": "DEF-toe.L", "metacarpal4.R": "DEF-palm.04.R",
        "finger1-3.L": "DEF-thumb.03.L", "finger5-1.R": "DEF-f_pinky.01.R",
    }.items():  # fmt: skip
        assert mapping.bones[canonical] == name
    assert mapping.fallbacks["upperarm02.L"] == "DEF-upper_arm.L"
    assert mapping.fallbacks["toe5-3.L"] == "DEF-toe.L"


def test_controls_do_not_win_over_bones_that_deform() -> None:
    _, table, _ = CONVENTIONS["plain, glued"]
    bones = _rig(table)
    controls = [  # of the same names but for their separators, and higher up
        replace(bone, name=bone.name.replace("left", "left_"), parent=None, deform=False)
        for bone in bones
        if bone.name.startswith("left")
    ]
    assert bone_mapping.map_bones([*controls, *bones]).bones == table


def test_a_rig_none_of_whose_bones_deform_is_still_mapped() -> None:
    bones = [replace(bone, deform=False) for bone in _rig(_MIXAMO)]
    assert bone_mapping.map_bones(bones).bones == _MIXAMO


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_of_another_rig_is_not_taken(seed: int) -> None:
    names = ("upperarm01", "lowerarm01", "upperleg01", "wrist", "foot")
    left_over = [(f"{name}.{side}", "Hips") for name in names for side in "LR"]
    bones = _rig(_MIXAMO, [*left_over, ("spine01", "Hips"), ("root", None)])
    random.Random(seed).shuffle(bones)
    mapping = bone_mapping.map_bones(bones)
    main = [f"{bone}.{side}" for bone in LIMBS[1:7] for side in "LR"]
    assert {name: mapping.bones[name] for name in main} == {n: _MIXAMO[n] for n in main}


def test_the_skin_bone_of_two_at_one_joint_is_taken() -> None:
    legs = ("足", "ひざ", "足首")
    copies: list[tuple[str, str | None]] = []
    for side in "左右":
        above = "下半身"
        for name in legs:
            copies.append((f"{side}{name}D", above))
            above = f"{side}{name}D"
    table = dict(_MMD)
    for bone, name in _MMD.items():
        if name[1:] in legs:
            table[bone] = f"{name}D"
    bones = _rig(_MMD, copies)
    places = {bone.name: (bone.head, bone.tail) for bone in bones}
    bones = [
        replace(bone, head=places[bone.name[:-1]][0], tail=places[bone.name[:-1]][1])
        if bone.name.endswith("D")
        else bone
        for bone in bones
    ]
    assert bone_mapping.map_bones(bones).bones == table


def test_a_limb_whose_first_half_is_named_a_twist_bone_begins_there() -> None:
    bones = {bone.name: bone for bone in _rig(_ARP)}
    table = dict(_ARP)
    for side in _LOW:
        for stem, after in (("arm", "forearm_stretch"), ("thigh", "leg_stretch")):
            whole, end = bones[f"{stem}_stretch.{side}"], bones[f"{after}.{side}"]
            middle = tuple((np.array(whole.head) + np.array(end.head)) / 2)
            bones[f"{stem}_twist.{side}"] = replace(whole, name=f"{stem}_twist.{side}")
            bones[whole.name] = replace(whole, head=middle)
            first, second = ("upperarm01", "upperarm02") if stem == "arm" else (
                "upperleg01", "upperleg02")  # fmt: skip
            table[f"{first}.{side.upper()}"] = f"{stem}_twist.{side}"
            table[f"{second}.{side.upper()}"] = whole.name
    assert bone_mapping.map_bones(list(bones.values())).bones == table


def test_a_thumb_of_two_bones_begins_where_its_first_lies() -> None:
    for joints in ((1, 2), (2, 3)):
        table = {
            bone: name
            for bone, name in CONVENTIONS["plain, glued"][1].items()
            if not bone.startswith("finger1") or int(bone[8]) in joints
        }
        assert bone_mapping.map_bones(_rig(table)).bones == table


def test_a_misspelt_joint_is_the_only_child_of_the_one_above() -> None:
    table = {
        bone: name.replace("foot", "foor") for bone, name in CONVENTIONS["plain, glued"][1].items()
    }
    assert bone_mapping.map_bones(_rig(table)).bones == table
    bones = [bone for bone in _rig(table) if bone.name != "leftfoor"]
    one_sided = bone_mapping.map_bones(bones)  # of which nothing can be told
    assert {"foot.L", "foot.R"} <= one_sided.fallbacks.keys()


def test_the_trunk_never_follows_a_limb() -> None:
    table = {bone: name for bone, name in _MIXAMO.items() if bone != "root"}
    bones = [replace(b, parent=None) if b.parent == "Hips" else b for b in _rig(table)]
    mapping = bone_mapping.map_bones(bones)
    assert mapping.fallbacks["root"] == "Spine"
    assert mapping.fallbacks["spine05"] == "Spine"


def test_a_twist_bone_beside_the_limb_is_no_part_of_it() -> None:
    _, table, _ = CONVENTIONS["unreal 4"]
    middle = canonical_heads()["lowerarm02.L"]
    beside = RigBone("lowerarm_twist_01_l", "lowerarm_l", tuple(middle), tuple(middle))
    mapping = bone_mapping.map_bones([*_rig(table), beside])
    assert mapping.bones == table
    assert mapping.fallbacks["lowerarm02.L"] == "lowerarm_l"


def test_missing_fingers_toes_and_face_follow_their_parents_and_are_reported() -> None:
    table = {
        bone: name
        for bone, name in _MIXAMO.items()
        if "finger4" not in bone and bone not in ("finger3-3.L", "toe2-1.R", "clavicle.R")
    }
    mapping = bone_mapping.map_bones(_rig(table))
    assert mapping.bones == table
    assert mapping.fallbacks["finger4-2.L"] == "LeftHand"
    assert mapping.fallbacks["finger3-3.L"] == "LeftHandMiddle2"
    assert mapping.fallbacks["toe3-1.R"] == "RightFoot"
    assert mapping.fallbacks["clavicle.R"] == "Spine2"
    assert mapping.fallbacks["oris02"] == "Head"
    assert mapping.fallbacks["lowerarm02.L"] == "LeftForeArm"
    text = "\n".join(mapping.report)
    assert "the left ring finger; the skin there follows 'LeftHand'" in text
    assert "1 of 3 joints of the left middle finger" in text
    assert "the right collar bone" in text
    assert "toes of the right foot; the skin there follows 'RightFoot'" in text
    assert "left collar" not in text
    _check_complete(mapping)


def test_a_mitten_moves_all_fingers_but_the_thumb() -> None:
    table = {b: n for b, n in _MIXAMO.items() if b[:7] not in ("finger3", "finger4", "finger5")}
    mapping = bone_mapping.map_bones(_rig(table))
    assert mapping.fallbacks["finger5-2.R"] == "RightHandIndex2"
    assert mapping.fallbacks["metacarpal3.R"] == "RightHand"


def test_four_joints_begin_at_the_wrist_or_end_at_the_tip() -> None:
    names = _rig(_MIXAMO, [("LeftHandIndex4", "LeftHandIndex3")])
    assert bone_mapping.map_bones(names).bones["finger2-3.L"] == "LeftHandIndex3"
    palm = {
        f"metacarpal1.{side}": f"{word}HandIndex1" for side, word in zip("LR", _WORDS, strict=True)
    }
    table = _MIXAMO | palm
    for side, word in zip("LR", _WORDS, strict=True):
        table |= {f"finger2-{j}.{side}": f"{word}HandIndex{j + 1}" for j in (1, 2, 3)}
    assert bone_mapping.map_bones(_rig(table)).bones == table


def test_upper_body_alone_is_a_partial_human() -> None:
    table = {
        b: n
        for b, n in _MIXAMO.items()
        if not b.startswith(("upperleg", "lowerleg", "foot", "toe"))
    }
    bones = _rig(table)
    mapping = bone_mapping.map_bones(bones)
    assert mapping.bones["wrist.R"] == "RightHand"
    assert mapping.fallbacks["lowerleg01.L"] == "Hips"
    assert any("left thigh" in sentence for sentence in mapping.report)


def test_mirrored_names_are_mapped_by_where_they_lie() -> None:
    mirrored = [
        replace(bone, head=(-bone.head[0], *bone.head[1:]), tail=(-bone.tail[0], *bone.tail[1:]))
        for bone in _rig(_MIXAMO)
    ]
    mapping = bone_mapping.map_bones(mirrored)
    assert mapping.bones["upperarm01.L"] == "RightArm"
    assert mapping.bones["finger3-2.R"] == "LeftHandMiddle2"
    assert mapping.bones["head"] == "Head"
    assert any("mirrored" in sentence for sentence in mapping.report)
    assert not any("mirrored" in s for s in bone_mapping.map_bones(_rig(_MIXAMO)).report)


def _moved(bones: list[RigBone], matrix: np.ndarray) -> list[RigBone]:
    return [
        replace(b, head=tuple(matrix @ b.head + 3.0), tail=tuple(matrix @ b.tail + 3.0))
        for b in bones
    ]


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_a_turned_rig_is_mapped_alike(scale: float) -> None:
    still = _rig(_MIXAMO)
    expected = bone_mapping.map_bones(still)
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    bones = _moved(still, turn * scale)
    mapping = bone_mapping.map_bones(bones)
    assert mapping == expected


def _nameless(table: dict[str, str]) -> tuple[list[RigBone], dict[str, str]]:
    called = {name: f"Bone.{k:03d}" for k, name in enumerate(sorted(set(table.values())))}
    bones = [
        replace(b, name=called[b.name], parent=b.parent and called[b.parent]) for b in _rig(table)
    ]
    return bones, {canonical: called[name] for canonical, name in table.items()}


@pytest.mark.parametrize("turned", [False, True])
def test_nameless_human_is_found_by_its_shape(turned: bool) -> None:
    bones, expected = _nameless({b: n for b, n in _MIXAMO.items()})
    if turned:
        bones = _moved(bones, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    mapping = bone_mapping.map_bones(bones)
    assert mapping.convention == "geometry"
    assert mapping.bones == {b: n for b, n in expected.items() if not b.startswith("finger")}
    assert mapping.fallbacks["finger2-2.L"] == expected["wrist.L"]


def _chain(count: int) -> list[RigBone]:
    return [
        RigBone(f"Bone.{k}", f"Bone.{k - 1}" if k else None, (0, 0, k * 0.1), (0, 0, k * 0.1 + 0.1))
        for k in range(count)
    ]


def _quadruped() -> list[RigBone]:
    """Four legs that all reach down, a spine that lies."""
    bones = [
        RigBone("a", None, (0, 0.5, 1), (0, 0, 1)),
        RigBone("b", "a", (0, -0.5, 1), (0, -1, 1)),
    ]
    bones.append(RigBone("n", "b", (0, -0.7, 1.1), (0, -0.8, 1.2)))
    for at, y in (("a", 0.5), ("b", -0.5)):
        for x in (0.2, -0.2):
            above = at
            for k, (dy, z) in enumerate(((0, 0.9), (0, 0.5), (0, 0.1), (-0.15, 0.0))):
                name = f"{at}{x}{k}"
                bones.append(RigBone(name, above, (x, y + dy, z), (x, y + dy, z - 0.1)))
                above = name
    return bones


@pytest.mark.parametrize("bones", [[], _chain(1), _chain(20), _quadruped()])
def test_what_is_no_human_is_refused_in_one_sentence(bones: list[RigBone]) -> None:
    with pytest.raises(InputError, match="looked for hips or a spine"):
        bone_mapping.map_bones(bones)


def test_feet_without_toes_leave_a_nameless_rig_undecided() -> None:
    bones, _ = _nameless({b: n for b, n in _MIXAMO.items() if not b.startswith("toe")})
    with pytest.raises(InputError):
        bone_mapping.map_bones(bones)


def test_nameless_hip_joints_are_not_taken_for_thighs() -> None:
    """Legs of five bones that begin at the midline: a hip joint, not a mark at the toes."""
    bones, _ = _nameless(_MIXAMO | {"pelvis.L": "HipL", "pelvis.R": "HipR"})
    with pytest.raises(InputError):
        bone_mapping.map_bones(bones)


def test_corrections() -> None:
    mapping = bone_mapping.map_bones(_rig(_MIXAMO))
    corrected = bone_mapping.with_corrections(
        mapping, {"finger3-2.L": None, "jaw": "Jaw_Ctrl", "spine04": "Spine"}
    )
    assert corrected.bones["jaw"] == "Jaw_Ctrl"
    assert corrected.bones["spine04"] == "Spine"
    assert corrected.fallbacks["finger3-2.L"] == "LeftHandMiddle1"
    assert corrected.fallbacks["tongue00"] == "Jaw_Ctrl"
    assert any("left middle finger" in sentence for sentence in corrected.report)
    assert not any("jaw" in sentence for sentence in corrected.report)
    _check_complete(corrected)
    back = bone_mapping.with_corrections(
        corrected, {"finger3-2.L": "LeftHandMiddle2", "jaw": None, "spine04": None}
    )
    assert back == mapping
    with pytest.raises(InputError, match="'elbow' is no bone"):
        bone_mapping.with_corrections(mapping, {"elbow": "LeftArm"})
    with pytest.raises(InputError, match="has no bone left"):
        bone_mapping.with_corrections(mapping, dict.fromkeys(mapping.bones))


def test_json_round_trip_and_faults() -> None:
    table = {bone: name.replace("Left", "Linke_ä ") for bone, name in _MIXAMO.items()}
    mapping = replace(bone_mapping.map_bones(_rig(_MIXAMO)), bones=table)
    text = bone_mapping.to_json(mapping)
    assert bone_mapping.from_json(text) == mapping
    assert bone_mapping.to_json(bone_mapping.from_json(text)) == text
    stored = json.loads(text)
    for fault in (
        {"version": 2}, {"format": "other"}, {"bones": [1]}, {"bones": {"root": 3}},
        {"fallbacks": None}, {"report": 5}, {"bones": {"nose": "Nose"}}, {"version": "x"},
    ):  # fmt: skip
        with pytest.raises(InputError):
            bone_mapping.from_json(json.dumps(stored | fault))
    for text in ("", "[]", "3", "{}"):
        with pytest.raises(InputError, match="not a bone mapping"):
            bone_mapping.from_json(text)


def _installed_rigs() -> Path:
    named = os.environ.get("HFX_MAKEHUMAN_DATA")
    try:
        return source.locate(Path(named) if named else None) / "rigs"
    except InputError as error:
        pytest.skip(f"the source of the body models is not installed: {error}")


@pytest.mark.parametrize(
    ("file", "convention", "mapped"),
    [
        ("standard/rig.default.json", "makehuman default", 163),
        ("standard/rig.default_no_toes.json", "makehuman default", 137),
        ("standard/rig.game_engine.json", "game engine", 52),
        ("standard/rig.cmu_mb.json", "cmu", 31),
        ("standard/rig.mixamo.json", "mixamo", 52),
        ("rigify/rig.human.json", "rigify", 68),
        ("rigify/rig.human_toes.json", "rigify", 94),
    ],
)
def test_makehumans_own_rigs(file: str, convention: str, mapped: int) -> None:
    stored = json.loads((_installed_rigs() / file).read_text(encoding="utf-8"))
    bones = [
        RigBone(
            name,
            bone.get("parent") or None,
            tuple(bone["head"]["default_position"]),
            tuple(bone["tail"]["default_position"]),
        )
        for name, bone in stored.get("bones", stored).items()
        if isinstance(bone, dict) and "head" in bone
    ]
    mapping = bone_mapping.map_bones(bones)
    assert mapping.convention == convention
    assert len(mapping.bones) == mapped
    if convention == "makehuman default":
        assert all(canonical == name for canonical, name in mapping.bones.items())
