# SPDX-License-Identifier: GPL-3.0-or-later
"""More public conventions of bone names: suffixes, counters, joints, game engines, 15 bones.

Each maps a canonical bone to a name, after the convention's documentation or published mappings.
"""

from __future__ import annotations

from rig_conventions import (
    LOW,
    MIXAMO,
    WORDS,
    metacarpals,
    named,
    prefixed,
    with_sides,
)

_UPPER = ("L", "R")
_SPINE_3 = "root={0};spine04={1};spine02={2};spine01={3};neck01={4};head={5}"


def _counted(table: dict[str, str]) -> dict[str, str]:
    """Append each bone's number to the name, as exports of model viewers do."""
    return {bone: f"{name}_{k:02d}" for k, (bone, name) in enumerate(table.items())}


def _numbered_fingers(pattern: str, numbers: str, sides: tuple[str, str]) -> dict[str, str]:
    """Return fingers by number; ``numbers``: joint numbers per finger, separated by ","."""
    return with_sides(
        {},
        sides,
        **{
            f"finger{finger}-{joint}": pattern.replace("#", number)
            for finger, joints in enumerate(numbers.split(";"), start=1)
            for joint, number in enumerate(joints.split(","), start=1)
        },
    )


_BITMOJI = {
    **named(
        "root=C_pelvis0001_bind_JNT;spine04=C_spine0001_bind_JNT;spine02=C_spine0002_bind_JNT;"
        "spine01=C_spine0003_bind_JNT;neck01=C_neck0001_bind_JNT;neck03=C_neck0002_bind_JNT;"
        "head=C_head_bind_JNT",
        "*_clavicle_bind_JNT;*_armUpper0001_bind_JNT;*_armLower0001_bind_JNT;*_hand0001_bind_JNT;"
        "*_legUpper0001_bind_JNT;*_legLower0001_bind_JNT;*_foot0001_bind_JNT;*_foot0002_bind_JNT",
        "*_handThumb000#_bind_JNT;*_handPointer000#_bind_JNT;*_handMiddle000#_bind_JNT;"
        "*_handRing000#_bind_JNT;*_handPinky000#_bind_JNT",
        _UPPER,
    )
}
_BIPED_FINGERS = "0,01,02;1,11,12;2,21,22;3,31,32;4,41,42"


def _biped(prefix: str, between: str) -> dict[str, str]:
    limbs = "Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0".split()
    trunk = _SPINE_3.format("Pelvis", "Spine", "Spine1", "Spine2", "Neck1", "Head1")
    side = f"*{between}"
    table = named(trunk, ";".join(side + limb for limb in limbs), "-;-;-;-;-", _UPPER)
    table |= _numbered_fingers(f"{side}Finger#", _BIPED_FINGERS, _UPPER)
    return prefixed(prefix, table)


def _mgear() -> dict[str, str]:
    """Return limbs of two numbered parts each, and fingers with a special name for the thumb."""
    table = {
        **named(
            "root=spine_C0_0_jnt;spine03=spine_C0_1_jnt;spine01=spine_C0_2_jnt;"
            "neck01=neck_C0_0_jnt;head=neck_C0_head_jnt",
            "shoulder_*0_shoulder_jnt;arm_*0_0_jnt;arm_*0_2_jnt;arm_*0_end_jnt;"
            "leg_*0_0_jnt;leg_*0_2_jnt;leg_*0_end_jnt;foot_*0_0_jnt",
            "-;-;-;-;-",
            _UPPER,
        ),
        **_numbered_fingers(
            "finger_*#_jnt", "-,-,-;0_0,0_1,0_2;1_0,1_1,1_2;2_0,2_1,2_2;3_0,3_1,3_2", _UPPER
        ),
    }
    parts = {"upperarm": "arm_{}0_1", "lowerarm": "arm_{}0_3"}
    parts |= {"upperleg": "leg_{}0_1", "lowerleg": "leg_{}0_3"}
    for side in _UPPER:
        table |= {f"{limb}02.{side}": part.format(side) + "_jnt" for limb, part in parts.items()}
        table |= {f"finger1-{k + 1}.{side}": f"thumb_{side}0_{k}_jnt" for k in range(3)}
    return table


