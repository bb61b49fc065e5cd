# SPDX-License-Identifier: GPL-3.0-or-later
"""Transforms computed from F-curves equal Blender's, or the computation is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.reading.curves import fcurve_kinematics
from hfx_blender.reading.curves.animation_curves import NotModelledError
from hfx_blender.reading.curves.fcurve_kinematics import PlainObject, PlainRig

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FRAMES = np.array([-3.0, 0.25, 1.0, 4.4, 9.75, 10.0, 13.3, 17.0, 20.0, 31.5])
KEYS = (1, 8, 20)


def _graph() -> Any:
    return bpy.context.view_layer.depsgraph


def _set(frame: float) -> None:
    bpy.context.scene.frame_set(int(np.floor(frame)), subframe=float(frame - np.floor(frame)))


def assert_object(obj: Any) -> None:
    """The world matrix at all of FRAMES is Blender's."""
    actual = PlainObject(obj).world(FRAMES)
    for frame, matrix in zip(FRAMES.tolist(), actual, strict=True):
        _set(frame)
        truth = np.array(obj.evaluated_get(_graph()).matrix_world, np.float64)
        assert np.allclose(matrix, truth, atol=5e-6), frame


def assert_rig(obj: Any) -> None:
    world, skinning = PlainRig(obj).sample(FRAMES)
    for k, frame in enumerate(FRAMES.tolist()):
        _set(frame)
        posed = obj.evaluated_get(_graph())
        flat = np.zeros(len(posed.pose.bones) * 16, np.float32)
        posed.pose.bones.foreach_get("matrix_channel", flat)
        truth = flat.reshape(-1, 4, 4).transpose(0, 2, 1)[:, :3]
        assert np.allclose(skinning[k], truth, atol=5e-6), frame
        assert np.allclose(world[k], np.array(posed.matrix_world), atol=5e-6), frame


def key_at_random(owner: Any, path: str, seed: int, spread: float = 1.0) -> None:
    random = np.random.default_rng(seed)
    width = len(owner.path_resolve(path))
    for frame in KEYS:
        value = random.normal(0.3, spread, width)
        oracle.key(owner, path, [(frame, value.tolist())])


ROTATIONS = {
    "QUATERNION": "rotation_quaternion",
    "AXIS_ANGLE": "rotation_axis_angle",
    **dict.fromkeys(("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"), "rotation_euler"),
}


@pytest.mark.parametrize("mode", ROTATIONS)
def test_an_object_in_every_rotation_mode(scene: Any, mode: str) -> None:
    obj = oracle.empty(scene)
    obj.rotation_mode = mode
    obj.delta_location, obj.delta_scale = (0.1, 0.2, 0.3), (1.5, 0.5, -1.0)
    obj.delta_rotation_euler = (0.3, 0.1, 0.2)
    obj.delta_rotation_quaternion = (0.8, 0.1, 0.4, 0.2)
    for k, path in enumerate(("location", ROTATIONS[mode], "scale")):
        key_at_random(obj, path, k)
    assert_object(obj)


def test_children_of_objects(scene: Any) -> None:
    parent = oracle.empty(scene, "Parent")
    child = oracle.empty(scene, "Child", parent)
    child.matrix_parent_inverse = ((1, 0.2, 0, 3), (0, 1, 0, 1), (0, 0.4, 2, 0), (0, 0, 0, 1))
    key_at_random(parent, "rotation_euler", 1)
    key_at_random(parent, "scale", 2)
    key_at_random(child, "location", 3)
    assert_object(oracle.empty(scene, "Grandchild", child))


@pytest.mark.parametrize(
    "interpolation", ["CONSTANT", "LINEAR", "BEZIER", "SINE", "BACK", "BOUNCE", "ELASTIC"]
)
def test_every_interpolation(scene: Any, interpolation: str) -> None:
    obj = oracle.empty(scene)
    key_at_random(obj, "location", 5, 3.0)
    for curve in compat.fcurves(obj):
        for point in curve.keyframe_points:
            point.interpolation = interpolation
        curve.update()
    assert_object(obj)


@pytest.mark.parametrize("seed", range(4))
def test_free_handles_even_those_that_overshoot(scene: Any, seed: int) -> None:
    obj = oracle.empty(scene)
    key_at_random(obj, "location", seed, 3.0)
    random = np.random.default_rng(seed)
    for curve in compat.fcurves(obj):
        for point in curve.keyframe_points:
            point.handle_left_type = point.handle_right_type = "FREE"
            point.handle_left = point.co[0] - random.uniform(0, 20), random.normal(0, 5)
            point.handle_right = point.co[0] + random.uniform(0, 20), random.normal(0, 5)
    actual = PlainObject(obj).world(FRAMES)
    for k, frame in enumerate(FRAMES.tolist()):
        _set(frame)
        truth = obj.evaluated_get(_graph()).matrix_world.translation
        # Where a handle stands upright Blender's own 32-bit root is this far off.
        assert np.allclose(actual[k, :3, 3], truth, atol=1e-3), frame


