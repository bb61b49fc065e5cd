# SPDX-License-Identifier: GPL-3.0-or-later
"""VRM's table of human bones has priority, in each form of storage on an armature."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from hfx_blender.engine.body.rigs.rig import canonical_heads, canonical_parents

bpy = pytest.importorskip("bpy")

from hfx_blender.avatars import bone_table  # noqa: E402

# Canonical bone -> human bone of VRM 1.0.
HUMAN = {
    "root": "hips",
    "spine04": "spine",
    "spine02": "chest",
    "neck01": "neck",
    "head": "head",
    **{
        f"{bone}.{side}": f"{word}{human}"
        for side, word in (("L", "left"), ("R", "right"))
        for bone, human in (
            ("clavicle", "Shoulder"),
            ("upperarm01", "UpperArm"),
            ("lowerarm01", "LowerArm"),
            ("wrist", "Hand"),
            ("upperleg01", "UpperLeg"),
            ("lowerleg01", "LowerLeg"),
            ("foot", "Foot"),
            ("finger1-1", "ThumbMetacarpal"),
            ("finger1-2", "ThumbProximal"),
            ("finger1-3", "ThumbDistal"),
            ("finger4-1", "RingProximal"),
            ("finger4-2", "RingIntermediate"),
        )
    },
}
VRM_0 = {"Metacarpal": "Proximal", "Proximal": "Intermediate"}


def of_vrm_0(human: str) -> str:
    """The name in VRM 0.x, with different words for the joints of the thumb."""
    for new, old in VRM_0.items():
        if "Thumb" in human and human.endswith(new):
            return human.removesuffix(new) + old
    return human


def snake(human: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in human)


@pytest.fixture
def rig(scene: Any) -> tuple[Any, dict[str, str]]:
    """An armature with meaningless or misleading bone names."""
    names = {bone: f"node{k}" for k, bone in enumerate(HUMAN)}
    names["lowerleg01.L"], names["lowerleg01.R"] = "right hand", "left hand"
    armature = bpy.data.objects.new("Model", bpy.data.armatures.new("Model"))
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    parents, heads = canonical_parents(), canonical_heads()
    for bone, name in names.items():
        created = armature.data.edit_bones.new(name)
        created.head, created.tail = heads[bone], heads[bone] + (0.0, 0.0, 0.02)
        above = parents[bone]
        while above is not None and above not in names:
            above = parents[above]
        created.parent = armature.data.edit_bones[names[above]] if above else None
    bpy.ops.object.mode_set(mode="OBJECT")
    return armature, names


def _with_uuids(armature: Any) -> dict[str, dict[str, str]]:
    for bone in armature.data.bones:
        bone["vrm_addon_extension"] = {"uuid": f"id of {bone.name}"}
    return {bone.name: {"bone_uuid": f"id of {bone.name}"} for bone in armature.data.bones}


def stored_by_the_add_on_1(armature: Any, names: dict[str, str]) -> None:
    nodes = _with_uuids(armature)
    rows = {snake(human): {"node": nodes[names[bone]]} for bone, human in HUMAN.items()}
    armature.data["vrm_addon_extension"] = {
        "spec_version": "1.0",
        "vrm1": {"humanoid": {"human_bones": {**rows, "jaw": {"node": {"bone_uuid": ""}}}}},
    }


def stored_by_the_add_on_0(armature: Any, names: dict[str, str]) -> None:
    nodes = _with_uuids(armature)
    rows = [{"bone": of_vrm_0(human), "node": nodes[names[bone]]} for bone, human in HUMAN.items()]
    armature.data["vrm_addon_extension"] = {"vrm0": {"humanoid": {"human_bones": rows}}}


def kept_extension_1(armature: Any, names: dict[str, str]) -> None:
    rows = {human: {"node": names[bone]} for bone, human in HUMAN.items()}
    armature["VRMC_vrm"] = json.dumps({"humanoid": {"humanBones": rows}})


def kept_extension_0(armature: Any, names: dict[str, str]) -> None:
    rows = [{"bone": of_vrm_0(human), "node": names[bone]} for bone, human in HUMAN.items()]
    armature.data["extensions"] = {"VRM": {"humanoid": {"humanBones": rows}}}


def custom_properties(armature: Any, names: dict[str, str]) -> None:
    for bone, human in HUMAN.items():
        armature.data[of_vrm_0(human)] = names[bone]


@pytest.mark.parametrize(
    "store",
    [
        stored_by_the_add_on_1,
        stored_by_the_add_on_0,
        kept_extension_1,
        kept_extension_0,
        custom_properties,
    ],
)
def test_the_table_is_believed_before_names(
    rig: tuple[Any, dict[str, str]], store: Callable[[Any, dict[str, str]], None]
) -> None:
    armature, names = rig
    store(armature, names)
    mapping = bone_table.detected_mapping(armature)
    assert mapping.bones == names
    assert mapping.convention == "vrm"


@pytest.fixture
def add_on() -> Iterator[None]:
    """A stand-in with the properties registered by the add-on."""
    node = type("Node", (bpy.types.PropertyGroup,), {})
    node.__annotations__ = {"bone_name": bpy.props.StringProperty()}
    row = type("Row", (bpy.types.PropertyGroup,), {})
    row.__annotations__ = {"node": bpy.props.PointerProperty(type=node)}
    table = type("Table", (bpy.types.PropertyGroup,), {})
    table.__annotations__ = {
        snake(human): bpy.props.PointerProperty(type=row) for human in HUMAN.values()
    }
    humanoid = type("Humanoid", (bpy.types.PropertyGroup,), {})
    humanoid.__annotations__ = {"human_bones": bpy.props.PointerProperty(type=table)}
    vrm = type("Vrm1", (bpy.types.PropertyGroup,), {})
    vrm.__annotations__ = {"humanoid": bpy.props.PointerProperty(type=humanoid)}
    extension = type("Extension", (bpy.types.PropertyGroup,), {})
    extension.__annotations__ = {
        "vrm1": bpy.props.PointerProperty(type=vrm),
        "spec_version": bpy.props.StringProperty(default="1.0"),
    }
    kinds = (node, row, table, humanoid, vrm, extension)
    for kind in kinds:
        bpy.utils.register_class(kind)
    bpy.types.Armature.vrm_addon_extension = bpy.props.PointerProperty(type=extension)
    yield
    del bpy.types.Armature.vrm_addon_extension
    for kind in reversed(kinds):
        bpy.utils.unregister_class(kind)


def test_the_installed_add_on_is_asked(add_on: None, rig: tuple[Any, dict[str, str]]) -> None:
    armature, names = rig
    table = armature.data.vrm_addon_extension.vrm1.humanoid.human_bones
    for bone, human in HUMAN.items():
        getattr(table, snake(human)).node.bone_name = names[bone]
    assert bone_table.detected_mapping(armature).bones == names


def test_a_table_of_bones_that_are_gone_is_not_used(rig: tuple[Any, dict[str, str]]) -> None:
    armature, names = rig
    custom_properties(armature, dict.fromkeys(names, "gone"))
    assert bone_table.human_bones_of(armature) == {}
