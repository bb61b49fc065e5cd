# SPDX-License-Identifier: GPL-3.0-or-later
"""Handles of volumes, by their values; their dragging is tested in a window."""

from __future__ import annotations

from typing import Any

import bpy
import pytest

from hfx_blender.ui import gizmos


@pytest.mark.parametrize(
    ("shape", "axis", "expected"),
    [
        ("SPHERE", 0, {"radius": 0.7}),
        ("CYLINDER", 0, {"radius": 0.7}),
        ("CAPSULE", 2, {"height": 1.4}),
        ("CUBOID", 1, {"size": (1.0, 1.4, 1.0)}),
    ],
)
def test_dragging_a_handle_moves_the_boundary_there(
    scene: Any, shape: str, axis: int, expected: dict[str, Any]
) -> None:
    bpy.ops.hfx.add_volume(shape=shape)
    effect = bpy.context.object
    gizmos.set_offset(effect, axis, 0.7)
    assert gizmos.offset(effect, axis) == pytest.approx(0.7)
    for name, value in expected.items():
        actual = getattr(effect.hfx, name)
        assert (actual if isinstance(value, float) else tuple(actual)) == pytest.approx(value)
    points = [effect.matrix_world @ v.co for v in effect.data.vertices]
    assert max(p[axis] for p in points) == pytest.approx(0.7, abs=0.01), "the wires follow"


def test_scaled_and_turned_volumes_are_sized_in_world_units(scene: Any) -> None:
    bpy.ops.hfx.add_volume(shape="CUBOID")
    effect = bpy.context.object
    effect.scale = (2.0, 3.0, 4.0)
    effect.rotation_euler.z = 0.5
    bpy.context.view_layer.update()
    assert gizmos.offset(effect, 1) == pytest.approx(1.5)
    gizmos.set_offset(effect, 1, 3.0)
    assert effect.hfx.size[1] == pytest.approx(2.0)
    matrix = gizmos.along(effect.matrix_world, 1)
    expected = tuple(effect.matrix_world.col[1].to_3d() / 3.0)
    assert tuple(matrix.col[2].to_3d()) == pytest.approx(expected, abs=1e-6)
    assert tuple(matrix.to_scale()) == pytest.approx((1, 1, 1), abs=1e-5)


def test_auto_keying_keys_what_a_handle_changes(scene: Any) -> None:
    bpy.ops.hfx.add_volume(shape="CUBOID")
    effect = bpy.context.object
    effect.keyframe_insert("hfx.size", frame=1)
    scene.frame_set(11)
    bpy.context.tool_settings.use_keyframe_insert_auto = True
    gizmos.set_offset(effect, 2, 2.0)
    bpy.context.tool_settings.use_keyframe_insert_auto = False
    gizmos.set_offset(effect, 0, 3.0)
    for frame, size in ((1, (1, 1, 1)), (11, (1, 1, 4))):  # axes without keys stay unchanged
        scene.frame_set(frame)
        assert tuple(effect.hfx.size) == pytest.approx(size)


def test_a_handle_cannot_turn_a_volume_inside_out(scene: Any) -> None:
    bpy.ops.hfx.add_volume(shape="SPHERE")
    effect = bpy.context.object
    gizmos.set_offset(effect, 0, -2.0)
    assert effect.hfx.radius == 0.0


@pytest.mark.parametrize("shape", ["SPHERE", "MESH"])
def test_handles_that_a_shape_does_not_have_stand_still(scene: Any, shape: str) -> None:
    bpy.ops.hfx.add_volume(shape="SPHERE")
    effect = bpy.context.object
    effect.hfx.shape = shape
    gizmos.drag_offset(1, 0.7)
    assert gizmos.shown_offset(1) == 0.0
    assert effect.hfx.radius == 0.5
    bpy.data.objects.remove(effect)
    assert gizmos.shown_offset(0) == 0.0, "with the volume gone, too"
