# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions, velocities and depth of the engine, against Blender's own deformation."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import igl
import numpy as np
import pytest

from hfx_blender.engine.scene import SkinBinding, SurfaceBinding
from hfx_blender.errors import InputError

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

TOLERANCE_M = 1e-5
MODALITIES = ("vibration", "pressure", "temperature")


@pytest.fixture
def body(scene: Any) -> Any:
    """The built-in avatar, with an effect painted on all of the skin."""
    scene.frame_start, scene.frame_end = 1, 12
    body = oracle.add_avatar()
    oracle.add_painted("Felt", "pressure", body)
    return body


def _assert_as_blender_deforms(
    scene: Any, body: Any, modalities: tuple[str, ...] = ("pressure",)
) -> Any:
    """Check every position at every time within 0.01 mm; returns the evaluation."""
    references = {m: oracle.model_object(scene, body, m) for m in modalities}
    for modality in modalities:
        if modality != "pressure":
            oracle.add_painted(f"Felt {modality}", modality, body)
    evaluation = oracle.evaluate(scene, record=("positions",), rate_hz=10)
    for modality, reference in references.items():
        name = "Felt" if modality == "pressure" else f"Felt {modality}"
        indices = evaluation.reader.sample_indices.tolist()
        assert len(indices) >= 3
        assert sorted(evaluation.samples[name]) == indices
        for index in indices:
            oracle.set_time(scene, evaluation.reader.time.frame(index))
            expected = oracle.world_vertices(scene, reference)
            positions = evaluation.of(name, index).positions
            assert np.linalg.norm(positions - expected, axis=1).max() < TOLERANCE_M
    return evaluation


def _bending(body: Any, seed: int = 3) -> None:
    """Bend every bone from rest into strong random angles."""
    for bone in body.pose.bones:
        bone.rotation_mode = "XYZ"
        bone.keyframe_insert("rotation_euler", frame=1)
    oracle.bend(body, seed)
    for bone in body.pose.bones:
        bone.keyframe_insert("rotation_euler", frame=12)


def test_walking(scene: Any, body: Any) -> None:
    oracle.add_walk(body, [(0, 0, 0), (0.3, -0.4, 0.1)], 1, 12)
    evaluation = _assert_as_blender_deforms(scene, body, MODALITIES)
    first, last = (evaluation.of("Felt", index).positions for index in (0, 4))
    assert np.linalg.norm(last - first, axis=1).max() > 0.3


def test_strong_bends(scene: Any, body: Any) -> None:
    _bending(body)
    evaluation = _assert_as_blender_deforms(scene, body, MODALITIES)
    assert isinstance(evaluation.reader.description.bodies[0].binding, SkinBinding)


@pytest.mark.parametrize("scale", [1.0, 1.7, -0.9])
def test_moved_turned_and_scaled_armature(scene: Any, body: Any, scale: float) -> None:
    _bending(body)
    platform = oracle.empty(scene)
    oracle.key(platform, "rotation_euler", [(1, (0, 0, 0)), (12, (0.3, 0.2, 1.0))])
    body.parent = platform
    body.location, body.rotation_euler, body.scale = (3, -2, 1), (0.2, 0.1, 2.0), (scale,) * 3
    _assert_as_blender_deforms(scene, body)


def test_units_of_a_centimetre(scene: Any, body: Any) -> None:
    """A scene in centimetres: the engine's metres are a hundredth of Blender's units."""
    _bending(body)
    scene.unit_settings.scale_length = 0.01
    body.scale, body.location = (100.0,) * 3, (50.0, 20.0, 0.0)
    evaluation = _assert_as_blender_deforms(scene, body)
    positions = evaluation.of("Felt", 0).positions
    assert np.ptp(positions[:, 2]) == pytest.approx(1.8, abs=0.1)
    assert positions[:, 0].mean() == pytest.approx(0.5, abs=0.05)


