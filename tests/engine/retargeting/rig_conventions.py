# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone names of public conventions, written by hand: canonical bones, and additional bones."""

from __future__ import annotations

from collections.abc import Iterable

from hfx_blender.engine.body.rigs.mapping import RigBone
from hfx_blender.engine.body.rigs.rig import canonical_heads, canonical_parents

FINGERS = ("thumb", "index", "middle", "ring", "pinky")
LIMBS = "clavicle upperarm01 lowerarm01 wrist upperleg01 lowerleg01 foot toe2-1".split()


def named(trunk: str, limbs: str, fingers: str, sides: tuple[str, str]) -> dict[str, str]:
    """Return canonical bone -> name. ``*`` in a limb or finger name stands for the side.

    trunk: "canonical=name" pairs; limbs: a name for each of LIMBS ("-" for none); fingers: a
    pattern for each finger, ``#`` stands for the joint, or "-".
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


def with_sides(table: dict[str, str], sides: tuple[str, str], **more: str) -> dict[str, str]:
    added = {
        f"{bone}.{side}": name.replace("*", word)
        for side, word in zip("LR", sides, strict=True)
        for bone, name in more.items()
    }
    return table | added


_MIXAMO_LIMBS = "*Shoulder;*Arm;*ForeArm;*Hand;*UpLeg;*Leg;*Foot;*ToeBase"
_MIXAMO_FINGERS = "*HandThumb#;*HandIndex#;*HandMiddle#;*HandRing#;*HandPinky#"
_MIXAMO_TRUNK = "root=Hips;spine03=Spine;spine02=Spine1;spine01=Spine2;neck01=Neck;head=Head"
WORDS = ("Left", "Right")
_UE_LIMBS = "clavicle_*;upperarm_*;lowerarm_*;hand_*;thigh_*;calf_*;foot_*;ball_*"
_UE_FINGERS = "thumb_0#_*;index_0#_*;middle_0#_*;ring_0#_*;pinky_0#_*"
LOW = ("l", "r")


def prefixed(prefix: str, table: dict[str, str]) -> dict[str, str]:
    return {bone: prefix + name for bone, name in table.items()}


def _unity_fingers(table: dict[str, str], thumb: str) -> dict[str, str]:
    """Rename joints to the words of Unity and VRM; VRM 1 has other words for the thumb."""
    names = dict(table)
    for side, word in zip("LR", ("left", "right"), strict=True):
        for number, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Little"), start=1):
            joints = thumb if finger == "Thumb" else "Proximal Intermediate Distal"
            for joint, called in enumerate(joints.split(), start=1):
                names[f"finger{number}-{joint}.{side}"] = f"{word}{finger}{called}"
    return names


_VRM = named(
    "root=hips;spine04=spine;spine02=chest;spine01=upperChest;neck01=neck;head=head;jaw=jaw;"
    "eye.L=leftEye;eye.R=rightEye",
    "*Shoulder;*UpperArm;*LowerArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toes",
    "-;-;-;-;-",
    ("left", "right"),
)
MIXAMO = named(_MIXAMO_TRUNK, _MIXAMO_LIMBS, _MIXAMO_FINGERS, WORDS)
_DAZ8 = with_sides(
    named(
        "root=hip;spine05=abdomenLower;spine03=abdomenUpper;spine02=chestLower;"
        "spine01=chestUpper;neck01=neckLower;neck03=neckUpper;head=head;jaw=lowerJaw",
        "*Collar;*ShldrBend;*ForearmBend;*Hand;*ThighBend;*Shin;*Foot;-",
        "*Thumb#;*Index#;*Mid#;*Ring#;*Pinky#",
        LOW,
    ),
    LOW,
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
    table = named(
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


def metacarpals(pattern: str, sides: tuple[str, str]) -> dict[str, str]:
    names = ("index", "middle", "ring", "pinky")
    return with_sides(
        {},
        sides,
        **{f"metacarpal{n}": pattern.replace("#", f) for n, f in enumerate(names, start=1)},
    )


_UE5_HELPERS = [
    ("root", None),
    *((f"{bone}_{side}", f"{parent}_{side}") for side in LOW for bone, parent in (
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

MMD = with_sides(
    named(
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

ARP = with_sides(
    named(
        "root=root.x;spine04=spine_01.x;spine02=spine_02.x;spine01=spine_03.x;neck01=neck.x;"
        "head=head.x",
        "shoulder.*;arm_stretch.*;forearm_stretch.*;hand.*;thigh_stretch.*;leg_stretch.*;foot.*;"
        "toes_01.*",
        "-;-;-;-;-",
        LOW,
    ),
    LOW,
    **{f"finger1-{j}": f"{'' if j == 1 else 'c_'}thumb{j}.*" for j in (1, 2, 3)},
    **{
        f"finger{n}-{j}": f"{'' if j == 1 else 'c_'}{FINGERS[n - 1]}{j}.*"
        for n in (2, 3, 4, 5) for j in (1, 2, 3)
    },
    **{f"metacarpal{n}": f"c_{FINGERS[n]}1_base.*" for n in (1, 2, 3, 4)},
)  # fmt: skip
_ARP_CONTROLS: list[tuple[str, str | None]] = [
    ("c_pos", None), ("c_traj", "c_pos"), ("c_root_master.x", "c_traj"),
    *((f"{name}.{s}", f"{above}.{s}") for s in LOW for name, above in (
        ("arm", "shoulder"), ("forearm", "arm"), ("c_arm_fk", "shoulder"), ("c_hand_ik", "hand"),
        ("c_hand_fk", "hand"), ("thigh", "hand"), ("leg", "thigh"), ("c_foot_ik", "hand"),
        ("c_thumb1", "hand"), ("c_index1", "hand"), ("c_pinky1", "hand"), ("c_shoulder", "hand"),
        ("c_toes_fk", "foot"), ("c_arms_pole", "hand"),
    )),
]  # fmt: skip

CONVENTIONS: dict[str, tuple[str, dict[str, str], list[tuple[str, str | None]]]] = {
    "mixamo": (
        "mixamo",
        prefixed("mixamorig:", MIXAMO),
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
    "mixamo, numbered": ("mixamo", prefixed("mixamorig1:", MIXAMO), []),
    "mixamo, no colon": ("mixamo", prefixed("mixamorig", MIXAMO), []),
    "mixamo, no prefix": ("mixamo", MIXAMO, [("HeadTop_End", "Head")]),
    "vrm 0": (
        "vrm",
        _unity_fingers(_VRM, "Proximal Intermediate Distal"),
        [("hair1_L", "head"), ("leftSkirt", "hips")],
    ),
    "vrm 1": ("vrm", _unity_fingers(_VRM, "Metacarpal Proximal Distal"), []),
    "vroid": (
        "vrm",
        named(
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
        named(
            "root=pelvis;spine04=spine_01;spine02=spine_02;spine01=spine_03;neck01=neck_01;"
            "head=head",
            _UE_LIMBS,
            _UE_FINGERS,
            LOW,
        ),
        [h for h in _UE5_HELPERS if not h[0].startswith("spine_04")],
    ),
    "unreal 5": (
        "unreal",
        named(
            "root=pelvis;spine05=spine_01;spine04=spine_02;spine03=spine_03;spine02=spine_04;"
            "spine01=spine_05;neck01=neck_01;neck03=neck_02;head=head",
            _UE_LIMBS,
            _UE_FINGERS,
            LOW,
        )
        | metacarpals("#_metacarpal_*", LOW),
        _UE5_HELPERS,
    ),
    "cmu": (
        "cmu",
        with_sides(
            named(
                "root=Hips;spine04=LowerBack;spine02=Spine;spine01=Spine1;neck01=Neck;"
                "neck03=Neck1;head=Head",
                _MIXAMO_LIMBS,
                "-;-;-;-;-",
                WORDS,
            ),
            WORDS,
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
        named(
            "root=hip;spine05=spine1;spine03=spine2;spine02=spine3;spine01=spine4;"
            "neck01=neck1;neck03=neck2;head=head",
            "*_shoulder;*_upperarm;*_forearm;*_hand;*_thigh;*_shin;*_foot;*_toes",
            "*_thumb#;*_index#;*_mid#;*_ring#;*_pinky#",
            LOW,
        )
        | metacarpals("*_#metacarpal", LOW)
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
        with_sides(
            prefixed(
                "CC_Base_",
                named(
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
    "mikumikudance": ("mmd", MMD, _MMD_HELPERS),
    "mikumikudance, sides at the end": (
        "mmd",
        {
            bone: f"{name[1:]}.{ {'左': 'L', '右': 'R'}[name[0]] }" if name[0] in "左右" else name
            for bone, name in MMD.items()
        },
        [],
    ),
    "mikumikudance, english": (
        "mmd",
        with_sides(
            named(
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
    "auto-rig pro": ("auto-rig pro", ARP, _ARP_CONTROLS),
    "xsens": (
        "xsens",
        named(
            "root=Pelvis;spine05=L5;spine03=L3;spine02=T12;spine01=T8;neck01=Neck;head=Head",
            "*Shoulder;*UpperArm;*ForeArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toe",
            "-;-;-;-;-",
            WORDS,
        ),
        [],
    ),
    "rokoko": (
        "plain",
        named(
            "root=Hips;spine04=Spine1;spine03=Spine2;spine02=Spine3;spine01=Spine4;neck01=Neck;"
            "head=Head",
            "*Shoulder;*Arm;*ForeArm;*Hand;*Thigh;*Shin;*Foot;*Toe",
            "-;-;-;-;-",
            WORDS,
        ),
        [("LeftToeTip", "LeftToe"), ("HeadVertex", "Head")],
    ),
    "smpl": (
        "smpl",
        named(
            "root=Pelvis;spine04=Spine1;spine03=Spine2;spine02=Spine3;neck01=Neck;head=Head",
            "*_Collar;*_Shoulder;*_Elbow;*_Wrist;*_Hip;*_Knee;*_Ankle;*_Foot",
            "-;-;-;-;-",
            ("L", "R"),
        ),
        [("L_Hand", "L_Wrist"), ("R_Hand", "R_Wrist")],
    ),
    "advanced skeleton": (
        "plain",
        named(
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
        named(
            "root=mPelvis;spine04=mTorso;spine02=mChest;neck01=mNeck;head=mHead",
            "mCollar*;mShoulder*;mElbow*;mWrist*;mHip*;mKnee*;mAnkle*;mToe*",
            "mHandThumb#*;mHandIndex#*;mHandMiddle#*;mHandRing#*;mHandPinky#*",
            WORDS,
        ),
        [("mFootLeft", "mAnkleLeft"), ("mSkull", "mHead"), ("mWingsRoot", "mChest")],
    ),
    "vrchat, words": (
        "plain",
        named(
            "root=Hips;spine04=Spine;spine02=Chest;spine01=Upper Chest;neck01=Neck;head=Head",
            "Shoulder.*;Upper Arm.*;Lower Arm.*;Hand.*;Upper Leg.*;Lower Leg.*;Foot.*;Toes.*",
            "Thumb #.*;Index #.*;Middle #.*;Ring #.*;Little #.*",
            ("L", "R"),
        ),
        [("Ear.L", "Head"), ("Tail", "Hips"), ("Butt.L", "Hips"), ("Skirt Front", "Hips")],
    ),
    "plain, joints named": (
        "plain",
        named(
            "root=Hips;spine04=Spine;spine02=Chest;neck01=Neck;head=Head",
            "* shoulder;* arm;* elbow;* wrist;* leg;* knee;* ankle;* toe",
            "Thumb#_*;IndexFinger#_*;MiddleFinger#_*;RingFinger#_*;LittleFinger#_*",
            WORDS,
        ),
        [("Breast_Root", "Chest"), ("Left arm pole", "Hips")],
    ),
    "plain, own prefix": (
        "plain",
        prefixed(
            "Hero3_",
            named(
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
        named(
            "root=hips;spine03=spine;spine01=chest;neck01=neck;head=head",
            "*clavicle;*upperarm;*forearm;*hand;*thigh;*shin;*foot;*toe",
            "*thumb#;*index#;*middle#;*ring#;*pinky#",
            ("left", "right"),
        ),
        [],
    ),
}


def rig_of(
    table: dict[str, str], more: Iterable[tuple[str, str | None]] = (), scale: float = 1.0
) -> list[RigBone]:
    """Return bones at canonical positions with canonical parents; further bones at a parent."""
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
