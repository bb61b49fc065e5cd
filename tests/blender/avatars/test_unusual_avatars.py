# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars without a single skin: read by bones, read in another orientation, or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.rigs.rig import canonical_heads
from hfx_blender.engine.scene import SkinBinding
from hfx_blender.engine.stepwise import finish

bpy = pytest.importorskip("bpy")
import bmesh  # noqa: E402
from mathutils import Vector  # noqa: E402
from own_avatar import mark, opened  # noqa: E402

from hfx_blender.avatars import avatar_meshes, bodies, body_binding, stored_fits  # noqa: E402

MODEL_ID = "hfx-temperature-1"
LIMBS = ("Arm", "ForeArm", "UpLeg", "Leg", "Foot")


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    return opened()


def in_shards(skin: Any) -> None:
    """Split a mesh into one piece for each face, with gaps between neighbouring faces."""
    mesh = bmesh.new()
    mesh.from_mesh(skin.data)
    bmesh.ops.split_edges(mesh, edges=mesh.edges[:])
    for face in mesh.faces:
        for vertex in face.verts:
            vertex.co += 0.01 * face.normal
    mesh.to_mesh(skin.data)
    mesh.free()


def with_fins(skin: Any) -> None:
    """A third face on an edge of each face."""
    mesh = bmesh.new()
    mesh.from_mesh(skin.data)
    mesh.verts.ensure_lookup_table()
    for face in mesh.faces[:]:
        if mesh.verts[0] not in face.verts:
            mesh.faces.new([face.verts[0], face.verts[1], face.verts[3], mesh.verts[0]])
    mesh.to_mesh(skin.data)
    mesh.free()


def fitted(rig: Any) -> np.ndarray:
    return np.asarray(stored_fits.fitted_model(rig, MODEL_ID).vertices, np.float64)


def off_the_joints(rig: Any) -> list[float]:
    """Distance of each limb part's middle from the middle of the part's two joints, metres."""
    model, actual = load_model(MODEL_ID), []
    points = fitted(rig)
    for part, bone, end in (
        ("forearm", "ForeArm", "Hand"),
        ("lower_leg", "Leg", "Foot"),
        ("upper_arm", "Arm", "ForeArm"),
    ):
        for side, word in ((1, "Left"), (-1, "Right")):
            ends = [rig.data.bones[f"mixamorig:{word}{name}"].head_local for name in (bone, end)]
            mine = (model.part == PARTS.index(part)) & (np.sign(points[:, 0]) == side)
            middle = (points[mine].max(axis=0) + points[mine].min(axis=0)) / 2
            actual.append(float(np.linalg.norm(middle - np.mean(ends, axis=0))))
    return actual


@pytest.mark.parametrize(
    ("spoil", "reason"), [(in_shards, "pieces"), (with_fins, "more than two faces meet")]
)
def test_a_mesh_that_is_no_surface_is_felt_by_its_bones_and_says_so(
    anna: tuple[Any, Any], spoil: Any, reason: str
) -> None:
    rig, skin = anna
    spoil(skin)
    mark(rig, skin)
    (warning,) = stored_fits.messages_of(rig, "warnings")
    assert warning.startswith("felt by its bones only, because") and reason in warning
    assert max(off_the_joints(rig)) < 0.05
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SkinBinding)


def piece(rig: Any, bone_name: str, size: float, offset: float = 0.5) -> Any:
    """A box rigidly bound to a bone, around a location on the bone."""
    bone = rig.data.bones[bone_name]
    mesh = bpy.data.meshes.new(bone_name)
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=size)
    shape.to_mesh(mesh)
    shape.free()
    box = bpy.data.objects.new(f"Box of {bone_name}", mesh)
    bpy.context.scene.collection.objects.link(box)
    box.parent, box.parent_type, box.parent_bone = rig, "BONE", bone_name
    bpy.context.view_layer.update()
    position = bone.head_local.lerp(bone.tail_local, offset)
    box.matrix_world = rig.matrix_world.copy()
    box.matrix_world.translation = rig.matrix_world @ position
    bpy.context.view_layer.update()
    return box


def boxes(rig: Any) -> dict[str, Any]:
    names = [
        "Hips",
        "Spine2",
        "Head",
        *(side + limb for side in ("Left", "Right") for limb in LIMBS),
    ]
    return {name: piece(rig, f"mixamorig:{name}", 0.15) for name in names}


def test_a_character_of_rigid_pieces_is_felt_by_its_bones(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    bpy.data.objects.remove(skin)
    actual = boxes(rig)
    mark(rig)
    (warning,) = stored_fits.messages_of(rig, "warnings")
    assert "rigid pieces" in warning
    assert set(avatar_meshes.meshes_of(rig)) <= set(actual.values())
    assert max(off_the_joints(rig)) < 0.05
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SkinBinding)