def test_far_from_the_origin(scene: Any, body: Any) -> None:
    """Two kilometres away Blender's mesh jitters; positions are the near body's, moved in float64.

    The remaining difference is the rounding of positions to float32, 0.06 mm there.
    """
    _bending(body)
    near = oracle.evaluate(scene, record=("positions",)).of("Felt", 4).positions
    body.location = (2000.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    far = oracle.evaluate(scene, record=("positions",)).of("Felt", 4).positions
    moved = near + np.array([2000.0, 0.0, 0.0])
    assert np.abs(far - moved).max() <= 0.5 * np.spacing(np.float32(2000.0)) + 1e-6


def test_constraints_and_drivers_of_bones(scene: Any, body: Any) -> None:
    target = oracle.empty(scene)
    oracle.key(target, "location", [(1, (0.3, -0.3, 1.2)), (12, (0.2, -0.5, 1.5))])
    bones = body.pose.bones
    reach = bones["lowerarm01.L"].constraints.new("IK")
    reach.target, reach.chain_count = target, 3
    copy = bones["upperleg01.R"].constraints.new("COPY_ROTATION")
    copy.target, copy.target_space, copy.owner_space = target, "LOCAL", "LOCAL"
    copy.mix_mode = "ADD"
    oracle.key(target, "rotation_euler", [(1, (0, 0, 0)), (12, (0.9, 0, 0.2))])
    bones["head"].rotation_mode = "XYZ"
    driver = bones["head"].driver_add("rotation_euler", 0).driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.type = "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = target, "LOC_Z"
    evaluation = _assert_as_blender_deforms(scene, body)
    first, last = (evaluation.of("Felt", index).positions for index in (0, 4))
    assert np.linalg.norm(last - first, axis=1).max() > 0.1
    assert evaluation.reader.stepping_note.startswith("stepped a scratch scene")


def test_rest_position_of_the_armature(scene: Any, body: Any) -> None:
    _bending(body)
    body.data.pose_position = "REST"
    evaluation = _assert_as_blender_deforms(scene, body)
    model = oracle.load_model("hfx-pressure-1")
    assert np.abs(evaluation.of("Felt", 4).positions - model.vertices).max() < TOLERANCE_M


def test_a_control_bone_changes_nothing(scene: Any, body: Any) -> None:
    """An added control bone without deformation is no reason to follow the surface."""
    bpy.context.view_layer.objects.active = body
    bpy.ops.object.mode_set(mode="EDIT")
    control = body.data.edit_bones.new("control")
    control.tail = (0, 0, 1)
    control.use_deform = False
    bpy.ops.object.mode_set(mode="OBJECT")
    evaluation = _assert_as_blender_deforms(scene, body)
    assert isinstance(evaluation.reader.description.bodies[0].binding, SkinBinding)


def test_subdivision_does_not_matter(scene: Any, body: Any) -> None:
    _bending(body)
    body.hfx.avatar.modifiers.new("Smooth", "SUBSURF")
    evaluation = _assert_as_blender_deforms(scene, body)
    assert isinstance(evaluation.reader.description.bodies[0].binding, SkinBinding)
    assert not evaluation.reader.description.warnings


# Bodies not posable by bones alone


def _preserve_volume(scene: Any, skin: Any) -> None:
    skin.modifiers["Armature"].use_deform_preserve_volume = True


def _shape_key(scene: Any, skin: Any) -> None:
    skin.shape_key_add(name="Basis")
    fatter = skin.shape_key_add(name="Fatter")
    for point, vertex in zip(fatter.data, skin.data.vertices, strict=True):
        point.co = vertex.co + 0.02 * vertex.normal
    fatter.value = 0.0
    fatter.keyframe_insert("value", frame=1)
    fatter.value = 1.0
    fatter.keyframe_insert("value", frame=12)


def _cast(scene: Any, skin: Any) -> None:
    cast = skin.modifiers.new("Cast", "CAST")
    oracle.key(skin, 'modifiers["Cast"].factor', [(1, 0.0), (12, 0.3)])
    assert cast.factor == pytest.approx(0.3)


def _wave(scene: Any, skin: Any) -> None:
    wave = skin.modifiers.new("Wave", "WAVE")
    wave.height, wave.width, wave.narrowness = 0.05, 0.4, 4.0


def _lattice(scene: Any, skin: Any) -> None:
    cage = bpy.data.objects.new("Cage", bpy.data.lattices.new("Cage"))
    scene.collection.objects.link(cage)
    cage.location, cage.scale = (0.0, 0.0, 0.9), (2.0, 2.0, 2.0)
    for point in cage.data.points[:4]:
        point.co_deform = point.co_deform * 1.4
    skin.modifiers.new("Lattice", "LATTICE").object = cage


DEFORMERS: dict[str, tuple[Callable[[Any, Any], None], str]] = {
    "preserve volume": (_preserve_volume, "Preserve Volume is on"),
    "shape key": (_shape_key, "shape keys"),
    "cast": (_cast, "'Cast'"),
    "wave": (_wave, "'Wave'"),
    "lattice": (_lattice, "'Lattice'"),
}


@pytest.mark.parametrize("deformer", DEFORMERS)
def test_the_evaluated_surface_is_followed(scene: Any, body: Any, deformer: str) -> None:
    skin = body.hfx.avatar
    model = oracle.load_model("hfx-pressure-1")
    face_corners, weights, heights, certain = _anchored(skin, model.vertices)
    _bending(body)
    body.location, body.scale = (0.5, -1.0, 0.2), (1.2,) * 3
    deform, reason = DEFORMERS[deformer]
    linear = oracle.evaluate(scene, record=("positions",)).of("Felt", 4).positions
    deform(scene, skin)
    evaluation = oracle.evaluate(scene, record=("positions",))
    assert isinstance(evaluation.reader.description.bodies[0].binding, SurfaceBinding)
    (warning,) = evaluation.reader.description.warnings
    assert body.name in warning and reason in warning
    for index in evaluation.reader.sample_indices.tolist():
        oracle.set_time(scene, evaluation.reader.time.frame(index))
        surface = oracle.local_vertices(scene, skin)[face_corners]
        normals = np.cross(surface[:, 1] - surface[:, 0], surface[:, 2] - surface[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        local = np.einsum("vc,vci->vi", weights, surface) + heights[:, None] * normals
        matrix = oracle.world_matrix(scene, skin)
        expected = local @ matrix[:3, :3].T + matrix[:3, 3]
        positions = evaluation.of("Felt", index).positions
        assert np.linalg.norm(positions - expected, axis=1)[certain].max() < TOLERANCE_M
        nearest = np.sqrt(
            igl.point_mesh_squared_distance(
                positions.astype(np.float64), *_world_surface(scene, skin)
            )[0]
        )
        assert nearest.max() < 0.01  # the rest stay on the skin too
    assert np.linalg.norm(evaluation.of("Felt", 4).positions - linear, axis=1).max() > 0.005


def _anchored(
    skin: Any, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Corners, barycentric weights and heights over an undeformed mesh; where unique.

    Not unique: a nearest point on an edge, and the midline, with triangles of left and right at
    equal distance.
    """
    mesh = skin.data
    mesh.calc_loop_triangles()
    triangles = np.array([tuple(t.vertices) for t in mesh.loop_triangles], np.int64)
    vertices = np.array([vertex.co for vertex in mesh.vertices], np.float64)
    points = points.astype(np.float64)
    _, faces, feet = igl.point_mesh_squared_distance(points, vertices, triangles)
    corners = triangles[faces]
    shape = vertices[corners]
    areas = np.stack(
        [
            np.linalg.norm(np.cross(shape[:, k - 2] - feet, shape[:, k - 1] - feet), axis=1)
            for k in range(3)
        ],
        axis=1,
    )
    weights = areas / areas.sum(axis=1, keepdims=True)
    normals = np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = np.einsum("vi,vi->v", points - feet, normals)
    certain = (weights.min(axis=1) > 0.02) & (np.abs(points[:, 0]) > 1e-3)
    assert certain.mean() > 0.8
    return corners, weights, heights, certain


def _world_surface(scene: Any, skin: Any) -> tuple[np.ndarray, np.ndarray]:
    return oracle.world_vertices(scene, skin), oracle.triangles(scene, skin)


def test_an_unchanged_surface_is_the_rest_pose(scene: Any, body: Any) -> None:
    """Anchoring is exact: a modifier without effect leaves every vertex in place."""
    body.hfx.avatar.modifiers.new("Cast", "CAST").factor = 0.0
    body.hfx.follow = "SURFACE"
    evaluation = oracle.evaluate(scene, record=("positions",))
    assert isinstance(evaluation.reader.description.bodies[0].binding, SurfaceBinding)
    model = oracle.load_model("hfx-pressure-1")
    assert np.abs(evaluation.of("Felt", 0).positions - model.vertices).max() < TOLERANCE_M


def test_surface_contacts(scene: Any, body: Any) -> None:
    """Contacts of a surface-bound body equal the contacts computed from positions."""
    _bending(body)
    _preserve_volume(scene, body.hfx.avatar)
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", (0.1, -0.1, 1.2), radius=0.4)
    evaluation = oracle.evaluate(scene, record=("positions",))
    bare = oracle.evaluate(scene)
    for index in evaluation.reader.sample_indices.tolist():
        oracle.set_time(scene, evaluation.reader.time.frame(index))
        verdict = oracle.judge(scene, ball, evaluation.of("Felt", index).positions)
        for result in (evaluation, bare):
            inside = np.zeros(len(verdict.inside), bool)
            inside[result.of("Ball", index).vertices] = True
            assert not (verdict.clear & (inside != verdict.inside)).any()
        assert 100 < np.count_nonzero(verdict.inside) < len(verdict.inside) / 2


def test_a_surface_whose_vertices_change_with_the_pose_is_refused(scene: Any, body: Any) -> None:
    skin = body.hfx.avatar
    modifier = skin.modifiers.new("Fewer", "DECIMATE")
    modifier.ratio = 0.5
    _bending(body)
    _assert_as_blender_deforms(scene, body)  # the skin follows the bones
    _preserve_volume(scene, skin)
    with pytest.raises(InputError, match=rf"'{skin.name}'.*number of vertices from 12440 to \d+"):
        oracle.evaluate(scene, record=("positions",))
    assert [item.name for item in bpy.data.scenes] == [scene.name]


# Velocities and depth


@pytest.fixture
def moving(scene: Any, body: Any) -> Any:
    """A walking body inside a ball, and an effect painted on the head, on in two stretches."""
    scene.frame_end = 24
    oracle.add_walk(body, [(0, 0, 0), (0.2, -1.2, 0.1)], 1, 24)
    oracle.add_volume("Ball", "temperature", "SPHERE", (0.1, -0.4, 1.2), radius=0.6)
    bpy.data.objects.remove(bpy.data.objects["Felt"])
    head = oracle.add_painted("Head", "temperature", body, part="head")
    oracle.add_clip(head, 5, 9)
    oracle.add_clip(head, 15, 22)
    return scene


def test_velocities_are_differences_of_positions(moving: Any) -> None:
    reference = oracle.model_object(moving, bpy.data.objects["Avatar"], "temperature")
    oracle.add_clip(bpy.data.objects["Ball"], 6, 20)
    evaluation = oracle.evaluate(moving, record=("velocities",), rate_hz=20)
    time = evaluation.reader.time
    seen = 0
    for name in ("Ball", "Head"):
        for index, sample in evaluation.samples[name].items():
            places = []
            for at in (index - 1, index + 1):  # clips may begin and end between the indices
                oracle.set_time(moving, time.frame(at))
                places.append(oracle.world_vertices(moving, reference)[sample.vertices])
            expected = (places[1] - places[0]) * 10
            assert sample.positions is None
            # Two positions within 0.001 mm, 1/10 s apart.
            assert np.abs(sample.velocities - expected).max() < 1e-4
            assert np.linalg.norm(sample.velocities, axis=1).max() > 0.3
            seen += 1
    assert seen > 15


def test_velocities_do_not_depend_on_how_time_is_split(
    moving: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = oracle.evaluate(moving, record=("positions", "velocities", "depth"), rate_hz=20)
    monkeypatch.setattr("hfx_blender.reading.scene_reader.BLOCK_SIZE", 5)
    split = oracle.evaluate(moving, record=("positions", "velocities", "depth"), rate_hz=20)
    assert whole.samples.keys() == split.samples.keys() == {"Ball", "Head"}
    for name, samples in whole.samples.items():
        assert samples.keys() == split.samples[name].keys()
        for index, sample in samples.items():
            second = split.of(name, index)
            for field in ("vertices", "weights", "positions", "velocities", "depth_m"):
                one, two = getattr(sample, field), getattr(second, field)
                assert (one is None) == (two is None)
                assert one is None or one.tobytes() == two.tobytes(), (name, index, field)


def test_a_later_range_starts_at_the_right_speed(moving: Any) -> None:
    whole = oracle.evaluate(moving, record=("velocities",), rate_hz=24)
    later = oracle.evaluate(moving, record=("velocities",), rate_hz=24, frames=(10, 24))
    sample, same = later.of("Ball", 0), whole.of("Ball", 9)
    assert sample.vertices.tolist() == same.vertices.tolist()
    assert np.abs(sample.velocities).max() > 0.3
    assert np.allclose(sample.velocities, same.velocities, atol=1e-6)


def test_depth_in_a_ball_and_a_box(moving: Any) -> None:
    ball = bpy.data.objects["Ball"]
    box = oracle.add_volume("Box", "temperature", "CUBOID", (0.0, -0.3, 1.0), size=(0.8, 1.0, 1.4))
    box.rotation_euler = (0.3, 0.2, 0.5)
    evaluation = oracle.evaluate(moving, record=("positions", "depth"))
    for sample in evaluation.samples["Ball"].values():
        from_centre = np.linalg.norm(sample.positions - np.array(ball.location), axis=1)
        assert np.abs(sample.depth_m - (0.6 - from_centre)).max() < TOLERANCE_M
        assert (sample.depth_m >= 0).all()
    assert max(sample.depth_m.max() for sample in evaluation.samples["Ball"].values()) > 0.15
    turn = np.array(box.matrix_world.to_3x3(), np.float64)
    for sample in evaluation.samples["Box"].values():
        local = (sample.positions - np.array(box.location)) @ turn
        expected = (np.array([0.4, 0.5, 0.7]) - np.abs(local)).min(axis=1)
        assert np.abs(sample.depth_m - expected).max() < TOLERANCE_M
    assert all(sample.depth_m is None for sample in evaluation.samples["Head"].values())


def test_depth_in_a_mesh(moving: Any) -> None:
    bpy.ops.mesh.primitive_torus_add(major_radius=0.25, minor_radius=0.2)
    torus = oracle.add_mesh_volume("Ring", "temperature", bpy.context.object)
    torus.parent, torus.location, torus.scale = None, (0.1, -0.5, 1.2), (1.0, 1.2, 0.8)
    evaluation = oracle.evaluate(moving, record=("positions", "depth"), rate_hz=Fraction(5))
    assert evaluation.samples["Ring"]
    for index, sample in evaluation.samples["Ring"].items():
        oracle.set_time(moving, evaluation.reader.time.frame(index))
        expected = oracle.mesh_depths(moving, torus, sample.positions.astype(np.float64))
        assert np.abs(sample.depth_m - expected).max() < TOLERANCE_M


def test_nothing_is_recorded_that_was_not_asked_for(moving: Any) -> None:
    evaluation = oracle.evaluate(moving)
    for samples in evaluation.samples.values():
        for sample in samples.values():
            assert sample.positions is sample.velocities is sample.depth_m is None
