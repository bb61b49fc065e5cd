# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone mapping of avatars: names of each convention against counterparts written by hand."""

from __future__ import annotations

import json
import os
import random
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from renamed_rigs import RENAMED
from rig_conventions import (
    ARP,
    CONVENTIONS,
    FINGERS,
    LIMBS,
    LOW,
    MIXAMO,
    MMD,
    WORDS,
    rig_of,
    with_sides,
)

from hfx_blender.engine.body.rigs import mapping as bone_mapping
from hfx_blender.engine.body.rigs.mapping import BoneMapping, RigBone
from hfx_blender.engine.body.rigs.names import read_names
from hfx_blender.engine.body.rigs.rig import canonical_heads, canonical_parents
from hfx_blender.errors import InputError
from hfx_tools.body_building import source


def _check_complete(mapping: BoneMapping) -> None:
    assert mapping.bones.keys() | mapping.fallbacks.keys() == canonical_parents().keys()
    assert not mapping.bones.keys() & mapping.fallbacks.keys()


@pytest.mark.parametrize("case", CONVENTIONS)
def test_convention_is_mapped_as_by_hand(case: str) -> None:
    convention, table, more = CONVENTIONS[case]
    bones = rig_of(table, more)
    random.Random(1).shuffle(bones)
    mapping = bone_mapping.map_bones(bones)
    assert mapping.bones == table
    assert mapping.convention == convention
    _check_complete(mapping)


@pytest.mark.parametrize("case", RENAMED)
def test_renamed_rig_is_mapped_as_by_hand(case: str) -> None:
    bones = rig_of(RENAMED[case])
    random.Random(2).shuffle(bones)
    assert bone_mapping.map_bones(bones).bones == RENAMED[case]


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
    ],
)  # fmt: skip
def test_look_alikes_are_not_joints(name: str) -> None:
    assert read_names([name]) == {}