RENAMED: dict[str, dict[str, str]] = {
    "joints of fingers are letters": {
        **named(
            "root=root hips;spine04=spine lower;spine02=spine middle;spine01=spine upper;"
            "neck01=head neck lower;head=head neck upper",
            "arm * shoulder 1;arm * shoulder 2;arm * elbow;arm * wrist;leg * thigh;leg * knee;"
            "leg * ankle;leg * toes",
            "-;-;-;-;-",
            ("left", "right"),
        ),
        **_numbered_fingers(
            "arm * finger #", "1a,1b,1c;2a,2b,2c;3a,3b,3c;4a,4b,4c;5a,5b,5c", ("left", "right")
        ),
    },
    "short names in brackets": {
        **named(
            _SPINE_3.format(
                *("NPC Pelvis [Pelv]", "NPC Spine [Spn0]", "NPC Spine1 [Spn1]"),
                *("NPC Spine2 [Spn2]", "NPC Neck [Neck]", "NPC Head [Head]"),
            ),
            "NPC * Clavicle [*Clv];NPC * UpperArm [*Uar];NPC * Forearm [*Lar];NPC * Hand [*Hnd];"
            "NPC * Thigh [*Thg];NPC * Calf [*Clf];NPC * Foot [*ft ];NPC * Toe0 [*Toe]",
            "-;-;-;-;-",
            _UPPER,
        ),
        **_numbered_fingers(
            "NPC * Finger# [*F#]", "00,01,02;10,11,12;20,21,22;30,31,32;40,41,42", _UPPER
        ),
    },
    "halves of limbs by a letter": named(
        _SPINE_3.format("pelvis", "abdomen", "thorax", "torso", "neck", "head"),
        "*_clav;*_uarm;*_larm;*_hand;*_uleg;*_lleg;*_foot;*_toes",
        "*_thumb#;*_ind#;*_mid#;*_ring#;*_lit#",
        LOW,
    ),
    "snapchat": _BITMOJI,
    "snapchat, lower case": {bone: name.lower() for bone, name in _BITMOJI.items()},
    "suffix bone": {
        **named(
            _SPINE_3.format(
                *"HipsBone SpineBone ChestBone UpperChestBone NeckBone HeadBone".split()
            ),
            "*ShoulderBone;*UpperArmBone;*LowerArmBone;*HandBone;*UpperLegBone;*LowerLegBone;"
            "*FootBone;*ToesBone",
            "*ThumbBone#;*IndexBone#;*MiddleBone#;*RingBone#;*LittleBone#",
            WORDS,
        )
    },
    "joints of Maya": named(
        _SPINE_3.format(*(f"spine_0{k}_jnt" for k in range(1, 5)), "neck_jnt", "head_jnt").replace(
            "root=spine_01_jnt", "root=pelvis_jnt"
        ),
        "lf_clavicle_jnt;lf_shoulder_jnt;lf_elbow_jnt;lf_wrist_jnt;lf_hip_jnt;lf_knee_jnt;"
        "lf_ankle_jnt;lf_ball_jnt".replace("lf", "*"),
        "*_thumb_0#_jnt;*_index_0#_jnt;*_middle_0#_jnt;*_ring_0#_jnt;*_pinky_0#_jnt",
        ("lf", "rt"),
    ),
    "duplicated, .001": {bone: f"{name}.001" for bone, name in MIXAMO.items()},
    "counted": _counted(prefixed("mixamorig:", MIXAMO)),
    "character1": prefixed("Character1_", MIXAMO),
    "own prefix and suffix": {b: f"SK_Knight_{n}_def" for b, n in MIXAMO.items()},
    "upper case": named(
        _SPINE_3.format("HIPS", "SPINE", "CHEST", "UPPER_CHEST", "NECK", "HEAD"),
        "*_SHOULDER;*_UPPER_ARM;*_LOWER_ARM;*_HAND;*_UPPER_LEG;*_LOWER_LEG;*_FOOT;*_TOE",
        "*_THUMB_#;*_INDEX_#;*_MIDDLE_#;*_RING_#;*_PINKY_#",
        ("LEFT", "RIGHT"),
    ),
    "upper case, glued": named(
        _SPINE_3.format("HIPS", "SPINE", "CHEST", "UPPERCHEST", "NECK", "HEAD"),
        "*CLAVICLE;*UPPERARM;*FOREARM;*HAND;*THIGH;*CALF;*FOOT;*TOE",
        "*THUMB#;*INDEX#;*MIDDLE#;*RING#;*PINKY#",
        ("LEFT", "RIGHT"),
    ),
    "side in the middle": named(
        _SPINE_3.format("hips", "spine", "chest", "chest.001", "neck", "head"),
        "shoulder.*.bone;arm.*.upper;arm.*.lower;hand.*.bone;leg.*.upper;leg.*.lower;foot.*.bone;"
        "toe.*.bone",
        "thumb.*.#;index.*.#;middle.*.#;ring.*.#;pinky.*.#",
        LOW,
    ),
    "source engine": _biped("ValveBiped.Bip01_", "_"),
    "biped, three digits": _biped("Bip001 ", " "),
    "biped, dashes": _biped("Bip01-", "-"),
    "source engine 2": {
        **named(
            "root=pelvis;spine04=spine_0;spine03=spine_1;spine02=spine_2;spine01=spine_3;"
            "neck01=neck_0;head=head_0",
            "clavicle_*;arm_upper_*;arm_lower_*;hand_*;leg_upper_*;leg_lower_*;ankle_*;ball_*",
            "-;-;-;-;-",
            _UPPER,
        ),
        **with_sides(
            {},
            _UPPER,
            **{
                f"finger{f}-{j}": f"finger_{name}_{j - 1}_*"
                for f, name in enumerate("thumb index middle ring pinky".split(), start=1)
                for j in (1, 2, 3)
            },
            **{
                f"metacarpal{m}": f"finger_{name}_meta_*"
                for m, name in enumerate("index middle ring pinky".split(), start=1)
            },
        ),
    },
    "femur and humerus": {
        **named(
            "root=hips;spine04=spine_0;spine02=spine_1;spine01=spine_2;neck01=neck_0;"
            "neck03=neck_1;head=head",
            "*_arm_clavicle;*_arm_humerus;*_arm_radius;*_arm_wrist;*_leg_femur;*_leg_tibia;"
            "*_leg_ankle;*_leg_ball",
            "-;-;-;-;-",
            LOW,
        ),
        **with_sides(
            {},
            LOW,
            **{
                f"finger{f}-{j}": f"*_hand_{name}_{j - 1}"
                for f, name in enumerate("thumb index middle ring little".split(), start=1)
                for j in (1, 2, 3)
            },
        ),
    },
    "synty": {
        **named(
            _SPINE_3.format("Hips", "Spine_01", "Spine_02", "Spine_03", "Neck", "Head"),
            "Clavicle_*;Shoulder_*;Elbow_*;Hand_*;UpperLeg_*;LowerLeg_*;Ankle_*;Ball_*",
            "-;-;-;-;-",
            _UPPER,
        ),
        **{
            f"finger{f}-{j}.{side}": f"{name}_0{j}{mark}"
            for side, mark in (("L", ""), ("R", " 1"))
            for f, name in ((1, "Thumb"), (2, "IndexFinger"), (3, "Finger"))
            for j in (1, 2, 3)
        },
    },
    "quaternius": named(
        "root=Hips;spine04=Abdomen;spine02=Torso;neck01=Neck;head=Head",
        "Shoulder*;UpperArm*;LowerArm*;Fist*;UpperLeg*;LowerLeg*;Foot*;-",
        "Thumb#*;Index#*;Middle#*;Ring#*;Pinky#*",
        _UPPER,
    ),
    "kaykit": named(
        "root=hips;spine03=spine;spine01=chest;head=head",
        "-;upperarm.*;lowerarm.*;wrist.*;upperleg.*;lowerleg.*;foot.*;toes.*",
        "-;-;-;-;-",
        LOW,
    ),
    "15 bones": named(
        "root=LowerTorso;spine03=UpperTorso;head=Head",
        "-;*UpperArm;*LowerArm;*Hand;*UpperLeg;*LowerLeg;*Foot;-",
        "-;-;-;-;-",
        WORDS,
    ),
    "perception neuron": {
        **named(
            "root=Robot_Hips;spine04=Robot_Spine;spine02=Robot_Spine1;spine01=Robot_Spine2;"
            "neck01=Robot_Neck;neck03=Robot_Neck1;head=Robot_Head",
            "Robot_*Shoulder;Robot_*Arm;Robot_*ForeArm;Robot_*Hand;Robot_*UpLeg;Robot_*Leg;"
            "Robot_*Foot;-",
            "Robot_*HandThumb#;Robot_*HandIndex#;Robot_*HandMiddle#;Robot_*HandRing#;"
            "Robot_*HandPinky#",
            WORDS,
        ),
        **metacarpals("Robot_*InHand#", WORDS),
    },
    "poser": named(
        "root=hip;spine04=abdomen;spine02=chest;neck01=neck;head=head",
        "*Collar;*Shldr;*ForeArm;*Hand;*Thigh;*Shin;*Foot;*Toe",
        "*Thumb#;*Index#;*Mid#;*Ring#;*Pinky#",
        LOW,
    ),
    "joints of a depth camera": named(
        "root=SpineBase;spine03=SpineMid;spine01=SpineShoulder;neck01=Neck;head=Head",
        "-;Shoulder*;Elbow*;Wrist*;Hip*;Knee*;Ankle*;Foot*",
        "-;-;-;-;-",
        WORDS,
    ),
    "h-anim": {
        **named(
            "root=sacroiliac;spine05=vl5;spine04=vl3;spine03=vl1;spine02=vt10;spine01=vt6;"
            "neck01=vc4;head=skullbase",
            "*_sternoclavicular;*_shoulder;*_elbow;*_wrist;*_hip;*_knee;*_ankle;-",
            "*_thumb#;*_index#;*_middle#;*_ring#;*_pinky#",
            LOW,
        ),
    },
    "mb-lab": {
        **named(
            _SPINE_3.format("pelvis", "spine01", "spine02", "spine03", "neck", "head"),
            "clavicle_*;upperarm_*;lowerarm_*;hand_*;thigh_*;calf_*;foot_*;toes_*",
            "thumb0#_*;index0#_*;middle0#_*;ring0#_*;pinky0#_*",
            _UPPER,
        ),
        **metacarpals("#00_*", _UPPER),
    },
    "optitrack": prefixed(
        "Skeleton_001_",
        named(
            "root=Hip;spine03=Ab;spine02=Chest;neck01=Neck;head=Head",
            "*Shoulder;*UArm;*FArm;*Hand;*Thigh;*Shin;*Foot;*Toe",
            "*Thumb#;*Index#;*Middle#;*Ring#;*Pinky#",
            _UPPER,
        ),
    ),
    "numbered limbs": {
        **named(
            "root=torso_joint_1;spine03=torso_joint_2;spine01=torso_joint_3;neck01=neck_joint_1;"
            "head=neck_joint_2",
            "-;-;-;-;-;-;-;-",
            "-;-;-;-;-",
            LOW,
        ),
        **with_sides(
            {},
            _UPPER,
            upperarm01="arm_joint_*__4_",
            lowerarm01="arm_joint_*__3_",
            wrist="arm_joint_*__2_",
            upperleg01="leg_joint_*_1",
            lowerleg01="leg_joint_*_2",
            foot="leg_joint_*_3",
        )
        | {"toe2-1.L": "leg_joint_L_5", "toe2-1.R": "leg_joint_R_5"},
    },
    "godot": {
        **named(
            _SPINE_3.format("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head"),
            "*Shoulder;*UpperArm;*LowerArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toes",
            "-;-;-;-;-",
            WORDS,
        ),
        **with_sides(
            {},
            WORDS,
            **{
                f"finger{f}-{j}": f"*{name}{joint}"
                for f, name in enumerate("Thumb Index Middle Ring Little".split(), start=1)
                for j, joint in enumerate(
                    (
                        "Metacarpal Proximal Distal" if f == 1 else "Proximal Intermediate Distal"
                    ).split(),
                    start=1,
                )
            },
        ),
    },
    "gloves": {
        **named(
            _SPINE_3.format("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head"),
            "*Shoulder;*UpperArm;*LowerArm;*Hand;*UpperLeg;*LowerLeg;*Foot;*Toe",
            "-;-;-;-;-",
            WORDS,
        ),
        **with_sides(
            {},
            WORDS,
            **{
                f"finger{f}-{j}": f"*{name}{joint}"
                for f, name in enumerate("Thumb Index Middle Ring Pinky".split(), start=1)
                for j, joint in enumerate(
                    ("CMC MCP IP" if f == 1 else "MCP PIP DIP").split(), start=1
                )
            },
        ),
    },
    "shoulder 1 and 2": named(
        "root=root hips;spine05=spine lower;spine04=spine middle;spine03=spine upper;"
        "neck01=head neck lower;head=head neck upper",
        "arm * shoulder 1;arm * shoulder 2;arm * elbow;arm * wrist;leg * thigh;leg * knee;"
        "leg * ankle;leg * toes",
        "-;-;-;-;-",
        ("left", "right"),
    ),
    "letters": named(
        "root=HipMaster_01;spine03=TorsoA_01;spine01=TorsoB_01;neck01=NeckA_01;head=Head_01",
        "Clavicle*_01;Shoulder*_01;Elbow*_01;Hand*_01;Hip*_01;Knee*_01;Foot*_01;Toe*_01",
        "-;-;-;-;-",
        ("LT", "RT"),
    ),
    "arm, arm 1, arm 2": named(
        "root=Bip01 Pelvis;spine03=Bip01 Spine;spine01=Bip01 Spine1;neck01=Bip01 Neck;"
        "head=Bip01 Head",
        "Bip01 * Arm;Bip01 * Arm1;Bip01 * Arm2;Bip01 * Hand;Bip01 * Leg;Bip01 * Leg1;"
        "Bip01 * Foot;-",
        "-;-;-;-;-",
        _UPPER,
    ),
    "bones of the skeleton": {
        **named(
            "root=Waist;spine03=Stomach;spine01=Chest;neck01=Neck;head=Head",
            "Clavicle.*;Humerus.*;Ulna.*;Hand.*;Thigh.*;Calf.*;Foot.*;Toe.*",
            "-;-;-;-;-",
            _UPPER,
        ),
        **with_sides(
            {},
            _UPPER,
            **{
                f"finger{f}-{j}": f"{name}{joint}.*"
                for f, name in enumerate(("Thumb", "IndexFinger", "MiddleFinger"), start=1)
                for j, joint in enumerate(("Prox", "Med", "Dist"), start=1)
            },
        ),
    },
    "fingers from 00": {
        **named(
            "root=SKEL_Pelvis;spine04=SKEL_Spine0;spine03=SKEL_Spine1;spine02=SKEL_Spine2;"
            "spine01=SKEL_Spine3;neck01=SKEL_Neck_1;head=SKEL_Head",
            "SKEL_*_Clavicle;SKEL_*_UpperArm;SKEL_*_Forearm;SKEL_*_Hand;SKEL_*_Thigh;SKEL_*_Calf;"
            "SKEL_*_Foot;SKEL_*_Toe0",
            "-;-;-;-;-",
            _UPPER,
        ),
        **_numbered_fingers(
            "SKEL_*_Finger#", "00,01,02;10,11,12;20,21,22;30,31,32;40,41,42", _UPPER
        ),
    },
    "brackets": named(
        "root=NPC Pelvis [Pelv];spine04=NPC Spine [Spn0];spine02=NPC Spine1 [Spn1];"
        "spine01=NPC Spine2 [Spn2];neck01=NPC Neck [Neck];head=NPC Head [Head]",
        "NPC * Clavicle [*Clv];NPC * UpperArm [*Uar];NPC * Forearm [*Lar];NPC * Hand [*Hnd];"
        "NPC * Thigh [*Thg];NPC * Calf [*Clf];NPC * Foot [*ft ];NPC * Toe0 [*Toe]",
        "-;-;-;-;-",
        _UPPER,
    ),
    "biceps": named(
        "root=pelvis;spine04=torso;spine02=torso2;spine01=torso3;neck01=neck;head=head",
        "*_shoulder;*_bicep;*_forearm;*_hand;*_thigh;*_shin;*_foot;*_toe",
        "*_thumb#;*_index#;*_middle#;*_ring#;*_pinky#",
        LOW,
    ),
    "mgear": _mgear(),
    "mgear, limbs of three joints": {
        **named(
            "root=spine_C0_0_jnt;spine03=spine_C0_1_jnt;spine01=spine_C0_2_jnt;"
            "neck01=neck_C0_0_jnt;head=head_C0_0_jnt",
            "shoulder_*0_0_jnt;arm_*0_0_jnt;arm_*0_1_jnt;arm_*0_2_jnt;"
            "leg_*0_0_jnt;leg_*0_1_jnt;leg_*0_2_jnt;foot_*0_0_jnt",
            "-;-;-;-;-",
            _UPPER,
        ),
        **_numbered_fingers(
            "finger_*#_jnt", "0_0,0_1,0_2;1_0,1_1,1_2;2_0,2_1,2_2;3_0,3_1,3_2;4_0,4_1,4_2", _UPPER
        ),
    },
    "fingers that start": {
        **named(
            "root=hips_joint;spine04=spine_1_joint;spine02=spine_4_joint;spine01=spine_7_joint;"
            "neck01=neck_1_joint;head=head_joint",
            "*_shoulder_1_joint;*_arm_joint;*_forearm_joint;*_hand_joint;*_upLeg_joint;"
            "*_leg_joint;*_foot_joint;*_toes_joint",
            "-;*_handIndex_#_joint;*_handMid_#_joint;*_handRing_#_joint;*_handPinky_#_joint",
            ("left", "right"),
        ),
        **_numbered_fingers("*_handThumb#_joint", "Start,_1,_2", ("left", "right")),
        **{
            f"metacarpal{k}.{side[0].upper()}": f"{side}_hand{finger}Start_joint"
            for side in ("left", "right")
            for k, finger in enumerate(("Index", "Mid", "Ring", "Pinky"), start=1)
        },
    },
}