def test_keys_that_a_script_left_out_of_order(scene: Any) -> None:
    obj = oracle.empty(scene)
    key_at_random(obj, "location", 4)
    for curve in compat.fcurves(obj):
        first, _, last = curve.keyframe_points
        first.co[0], last.co[0] = 20.0, 1.0
    assert_object(obj)


def test_modifiers_extrapolation_and_muted_curves(scene: Any) -> None:
    obj = oracle.empty(scene)
    key_at_random(obj, "location", 5)
    x, y, z = compat.fcurves(obj)
    x.modifiers.new("CYCLES")
    y.extrapolation = "LINEAR"
    z.mute = True
    obj.location.z = 0.7
    assert_object(obj)


# Armatures


@pytest.fixture
def rig(scene: Any) -> Any:
    """A chain with a connected bone, a branch, and bones moving along different axes."""
    data = bpy.data.armatures.new("Rig")
    obj = bpy.data.objects.new("Rig", data)
    scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    places = {
        "root": ((0.1, 0.2, 0.3), (0.5, 0.4, 0.9), None),
        "joined": ((0.5, 0.4, 0.9), (0.6, 0.8, 1.1), "root"),
        "branch": ((0.6, 0.5, 1.1), (0.5, 0.9, 1.9), "root"),
        "other axes": ((0.2, 0.5, 1.1), (0.5, 0.9, 1.9), "branch"),
        'odd "name"': ((0.7, 0.9, 2.0), (0.8, 0.9, 2.9), "other axes"),
        "lone": ((0.0, 0.0, 0.0), (0.0, 0.3, 0.1), None),
    }
    for k, (name, (head, tail, parent)) in enumerate(places.items()):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail, bone.roll = head, tail, 0.4 * k
        bone.parent = None if parent is None else data.edit_bones[parent]
    data.edit_bones["joined"].use_connect = True
    data.edit_bones["other axes"].use_local_location = False
    data.edit_bones["lone"].use_local_location = False
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone, mode in zip(obj.pose.bones, [*ROTATIONS][:6], strict=True):
        bone.rotation_mode = mode
    return obj


def _key_bones(rig: Any) -> None:
    for k, bone in enumerate(rig.pose.bones):
        stem = f'pose.bones["{bpy.utils.escape_identifier(bone.name)}"].'
        for name in ("location", ROTATIONS[bone.rotation_mode], "scale"):
            if (k, name) != (2, "scale"):  # properties without keys keep their values
                key_at_random(rig, stem + name, k, 0.4)
    rig.pose.bones[2].scale = (1.0, 2.0, 0.5)


def test_bones(rig: Any) -> None:
    _key_bones(rig)
    key_at_random(rig, "location", 9)
    assert_rig(rig)


@pytest.mark.parametrize("is_relative", [False, True])
def test_children_of_bones(scene: Any, rig: Any, is_relative: bool) -> None:
    _key_bones(rig)
    child = oracle.empty(scene, "Held", rig)
    child.parent_type, child.parent_bone = "BONE", "branch"
    rig.data.bones["branch"].use_relative_parent = is_relative
    key_at_random(child, "location", 4)
    assert_object(child)


needs_factor = pytest.mark.skipif(
    "parent_bone_head_tail_factor" not in bpy.types.Object.bl_rna.properties,
    reason="Blender 5.2 and later",
)


@needs_factor
@pytest.mark.parametrize("is_relative", [False, True])
@pytest.mark.parametrize("along", [0.0, 0.35, 1.0])
def test_children_along_bones(scene: Any, rig: Any, along: float, is_relative: bool) -> None:
    """Also a child of a child, and an armature on a bone with a child on the armature's bone."""
    _key_bones(rig)
    held = oracle.empty(scene, "Held", rig)
    held.parent_type, held.parent_bone = "BONE", "branch"
    held.parent_bone_head_tail_factor = along
    rig.data.bones["branch"].use_relative_parent = is_relative
    held.matrix_parent_inverse = ((1, 0.2, 0, 3), (0, 1, 0, 1), (0, 0.4, 2, 0), (0, 0, 0, 1))
    key_at_random(held, "location", 4)
    rider = rig.copy()
    scene.collection.objects.link(rider)
    rider.parent, rider.parent_type, rider.parent_bone = rig, "BONE", "other axes"
    rider.parent_bone_head_tail_factor = 1.0 - along
    on_rider = oracle.empty(scene, "On Rider", rider)
    on_rider.parent_type, on_rider.parent_bone = "BONE", "lone"
    on_rider.parent_bone_head_tail_factor = along
    assert_object(oracle.empty(scene, "Child", held))
    assert_object(on_rider)