def _rigify_rig() -> list[RigBone]:
    """Return a generated rig as in Blender 4.5: split limbs hang on non-deforming bones."""
    table = {
        bone: f"DEF-{name}"
        for bone, name in with_sides(
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
    bones = {bone.name: bone for bone in rig_of(table)}
    for bone in list(bones.values()):
        original = bone.name.replace("DEF-", "ORG-")
        above = bone.parent and bone.parent.replace("DEF-", "ORG-")
        bones[original] = replace(bone, name=original, parent=above)
        if ".001" not in bone.name and "spine" not in bone.name and bone.parent:
            bones[bone.name] = replace(bone, parent=above)
        bones[bone.name[4:]] = replace(bone, name=bone.name[4:], parent=above)
    for side in "LR":  # split in the middle: unlike the canonical bone's start at 0.29
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
    bones = rig_of(table)
    controls = [  # of the same names but for their separators, and higher up
        replace(bone, name=bone.name.replace("left", "left_"), parent=None, deform=False)
        for bone in bones
        if bone.name.startswith("left")
    ]
    assert bone_mapping.map_bones([*controls, *bones]).bones == table


def test_a_rig_none_of_whose_bones_deform_is_still_mapped() -> None:
    bones = [replace(bone, deform=False) for bone in rig_of(MIXAMO)]
    assert bone_mapping.map_bones(bones).bones == MIXAMO


@pytest.mark.parametrize("seed", range(3))
def test_remains_of_another_rig_are_ignored(seed: int) -> None:
    names = ("upperarm01", "lowerarm01", "upperleg01", "wrist", "foot")
    left_over = [(f"{name}.{side}", "Hips") for name in names for side in "LR"]
    bones = rig_of(MIXAMO, [*left_over, ("spine01", "Hips"), ("root", None)])
    random.Random(seed).shuffle(bones)
    mapping = bone_mapping.map_bones(bones)
    main = [f"{bone}.{side}" for bone in LIMBS[1:7] for side in "LR"]
    assert {name: mapping.bones[name] for name in main} == {n: MIXAMO[n] for n in main}


def test_the_skin_bone_of_two_at_one_joint_is_taken() -> None:
    legs = ("足", "ひざ", "足首")
    copies: list[tuple[str, str | None]] = []
    for side in "左右":
        above = "下半身"
        for name in legs:
            copies.append((f"{side}{name}D", above))
            above = f"{side}{name}D"
    table = dict(MMD)
    for bone, name in MMD.items():
        if name[1:] in legs:
            table[bone] = f"{name}D"
    bones = rig_of(MMD, copies)
    places = {bone.name: (bone.head, bone.tail) for bone in bones}
    bones = [
        replace(bone, head=places[bone.name[:-1]][0], tail=places[bone.name[:-1]][1])
        if bone.name.endswith("D")
        else bone
        for bone in bones
    ]
    assert bone_mapping.map_bones(bones).bones == table


def test_a_limb_whose_first_half_is_named_a_twist_bone_begins_there() -> None:
    bones = {bone.name: bone for bone in rig_of(ARP)}
    table = dict(ARP)
    for side in LOW:
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
        assert bone_mapping.map_bones(rig_of(table)).bones == table


def test_a_misspelt_joint_is_the_only_child_of_the_one_above() -> None:
    table = {
        bone: name.replace("foot", "foor") for bone, name in CONVENTIONS["plain, glued"][1].items()
    }
    assert bone_mapping.map_bones(rig_of(table)).bones == table
    bones = [bone for bone in rig_of(table) if bone.name != "leftfoor"]
    one_sided = bone_mapping.map_bones(bones)  # unreliable
    assert {"foot.L", "foot.R"} <= one_sided.fallbacks.keys()


def test_the_trunk_never_follows_a_limb() -> None:
    table = {bone: name for bone, name in MIXAMO.items() if bone != "root"}
    bones = [replace(b, parent=None) if b.parent == "Hips" else b for b in rig_of(table)]
    mapping = bone_mapping.map_bones(bones)
    assert mapping.fallbacks["root"] == "Spine"
    assert mapping.fallbacks["spine05"] == "Spine"


def test_a_separate_twist_bone_is_no_limb_bone() -> None:
    _, table, _ = CONVENTIONS["unreal 4"]
    middle = canonical_heads()["lowerarm02.L"]
    beside = RigBone("lowerarm_twist_01_l", "lowerarm_l", tuple(middle), tuple(middle))
    mapping = bone_mapping.map_bones([*rig_of(table), beside])
    assert mapping.bones == table
    assert mapping.fallbacks["lowerarm02.L"] == "lowerarm_l"


def test_missing_fingers_toes_and_face_follow_their_parents_and_are_reported() -> None:
    table = {
        bone: name
        for bone, name in MIXAMO.items()
        if "finger4" not in bone and bone not in ("finger3-3.L", "toe2-1.R", "clavicle.R")
    }
    mapping = bone_mapping.map_bones(rig_of(table))
    assert mapping.bones == table
    assert mapping.fallbacks["finger4-2.L"] == "LeftHand"
    assert mapping.fallbacks["finger3-3.L"] == "LeftHandMiddle2"
    assert mapping.fallbacks["toe3-1.R"] == "RightFoot"
    assert mapping.fallbacks["clavicle.R"] == "Spine2"
    assert mapping.fallbacks["oris02"] == "Head"
    assert mapping.fallbacks["lowerarm02.L"] == "LeftForeArm"
    text = "\n".join(mapping.report)
    ring = "the left and right ring finger; the skin there follows 'LeftHand' and 'RightHand'."
    assert ring in text
    assert "1 of 3 joints of the left middle finger" in text
    assert "the right collar bone" in text
    toes = "toes of the left and right foot; the skin there follows 'LeftToeBase' and 'RightFoot'"
    assert toes in text
    assert "left collar" not in text
    _check_complete(mapping)


def test_fingers_named_by_letters_only_stay_unmapped() -> None:
    table = {bone: name for bone, name in MIXAMO.items() if "finger" not in bone}
    letters = {
        f"finger{finger}-{joint}.{side}": f"{word}_finger_{'ABDEG'[finger - 1]}_{joint}"
        for finger in range(1, 6)
        for joint in (1, 2, 3)
        for side, word in (("L", "Left"), ("R", "Right"))
    }
    mapping = bone_mapping.map_bones(rig_of(table | letters))
    assert mapping.bones == table
    assert any("thumb, index" in sentence for sentence in mapping.report)


def test_a_mitten_moves_all_fingers_but_the_thumb() -> None:
    table = {b: n for b, n in MIXAMO.items() if b[:7] not in ("finger3", "finger4", "finger5")}
    mapping = bone_mapping.map_bones(rig_of(table))
    assert mapping.fallbacks["finger5-2.R"] == "RightHandIndex2"
    assert mapping.fallbacks["metacarpal3.R"] == "RightHand"


def test_four_joints_begin_at_the_wrist_or_end_at_the_tip() -> None:
    names = rig_of(MIXAMO, [("LeftHandIndex4", "LeftHandIndex3")])
    assert bone_mapping.map_bones(names).bones["finger2-3.L"] == "LeftHandIndex3"
    palm = {
        f"metacarpal1.{side}": f"{word}HandIndex1" for side, word in zip("LR", WORDS, strict=True)
    }
    table = MIXAMO | palm
    for side, word in zip("LR", WORDS, strict=True):
        table |= {f"finger2-{j}.{side}": f"{word}HandIndex{j + 1}" for j in (1, 2, 3)}
    assert bone_mapping.map_bones(rig_of(table)).bones == table


def test_upper_body_alone_is_a_partial_human() -> None:
    table = {
        b: n for b, n in MIXAMO.items() if not b.startswith(("upperleg", "lowerleg", "foot", "toe"))
    }
    bones = rig_of(table)
    mapping = bone_mapping.map_bones(bones)
    assert mapping.bones["wrist.R"] == "RightHand"
    assert mapping.fallbacks["lowerleg01.L"] == "Hips"
    assert "No bone for the left and right thigh; the skin there follows 'Hips'." in mapping.report


def test_a_second_head_and_four_arms_are_reported() -> None:
    table = {bone: name for bone, name in MIXAMO.items() if "finger" not in bone}
    bones = rig_of(table)
    (arm,) = (bone for bone in bones if bone.name == "LeftHand")
    (head,) = (bone for bone in bones if bone.name == "Head")

    def shifted(bone: RigBone, name: str, parent: str, way: tuple[float, float, float]) -> RigBone:
        ends = (tuple(np.add(end, way)) for end in (bone.head, bone.tail))
        return RigBone(name, parent, *ends)

    more = [
        shifted(head, "Head2", "Neck", (0.3, 0.0, 0.0)),
        shifted(arm, "LeftHand2", "Spine", (0.0, 0.0, -0.4)),
        shifted(head, "Head_ik", "Neck", (0.3, 0.0, 0.0)),
    ]
    mapping = bone_mapping.map_bones([*bones, *more])
    assert "Further heads or limbs ('LeftHand2' and 'Head2') are not felt." in mapping.report
    assert not any("Further" in text for text in bone_mapping.map_bones(bones).report)


def test_mirrored_names_are_mapped_by_where_they_lie() -> None:
    mirrored = [
        replace(bone, head=(-bone.head[0], *bone.head[1:]), tail=(-bone.tail[0], *bone.tail[1:]))
        for bone in rig_of(MIXAMO)
    ]
    mapping = bone_mapping.map_bones(mirrored)
    assert mapping.bones["upperarm01.L"] == "RightArm"
    assert mapping.bones["finger3-2.R"] == "LeftHandMiddle2"
    assert mapping.bones["head"] == "Head"
    assert any("mirrored" in sentence for sentence in mapping.report)
    assert not any("mirrored" in s for s in bone_mapping.map_bones(rig_of(MIXAMO)).report)


@pytest.mark.parametrize("ends_in", ["foot", "lowerleg01"])
def test_the_skin_of_feet_reveals_mirrored_names_without_toes(ends_in: str) -> None:
    gone = ("toe",) if ends_in == "foot" else ("toe", "foot")
    table = {bone: name for bone, name in MIXAMO.items() if not bone.startswith(gone)}
    swapped = {"L": "R", "R": "L"}
    mirrored = {
        bone[:-1] + swapped[bone[-1]] if bone[-2:-1] == "." else bone: name
        for bone, name in table.items()
    }
    heads = canonical_heads()

    def skin_of(rig: dict[str, str], forward: float) -> dict[str, np.ndarray]:
        skin = {}
        for side in "LR":
            ankle, knee = heads[f"foot.{side}"], heads[f"lowerleg01.{side}"]
            calf = np.linspace(knee, ankle, 9)
            sole = ankle + np.outer(np.linspace(-0.05, 0.2, 6) * forward, (0.0, -1.0, 0.0))
            skin[rig[f"{ends_in}.{side}"]] = np.concatenate((calf, sole - (0.0, 0.0, 0.08)))
        return skin

    for rig, forward, side in ((table, 1.0, "L"), (mirrored, 1.0, "L"), (mirrored, 0.1, "R")):
        mapping = bone_mapping.map_bones(rig_of(rig), skin=partial(skin_of, rig, forward))
        assert mapping.bones["upperarm01.L"] == rig[f"upperarm01.{side}"]
        is_mirrored = any("mirrored" in sentence for sentence in mapping.report)
        assert is_mirrored == (rig is mirrored and side == "L")


def _moved(bones: list[RigBone], matrix: np.ndarray) -> list[RigBone]:
    return [
        replace(b, head=tuple(matrix @ b.head + 3.0), tail=tuple(matrix @ b.tail + 3.0))
        for b in bones
    ]


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_a_turned_rig_is_mapped_equally(scale: float) -> None:
    still = rig_of(MIXAMO)
    expected = bone_mapping.map_bones(still)
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    bones = _moved(still, turn * scale)
    mapping = bone_mapping.map_bones(bones)
    assert mapping == expected


def _nameless(table: dict[str, str]) -> tuple[list[RigBone], dict[str, str]]:
    called = {name: f"Bone.{k:03d}" for k, name in enumerate(sorted(set(table.values())))}
    bones = [
        replace(b, name=called[b.name], parent=b.parent and called[b.parent]) for b in rig_of(table)
    ]
    return bones, {canonical: called[name] for canonical, name in table.items()}


@pytest.mark.parametrize("turned", [False, True])
def test_nameless_human_is_found_by_its_shape(turned: bool) -> None:
    bones, expected = _nameless({b: n for b, n in MIXAMO.items()})
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
    """Return four legs reaching down from a horizontal spine."""
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
def test_a_non_human_rig_is_refused_in_one_sentence(bones: list[RigBone]) -> None:
    with pytest.raises(InputError, match="looked for hips or a spine"):
        bone_mapping.map_bones(bones)


def test_feet_without_toes_leave_a_nameless_rig_undecided() -> None:
    bones, _ = _nameless({b: n for b, n in MIXAMO.items() if not b.startswith("toe")})
    with pytest.raises(InputError):
        bone_mapping.map_bones(bones)


def test_nameless_hip_joints_are_not_taken_for_thighs() -> None:
    """Legs of five bones from the midline: a hip joint, not an extra bone at the toes."""
    bones, _ = _nameless(MIXAMO | {"pelvis.L": "HipL", "pelvis.R": "HipR"})
    with pytest.raises(InputError):
        bone_mapping.map_bones(bones)


def test_corrections() -> None:
    mapping = bone_mapping.map_bones(rig_of(MIXAMO))
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
    table = {bone: name.replace("Left", "Linke_ä ") for bone, name in MIXAMO.items()}
    mapping = replace(bone_mapping.map_bones(rig_of(MIXAMO)), bones=table)
    text = bone_mapping.to_json(mapping)
    assert bone_mapping.from_json(text) == mapping
    assert bone_mapping.to_json(bone_mapping.from_json(text)) == text
    document = json.loads(text)
    for fault in (
        {"version": 2}, {"format": "other"}, {"bones": [1]}, {"bones": {"root": 3}},
        {"fallbacks": None}, {"report": 5}, {"bones": {"nose": "Nose"}}, {"version": "x"},
    ):  # fmt: skip
        with pytest.raises(InputError):
            bone_mapping.from_json(json.dumps(document | fault))
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
    document = json.loads((_installed_rigs() / file).read_text(encoding="utf-8"))
    bones = [
        RigBone(
            name,
            bone.get("parent") or None,
            tuple(bone["head"]["default_position"]),
            tuple(bone["tail"]["default_position"]),
        )
        for name, bone in document.get("bones", document).items()
        if isinstance(bone, dict) and "head" in bone
    ]
    mapping = bone_mapping.map_bones(bones)
    assert mapping.convention == convention
    assert len(mapping.bones) == mapped
    if convention == "makehuman default":
        assert all(canonical == name for canonical, name in mapping.bones.items())
