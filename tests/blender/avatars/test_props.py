# SPDX-License-Identifier: GPL-3.0-or-later
"""Props held or carried by an avatar are no skin; hands, gloves and clothes are skin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.retargeting import props

bpy = pytest.importorskip("bpy")
import bmesh  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from own_avatar import mark, opened  # noqa: E402

from hfx_blender.avatars import avatar_meshes, bodies, bone_table, stored_fits  # noqa: E402

HAND = "mixamorig:RightHand"
HEAD = "mixamorig:Head"


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    return opened()


def joint(rig: Any, bone: str) -> Any:
    return rig.data.bones[bone].head_local.copy()


def add_bone(rig: Any, name: str, parent: str) -> str:
    """Add a bone outside of the body to the rig, at the location of an existing bone."""
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new(name)
    bone.parent = rig.data.edit_bones[parent]
    bone.head = bone.parent.head
    bone.tail = bone.head + Vector((0.0, 0.0, 0.1))
    bpy.ops.object.mode_set(mode="OBJECT")
    return name


def box(name: str, middle: Any, size: Any) -> Any:
    """A closed box, cut into quads of about 3 cm."""
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=1.0, matrix=Matrix.Diagonal((*size, 1.0)))
    long = [edge for edge in shape.edges if edge.calc_length() > 0.06]
    bmesh.ops.subdivide_edges(shape, edges=long, cuts=10, use_grid_fill=True)
    bmesh.ops.translate(shape, vec=middle, verts=shape.verts)
    mesh = bpy.data.meshes.new(name)
    shape.to_mesh(mesh)
    shape.free()
    created = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(created)
    return created


def skinned(obj: Any, rig: Any, bone: str) -> Any:
    group = obj.vertex_groups.new(name=bone)
    group.add(range(len(obj.data.vertices)), 1.0, "REPLACE")
    obj.parent = rig
    obj.modifiers.new("Armature", "ARMATURE").object = rig
    bpy.context.view_layer.update()
    return obj


def palm(rig: Any) -> Any:
    return joint(rig, "mixamorig:RightHandMiddle1")


def sword(rig: Any, bone: str) -> Any:
    """1.1 m long, through the palm, forwards."""
    middle = palm(rig) + Vector((0.0, -0.45, -0.03))
    return skinned(box("Sword", middle, (0.04, 1.1, 0.04)), rig, bone)


def found(rig: Any, *meshes: Any) -> tuple[list[Any], list[Any]]:
    targets = [avatar_meshes.read_mesh(rig, mesh) for mesh in meshes]
    return props.without_props(load_avatar(), targets, bone_table.mapping_of(rig))


PROPS: dict[str, tuple[str, str, tuple[float, ...], tuple[float, ...]]] = {
    "sword on a bone of its own": ("Weapon", HAND, (0.0, -0.45, -0.03), (0.04, 1.1, 0.04)),
    "sword on the hand": (HAND, "", (0.0, -0.45, -0.03), (0.04, 1.1, 0.04)),
    "dagger on the hand": (HAND, "", (0.0, -0.1, -0.03), (0.03, 0.34, 0.02)),
    "shield on the forearm": ("mixamorig:RightForeArm", "", (0.2, -0.1, 0.0), (0.6, 0.03, 0.6)),
    "gun for two hands": (HAND, "", (0.1, -0.2, -0.03), (0.06, 0.7, 0.15)),
    "backpack": ("Backpack", "mixamorig:Spine2", (0.7, 0.3, -0.1), (0.3, 0.25, 0.45)),
    "wings": ("Wing", "mixamorig:Spine2", (0.7, 0.4, 0.1), (1.5, 0.4, 0.02)),
    "tail": ("Tail", "mixamorig:Hips", (0.7, 0.45, -0.4), (0.08, 0.6, 0.08)),
}
"""Bone, parent of a bone that is added, place beside the palm, size, metres."""


@pytest.mark.parametrize("name", PROPS)
def test_what_is_held_or_carried_is_no_skin(anna: tuple[Any, Any], name: str) -> None:
    rig, skin = anna
    bone, parent, offset, size = PROPS[name]
    middle = palm(rig) + Vector(offset)
    if parent in ("mixamorig:Spine2", "mixamorig:Hips"):
        middle.x = 0.0
    bone = add_bone(rig, bone, parent) if parent else bone
    held = skinned(box("Held", middle, size), rig, bone)
    (body, rest), (prop,) = found(rig, skin, held)
    assert len(body.triangles) == len(avatar_meshes.read_mesh(rig, skin).triangles)
    assert not len(rest.triangles)
    assert (prop.mesh, prop.bone, prop.share) == (1, bone, pytest.approx(1.0))


def test_a_loose_piece_of_the_skins_mesh_is_left_out_too(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    alone = avatar_meshes.read_mesh(rig, skin)
    held = sword(rig, add_bone(rig, "Socket", HAND))
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in (skin, held))
    bpy.context.view_layer.objects.active = skin
    bpy.ops.object.join()
    (target,), (prop,) = found(rig, skin)
    np.testing.assert_array_equal(target.triangles, alone.triangles)
    assert prop.bone == "Socket" and 0.01 < prop.share < 0.2


@pytest.mark.parametrize("selects_all", [False, True])
def test_the_fit_is_that_without_the_sword_and_the_report_names_it(
    anna: tuple[Any, Any], capfd: pytest.CaptureFixture[str], selects_all: bool
) -> None:
    rig, skin = anna
    mark(rig, skin)
    before = np.asarray(stored_fits.fitted_model(rig, "hfx-pressure-1").vertices)
    rig.hfx.role, rig.hfx.avatar = "NONE", None
    held = [sword(rig, add_bone(rig, "Weapon", HAND))]
    hung = box("Shield", joint(rig, HAND) + Vector((0.5, 0.5, 0.0)), (0.5, 0.02, 0.5))
    hung.constraints.new("CHILD_OF").target = rig
    mark(rig, *((skin, *held, hung) if selects_all else ()))
    assert avatar_meshes.meshes_of(rig) == [skin]
    after = np.asarray(stored_fits.fitted_model(rig, "hfx-pressure-1").vertices)
    np.testing.assert_array_equal(after, before)
    names = "'Sword' and 'Shield'" if selects_all else "'Sword'"
    assert f"left out, as they show no skin: {names}" in capfd.readouterr().out


def cut(skin: Any, name: str, is_wanted: Any) -> Any:
    """Separate the faces with given strongest bones into a new mesh."""
    names = {group.index: group.name for group in skin.vertex_groups}
    expected = [
        is_wanted(names[max(vertex.groups, key=lambda each: each.weight).group], vertex.co)
        for vertex in skin.data.vertices
    ]
    part = skin.copy()
    part.data, part.name = skin.data.copy(), name
    bpy.context.scene.collection.objects.link(part)
    for obj, is_out in ((skin, True), (part, False)):
        mesh = bmesh.new()
        mesh.from_mesh(obj.data)
        out = [face for face in mesh.faces if expected[face.verts[0].index] == is_out]
        bmesh.ops.delete(mesh, geom=out, context="FACES")
        mesh.to_mesh(obj.data)
        mesh.free()
    return part


def is_right_hand(_bone: str, place: Any) -> bool:
    """Beyond the right wrist of the T-pose."""
    return bool(place.x < -0.635)


def rigid(part: Any, bone: str) -> None:
    part.vertex_groups.clear()
    part.vertex_groups.new(name=bone).add(range(len(part.data.vertices)), 1.0, "REPLACE")


@pytest.mark.parametrize("bone", [HAND, "Paw"])
@pytest.mark.parametrize("scale", [0.6, 1.0, 2.5])
def test_a_hand_that_is_a_mesh_of_its_own_is_skin(
    anna: tuple[Any, Any], bone: str, scale: float
) -> None:
    rig, skin = anna
    hand = cut(skin, "Hand", is_right_hand)
    rigid(hand, add_bone(rig, bone, HAND) if bone == "Paw" else bone)
    wrist = joint(rig, HAND)
    for vertex in hand.data.vertices:
        vertex.co = wrist + scale * (vertex.co - wrist)
    _, left_out = found(rig, skin, hand)
    assert not left_out
    held = sword(rig, HAND)
    targets, (prop,) = found(rig, skin, hand, held)
    assert prop.mesh == 2 and len(targets[1].triangles)


def worn(skin: Any, name: str, is_wanted: Any, distance: float, bone: str) -> Any:
    part = skin.copy()
    part.data, part.name = skin.data.copy(), f"{name} Source"
    bpy.context.scene.collection.objects.link(part)
    over = cut(part, name, is_wanted)
    bpy.data.objects.remove(part)
    over.data.update()
    normals = [vertex.normal.copy() for vertex in over.data.vertices]
    for vertex, normal in zip(over.data.vertices, normals, strict=True):
        vertex.co += distance * normal
    rigid(over, bone)
    return over


def test_gloves_sleeves_hats_and_clothes_on_bones_of_their_own_are_none(
    anna: tuple[Any, Any],
) -> None:
    rig, skin = anna
    meshes = [
        worn(skin, "Glove", is_right_hand, 0.01, HAND),
        worn(
            skin,
            "Bracer",
            lambda bone, _place: "RightForeArm" in bone,
            0.02,
            "mixamorig:RightForeArm",
        ),
    ]
    head = joint(rig, HEAD)
    hat = box("Hat", head + Vector((0.0, 0.0, 0.3)), (0.5, 0.5, 0.2))
    meshes.append(skinned(hat, rig, add_bone(rig, "Hat", HEAD)))
    hips = joint(rig, "mixamorig:Hips")
    cape = box("Cape", hips + Vector((0.0, 0.35, 0.0)), (0.6, 0.02, 0.9))
    meshes.append(skinned(cape, rig, add_bone(rig, "Cape_01", "mixamorig:Spine2")))
    skirt = box("Skirt", hips + Vector((0.0, 0.0, -0.3)), (0.7, 0.7, 0.5))
    meshes.append(skinned(skirt, rig, "mixamorig:Hips"))
    _, left_out = found(rig, skin, *meshes)
    assert not left_out
    assert finish_names(rig)[0] == "Anna Skin"


def finish_names(rig: Any) -> list[str]:
    from hfx_blender.engine.stepwise import finish

    for obj in bpy.context.scene.objects:
        obj.select_set(obj == rig)
    return [mesh.name for mesh in finish(bodies.choosing_meshes(bpy.context, rig))]
