# SPDX-License-Identifier: GPL-3.0-or-later
"""The canonical skeleton equals the bones made by Blender."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_tools.body_building import skeleton


def bones_in_blender(bpy: Any, bones: dict[str, tuple[Any, Any, float]]) -> dict[str, np.ndarray]:
    """``matrix_local`` of bones made from head, tail and roll."""
    armature = bpy.data.armatures.new("bones")
    holder = bpy.data.objects.new("bones", armature)
    bpy.context.scene.collection.objects.link(holder)
    bpy.context.view_layer.objects.active = holder
    bpy.ops.object.mode_set(mode="EDIT")
    for name, (head, tail, roll) in bones.items():
        bone = armature.edit_bones.new(name)
        bone.head, bone.tail, bone.roll = head, tail, roll
    bpy.ops.object.mode_set(mode="OBJECT")
    actual = {bone.name: np.array(bone.matrix_local, np.float64) for bone in armature.bones}
    bpy.data.objects.remove(holder)
    bpy.data.armatures.remove(armature)
    return actual


def test_rest_matrices_are_blenders_for_any_direction_and_roll(registered: Any) -> None:
    random = np.random.default_rng(20260)
    directions = list(random.normal(size=(60, 3)))
    directions += [np.eye(3)[axis] * sign for axis in range(3) for sign in (1.0, -1.0)]
    # Around straight down -Y, the two places with a change of Blender's formula.
    directions += [np.array([tilt, -1.0, 0.7 * tilt]) for tilt in (1e-1, 3e-2, 1e-2, 1e-3, 1e-5)]
    cases = {}
    for number, direction in enumerate(directions):
        head = random.uniform(-1.0, 1.0, 3)
        tail = head + 0.3 * direction / np.linalg.norm(direction)
        cases[f"bone{number}"] = (head, tail, float(random.uniform(-np.pi, np.pi)))
    created = bones_in_blender(registered, cases)
    for name, (head, tail, roll) in cases.items():
        ours = skeleton.rest_matrix(head, tail, roll)
        # 1e-3 only where float32 heads and tails leave Blender few digits of 1 + y.
        coarse = abs(ours[1, 1] + 1.0) < 1e-4
        assert created[name] == pytest.approx(ours, abs=1e-2 if coarse else 2e-4), name


def test_the_shipped_skeleton_survives_becoming_an_armature(registered: Any) -> None:
    from mathutils import Matrix

    bpy, bones = registered, model.load_avatar().skeleton
    armature = bpy.data.armatures.new("avatar")
    holder = bpy.data.objects.new("avatar", armature)
    bpy.context.scene.collection.objects.link(holder)
    bpy.context.view_layer.objects.active = holder
    bpy.ops.object.mode_set(mode="EDIT")
    for name, parent, rest, length in zip(
        bones.bone_names, bones.parents, bones.rest, bones.lengths_m, strict=True
    ):
        bone = armature.edit_bones.new(name)
        bone.head, bone.tail = (0.0, 0.0, 0.0), (0.0, float(length), 0.0)
        bone.matrix = Matrix(rest.tolist())
        if parent >= 0:
            bone.parent = armature.edit_bones[bones.bone_names[parent]]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert tuple(bone.name for bone in armature.bones) and len(armature.bones) == 163
    for name, rest, length in zip(bones.bone_names, bones.rest, bones.lengths_m, strict=True):
        bone = armature.bones[name]
        assert np.array(bone.matrix_local) == pytest.approx(rest.astype(float), abs=2e-4), name
        assert bone.length == pytest.approx(float(length), rel=1e-4), name
