# SPDX-License-Identifier: GPL-3.0-or-later
"""Somebody's own avatar for tests: another rig, another rest pose, another unit."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Matrix

from hfx_blender.avatars import bodies

MIXAMO = {
    "root": "Hips",
    "spine03": "Spine1",
    "spine01": "Spine2",
    "neck01": "Neck",
    "head": "Head",
    **{
        f"{bone}.{side}": f"{name}{theirs}"
        for side, name in (("L", "Left"), ("R", "Right"))
        for bone, theirs in (
            ("clavicle", "Shoulder"),
            ("upperarm01", "Arm"),
            ("lowerarm01", "ForeArm"),
            ("wrist", "Hand"),
            ("upperleg01", "UpLeg"),
            ("lowerleg01", "Leg"),
            ("foot", "Foot"),
            ("toe2-1", "ToeBase"),
            *(
                (f"finger{number}-{joint}", f"Hand{finger}{joint}")
                for number, finger in enumerate(("Thumb", "Index", "Middle", "Ring", "Pinky"), 1)
                for joint in (1, 2, 3)
            ),
        )
    },
}


_folder = tempfile.TemporaryDirectory(
    prefix="hfx_own_avatar_", dir=os.environ.get("BLENDER_USER_RESOURCES")
)


def opened(*, is_fitted: bool = False) -> tuple[Any, Any]:
    """Open the avatar in a separate file; made and fitted only once."""
    path = Path(_folder.name) / f"anna{is_fitted}.blend"
    if not path.exists():
        bpy.ops.wm.read_homefile(use_empty=True)
        rig, skin = own_avatar(bpy.context.scene, centimetres=False)
        if is_fitted:
            mark(rig, skin)
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    rig = bpy.data.objects["Anna"]
    bpy.context.view_layer.objects.active = rig
    return rig, bpy.data.objects["Anna Skin"]


def own_avatar(scene: Any, *, centimetres: bool = True) -> tuple[Any, Any]:
    """A user's avatar: a T-pose at rest, different bone names, in centimetres on different axes."""
    rig, skin = bodies.add_avatar(bpy.context, "Anna")
    rig.hfx.role, rig.hfx.avatar = "NONE", None
    for side, sign in (("L", -1.0), ("R", 1.0)):
        bone = rig.pose.bones[f"upperarm01.{side}"]
        turn = Matrix.Rotation(sign * np.radians(42), 4, "Y")
        centre = Matrix.Translation(bone.head)
        bone.matrix = centre @ turn @ centre.inverted() @ bone.matrix
        bpy.context.view_layer.update()
    evaluated = skin.evaluated_get(bpy.context.evaluated_depsgraph_get())
    baked = np.zeros(len(skin.data.vertices) * 3, np.float32)
    evaluated.data.vertices.foreach_get("co", baked)
    skin.data.vertices.foreach_set("co", baked)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.pose.armature_apply()
    bpy.ops.object.mode_set(mode="OBJECT")
    for number, bone in enumerate(rig.data.bones):
        theirs = MIXAMO.get(bone.name)
        bone.name = f"mixamorig:{theirs}" if theirs else f"extra{number}"
    if centimetres:
        change = Euler((-np.pi / 2, 0, 0.4)).to_matrix().to_4x4() @ Matrix.Scale(100, 4)
        rig.data.transform(change)
        skin.data.transform(change)
        rig.matrix_world = change.inverted()
    bpy.context.view_layer.update()
    return rig, skin


def mark(rig: Any, *meshes: Any) -> None:
    """Add a haptic body as a user does: meshes selected, armature active."""
    bpy.context.view_layer.objects.active = rig
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in (rig, *meshes))
    bpy.ops.hfx.mark_body()