def test_a_rigid_piece_is_read_where_it_is_at_rest(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    box = piece(rig, "mixamorig:LeftForeArm", 0.1)
    bone = rig.data.bones["mixamorig:LeftForeArm"]
    rig.pose.bones[bone.name].rotation_mode = "XYZ"
    rig.pose.bones[bone.name].rotation_euler = (1.0, 0.5, 0.2)
    rig.pose.bones["mixamorig:LeftArm"].location = (0.3, 0.0, 0.1)
    bpy.context.view_layer.update()
    target = avatar_meshes.read_mesh(rig, box)
    middle = bone.head_local.lerp(bone.tail_local, 0.5)
    assert (Vector(target.vertices.mean(axis=0)) - middle).length < 1e-5
    assert target.bone_names == (bone.name,)


@pytest.mark.skipif(
    "parent_bone_head_tail_factor" not in bpy.types.Object.bl_rna.properties,
    reason="Blender 5.2 and later",
)
@pytest.mark.parametrize("along", [0.0, 0.4])
def test_a_rigid_piece_hangs_anywhere_along_its_bone(anna: tuple[Any, Any], along: float) -> None:
    """Blender's placement with all bones at rest is the truth; also for nested pieces."""
    rig, _ = anna
    box, beyond = (piece(rig, "mixamorig:LeftForeArm", size) for size in (0.1, 0.05))
    box.parent_bone_head_tail_factor = along
    beyond.parent, beyond.parent_type = box, "OBJECT"
    bpy.context.view_layer.update()
    truth = [np.array(rig.matrix_world.inverted() @ item.matrix_world) for item in (box, beyond)]
    bone = rig.pose.bones["mixamorig:LeftForeArm"]
    bone.rotation_mode, bone.rotation_euler = "XYZ", (1.0, 0.5, 0.2)
    bpy.context.view_layer.update()
    for mesh, matrix in zip((box, beyond), truth, strict=True):
        own = np.array([vertex.co for vertex in mesh.data.vertices])
        vertices = avatar_meshes.read_mesh(rig, mesh).vertices
        assert np.allclose(vertices, own @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-5)


def test_what_a_hand_holds_is_no_skin(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    sword = piece(rig, "mixamorig:RightHand", 0.8, offset=2.0)
    mark(rig)
    assert avatar_meshes.meshes_of(rig) == [skin]
    assert sword not in finish(bodies.choosing_meshes(bpy.context, rig))


def test_normals_that_point_inwards_are_named_and_change_nothing(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    mark(rig, skin)
    before = fitted(rig)
    skin.data.flip_normals()
    mark(rig, skin)
    assert "normals" in stored_fits.messages_of(rig, "warnings")[0]
    assert np.abs(fitted(rig) - before).max() < 1e-5


def test_half_a_mesh_with_a_mirror_modifier_is_a_whole_body(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    half = bmesh.new()
    half.from_mesh(skin.data)
    right = [vert for vert in half.verts if vert.co.x < -1e-6]
    bmesh.ops.delete(half, geom=right, context="VERTS")
    half.to_mesh(skin.data)
    half.free()
    skin.modifiers.new("Mirror", "MIRROR")
    skin.modifiers.move(len(skin.modifiers) - 1, 0)
    for word in ("Left", "Right"):  # names flipped by Blender
        rig.data.bones[f"mixamorig:{word}Hand"].name = f"Hand.{word[0]}"
    objects, meshes = len(bpy.data.objects), len(bpy.data.meshes)
    target = avatar_meshes.read_mesh(rig, skin)
    assert (objects, meshes) == (len(bpy.data.objects), len(bpy.data.meshes))
    np.testing.assert_allclose(target.vertices[:, 0].min(), -target.vertices[:, 0].max(), rtol=1e-3)
    owners = np.repeat(np.arange(len(target.vertices)), np.diff(target.weights.offsets))
    for side, word in ((1, "L"), (-1, "R")):
        bone = target.bone_names.index(f"Hand.{word}")
        held = target.vertices[owners[target.weights.bones == bone]]
        assert len(held) > 10 and (np.sign(held[:, 0]) == side).all()
    bodies.mark_body(rig, [skin])
    rig.hfx.follow = "SURFACE"
    assert body_binding.surface_reason(rig) is not None


def test_two_characters_in_one_armature_are_refused(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    second = rig.copy()
    second.data = rig.data.copy()
    bpy.context.scene.collection.objects.link(second)
    second.location.x += 1.0
    bpy.context.view_layer.update()
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in (rig, second))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.join()
    with pytest.raises(RuntimeError, match=r"two characters: .*'mixamorig:Hips"):
        mark(rig, skin)
    assert rig.hfx.role == "NONE"


def test_a_pose_of_four_legs_is_refused(anna: tuple[Any, Any]) -> None:
    """The trunk lies, the legs stand: known names, no person."""
    rig, skin = anna
    hips = canonical_heads()["root"]
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in rig.data.edit_bones:
        bone.use_connect = False
    upper = [b for b in rig.data.edit_bones if not any(w in b.name for w in ("Leg", "Foot", "Toe"))]
    for bone in upper:
        head, tail = (Vector(end) - Vector(hips) for end in (bone.head, bone.tail))
        for end, way in (("head", head), ("tail", tail)):
            setattr(bone, end, Vector(hips) + Vector((way.x, -way.z, way.y)))
    bpy.ops.object.mode_set(mode="OBJECT")
    with pytest.raises(RuntimeError, match="its legs do not stand below its trunk"):
        mark(rig, skin)