@needs_factor
@pytest.mark.parametrize("is_driven", [False, True])
def test_a_place_along_a_bone_that_changes_is_left_to_blender(
    scene: Any, rig: Any, is_driven: bool
) -> None:
    held = oracle.empty(scene, "Held", rig)
    held.parent_type, held.parent_bone = "BONE", "branch"
    if is_driven:
        held.driver_add("parent_bone_head_tail_factor").driver.expression = "frame / 30"
    else:
        oracle.key(held, "parent_bone_head_tail_factor", [(1, 0.0), (9, 1.0)])
    with pytest.raises(NotModelledError, match="'Held'"):
        PlainObject(held)


def _strip(track: Any, owner: Any, path: str, start: int, seed: int, **settings: Any) -> Any:
    data = owner.animation_data_create()
    data.action = None
    key_at_random(owner, path, seed, 0.5)
    strip = track.strips.new("Strip", start, data.action)
    data.action = None
    for name, value in settings.items():
        setattr(strip, name, value)
    return strip


@pytest.mark.parametrize("extrapolation", ["HOLD", "HOLD_FORWARD", "NOTHING"])
def test_strips(rig: Any, extrapolation: str) -> None:
    """Repeated, scaled, blended, with track over track, and an action on top."""
    tracks = rig.animation_data_create().nla_tracks
    path = 'pose.bones["branch"].rotation_euler'
    rig.pose.bones["branch"].rotation_mode = "XYZ"
    below = _strip(tracks.new(), rig, path, 2, 1, repeat=2.5, scale=0.3)
    below.extrapolation = extrapolation
    above = _strip(tracks.new(), rig, path, 6, 2, scale=0.7, extrapolation="NOTHING")
    above.use_auto_blend = False
    above.blend_in, above.blend_out = 4.0, 5.0
    muted = _strip(tracks.new(), rig, path, 3, 3)
    muted.mute = True
    tracks.new().mute = True
    assert_rig(rig)
    key_at_random(rig, "location", 9)
    assert_rig(rig)
    tracks[1].is_solo = True
    assert_rig(rig)


# Refused animation


def _constraint(rig: Any) -> None:
    rig.pose.bones["branch"].constraints.new("COPY_LOCATION")


def _hinge(rig: Any) -> None:
    rig.data.bones["branch"].use_inherit_rotation = False


def _scale(rig: Any) -> None:
    rig.data.bones["branch"].inherit_scale = "NONE"


def _rest(rig: Any) -> None:
    rig.data.pose_position = "REST"


def _mode(rig: Any) -> None:
    oracle.key(rig, 'pose.bones["branch"].rotation_mode', [(1, "XYZ"), (9, "QUATERNION")])


def _driver(rig: Any) -> None:
    rig.driver_add('pose.bones["branch"].location', 0)


def _added(rig: Any) -> None:
    track = rig.animation_data_create().nla_tracks.new()
    _strip(track, rig, "location", 2, 1, blend_type="ADD")


def _influence(rig: Any) -> None:
    track = rig.animation_data_create().nla_tracks.new()
    _strip(track, rig, "location", 2, 1, use_animated_influence=True)


def _object_constraint(rig: Any) -> None:
    rig.constraints.new("LIMIT_LOCATION")


def _vertex_parent(rig: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    rig.parent, rig.parent_type = bpy.context.object, "VERTEX"


def _curve_parent(rig: Any) -> None:
    curve = bpy.data.curves.new("Path", "CURVE")
    curve.splines.new("POLY").points.add(1)
    rig.parent = bpy.data.objects.new("Path", curve)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (_constraint, "'branch' of 'Rig' has constraints"),
        (_hinge, "'branch' of 'Rig' inherits"),
        (_scale, "'branch' of 'Rig' inherits"),
        (_rest, "rest position"),
        (_mode, "rotation_mode"),
        (_driver, "'Rig' has drivers"),
        (_added, "plain clip"),
        (_influence, "plain clip"),
        (_object_constraint, "'Rig' has constraints"),
        (_vertex_parent, "place of its parent"),
        (_curve_parent, "place of its parent"),
    ],
)
def test_what_is_not_modelled_is_told(rig: Any, change: Callable[[Any], None], word: str) -> None:
    PlainRig(rig)
    change(rig)
    with pytest.raises(NotModelledError, match=word):
        PlainRig(rig)


def test_paths_that_nobody_thought_of_are_refused(scene: Any) -> None:
    obj = oracle.empty(scene)
    oracle.key(obj, "empty_display_size", [(1, 1.0), (9, 2.0)])
    with pytest.raises(NotModelledError, match="'empty_display_size' of 'Empty'"):
        PlainObject(obj)
    assert fcurve_kinematics.rest_value('pose.bones["a"].rotation_quaternion', 0) == 1.0
