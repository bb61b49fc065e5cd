# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig that Blender's Rigify generates, fitted to the shipped avatar and bound by Blender."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import numpy as np

from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.body.rigs.mapping import RigBone, map_bones
from hfx_blender.engine.body.rigs.rig import canonical_heads


def enabled() -> bool:
    """Enable Rigify as a user does; False where this Blender comes without it."""
    import addon_utils

    return addon_utils.enable("rigify", default_set=True) is not None


def metarig() -> Any:
    """Rigify's human metarig, as it comes."""
    import bpy

    bpy.ops.object.armature_human_metarig_add()
    return bpy.context.object


def fit(rig: Any) -> None:
    """Put the metarig's joints where the shipped avatar's are, as a user does before generating.

    The face's bones are left out: they take three quarters of the time.
    """
    import bpy

    heads = canonical_heads()
    bones = [
        RigBone(b.name, b.parent and b.parent.name, tuple(b.head_local), tuple(b.tail_local))
        for b in rig.data.bones
    ]
    expected = {name: heads[bone] for bone, name in map_bones(bones).bones.items()}
    bpy.ops.object.mode_set(mode="EDIT")
    edit = rig.data.edit_bones
    for bone in edit["face"].children_recursive:
        edit.remove(bone)
    edit.remove(edit["face"])
    connected = [b.name for b in edit if b.use_connect]
    touching = {  # the connected child of a bone last, so that it decides where the bone ends
        b.parent.name: b.name
        for b in sorted(edit, key=lambda b: b.use_connect)
        if b.parent and (b.head - b.parent.tail).length < 1e-5
    }
    for bone in edit:
        bone.use_connect = False
    shift = {"": np.zeros(3)}
    for bone in edit:  # parents first
        above = shift[bone.parent.name if bone.parent else ""]
        head, tail = np.array(bone.head), np.array(bone.tail)
        shift[bone.name] = expected[bone.name] - head if bone.name in expected else above
        bone.head, bone.tail = head + shift[bone.name], tail + shift[bone.name]
    for parent, child in touching.items():
        edit[parent].tail = edit[child].head
    for name in connected:
        edit[name].use_connect = True
    bpy.ops.object.mode_set(mode="OBJECT")


def generated(meta: Any) -> Any:
    """The rig that Rigify makes of a metarig: DEF-, ORG-, MCH- bones and controls."""
    import bpy

    bpy.context.view_layer.objects.active = meta
    with contextlib.redirect_stdout(io.StringIO()):
        bpy.ops.pose.rigify_generate()
    return meta.data.rigify_target_rig


def bound(rig: Any, ratio: float = 0.2) -> Any:
    """The shipped avatar's shape in another mesh, with Blender's automatic weights."""
    import bpy

    avatar = load_avatar()
    mesh = bpy.data.meshes.new("Skin")
    faces = [[int(v) for v in face if v >= 0] for face in avatar.faces]
    mesh.from_pydata(avatar.vertices.tolist(), [], faces)
    skin = bpy.data.objects.new("Skin", mesh)
    bpy.context.scene.collection.objects.link(skin)
    skin.modifiers.new("Decimate", "DECIMATE").ratio = ratio
    graph = bpy.context.evaluated_depsgraph_get()
    skin.data = bpy.data.meshes.new_from_object(skin.evaluated_get(graph), depsgraph=graph)
    skin.modifiers.clear()
    for selected_object in bpy.context.selected_objects:
        selected_object.select_set(False)
    skin.select_set(True)
    rig.select_set(True)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    return skin
