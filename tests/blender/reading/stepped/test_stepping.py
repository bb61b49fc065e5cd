# SPDX-License-Identifier: GPL-3.0-or-later
"""Every way of reading equals stepping the own scene, or is not used; no data stays behind."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest

from hfx_blender.reading import reading_plan, scene_reader
from hfx_blender.reading.curves import curve_reading
from hfx_blender.reading.curves.animation_curves import NotModelledError
from hfx_blender.reading.description import soundness
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped import stepping

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

OWN = "stepped the whole scene, because "
SCRATCH = "stepped a scratch scene, because "
CURVES = "sampled F-curves, stepped no scene"


def step_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be sampled from F-curves."""

    def refuse(*_arguments: Any) -> None:
        raise NotModelledError("a test wants it")

    monkeypatch.setattr(reading_plan, "CurveEffect", refuse)
    monkeypatch.setattr(reading_plan, "CurveBody", refuse)


def step_own_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stepping, "foreign_handler", lambda: "a test wants it")


@pytest.fixture
def ball(scene: Any) -> Any:
    """A body and a ball touching the body, in a scene of 24 frames."""
    scene.frame_start, scene.frame_end = 1, 24
    scene.frame_set(5)
    oracle.add_avatar()
    return oracle.add_volume("Ball", "temperature", "SPHERE", (0.0, 0.0, 1.2), radius=0.3)


def _assert_same(one: Any, two: Any) -> None:
    assert one.samples.keys() == two.samples.keys()
    for name, samples in one.samples.items():
        assert samples.keys() == two.samples[name].keys()
        for index, sample in samples.items():
            second = two.of(name, index)
            assert sample.level == second.level
            assert sample.parameters.tolist() == second.parameters.tolist()
            assert sample.vertices.tolist() == second.vertices.tolist()
            assert sample.weights.tolist() == second.weights.tolist()


def test_scratch_scene_gives_the_same_as_the_own_scene(
    registered: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the demo: walk, clips, fades, volumes and painted effects."""
    from hfx_tools.demo import garage

    scene = garage.build()
    step_all(monkeypatch)
    scratch = oracle.evaluate(scene, rate_hz=21)
    assert scratch.reader.stepping_note == SCRATCH + "a test wants it"
    assert len(scratch.samples) == 6
    step_own_scene(monkeypatch)
    own = oracle.evaluate(scene, rate_hz=21)
    assert own.reader.stepping_note == OWN + "a test wants it"
    _assert_same(scratch, own)


def test_curves_give_the_same_as_the_own_scene(
    registered: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_tools.demo import garage

    monkeypatch.setattr(SceneReader, "_block_size", lambda *_: 32)
    scene = garage.build()
    sampled = SceneReader(scene, rate_hz=oracle.Fraction(21))
    blocks = list(sampled.blocks())
    assert sampled.stepping_note == CURVES
    step_own_scene(monkeypatch)
    own = SceneReader(scene, rate_hz=oracle.Fraction(21))
    posed = 0
    for block, second in zip(blocks, own.blocks(), strict=True):
        assert block.indices.tolist() == second.indices.tolist()
        for effect, twin in zip(block.effects, second.effects, strict=True):
            assert np.allclose(effect.levels, twin.levels, atol=2e-6)
            on = effect.levels > 0.0
            assert np.allclose(effect.parameters[on], twin.parameters[on], atol=1e-6)
            if effect.matrices is not None:
                assert np.allclose(effect.matrices[on], twin.matrices[on], atol=1e-6)
        (pose,), (twin,) = block.poses, second.poses
        assert pose.valid.tolist() == twin.valid.tolist()
        if pose.valid.any():
            posed += np.count_nonzero(pose.valid)
            assert np.allclose(pose.bones[pose.valid], twin.bones[pose.valid], atol=5e-6)
            assert np.allclose(pose.to_world[pose.valid], twin.to_world[pose.valid], atol=5e-6)
    assert posed > 80


# Scenes without an equal scratch scene


def _driver(effect: Any, path: str, index: int = -1) -> tuple[Any, Any]:
    driver = effect.driver_add(path, index).driver
    driver.type = "SUM"
    return driver, driver.variables.new()


def test_a_driver_that_reads_the_scene(scene: Any, ball: Any) -> None:
    _, variable = _driver(ball, "hfx.temperature")
    variable.targets[0].id_type = "SCENE"
    variable.targets[0].id = scene
    variable.targets[0].data_path = "frame_current"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.reader.stepping_note == OWN + "a driver of 'Ball' reads the scene"
    for index, sample in evaluation.samples["Ball"].items():
        assert sample.parameters.tolist() == [index + 1]


def test_a_driver_that_reads_its_context(scene: Any, ball: Any) -> None:
    _, variable = _driver(ball, "hfx.temperature")
    variable.type = "CONTEXT_PROP"
    variable.targets[0].context_property = "ACTIVE_SCENE"
    variable.targets[0].data_path = "frame_current"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.reader.stepping_note == OWN + "a driver of 'Ball' reads the scene"
    assert evaluation.of("Ball", 11).parameters.tolist() == [12]


def test_a_camera_that_a_marker_switches(scene: Any, ball: Any) -> None:
    """The marker's camera counts at the marker's sample, and the user's own camera is restored."""
    for number, frame in enumerate((1, 13)):
        camera = bpy.data.objects.new(f"Camera {number}", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(camera)
        camera.location.x = 30.0 + number
        scene.timeline_markers.new(camera.name, frame=frame).camera = camera
    scene.camera = camera
    _, variable = _driver(ball, "hfx.temperature")
    variable.type = "CONTEXT_PROP"
    variable.targets[0].context_property = "ACTIVE_SCENE"
    variable.targets[0].data_path = "camera.location.x"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    for index, sample in evaluation.samples["Ball"].items():
        assert sample.parameters.tolist() == [30 + (index >= 12)]
    assert scene.camera == camera


def test_metaballs_of_one_name_make_one_surface(
    scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the first is an effect; the second, without an effect, widens the surface."""
    bpy.data.objects.remove(ball)
    for x in (0.0, 0.25):
        bpy.ops.object.metaball_add(type="BALL", radius=0.25, location=(x, 0.0, 1.2))
        bpy.context.object.data.resolution = 0.06
    first = bpy.data.objects["Mball"]
    first.hfx.role, first.hfx.shape, first.hfx.modality = "EFFECT", "MESH", "temperature"
    scratch = oracle.evaluate(scene, frames=(1, 1), rate_hz=24)
    assert scratch.reader.stepping_note == SCRATCH + "'Mball' is no mesh"
    step_own_scene(monkeypatch)
    own = oracle.evaluate(scene, frames=(1, 1), rate_hz=24)
    assert own.of("Mball", 0).vertices.size > 3
    _assert_same(scratch, own)


def test_a_lattice_that_is_the_parent_deforms_as_its_modifier_does(scene: Any, ball: Any) -> None:
    cage = bpy.data.objects.new("Cage", bpy.data.lattices.new("Cage"))
    scene.collection.objects.link(cage)
    cage.location.z = 1.2
    cage.data.points[0].co_deform.x -= 0.2
    oracle.key(cage, "scale", [(1, (0.4, 0.4, 0.4)), (24, (0.8, 0.8, 0.8))])
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.3)
    bag = oracle.add_mesh_volume("Bag", "temperature", bpy.context.object)
    bag.parent = cage
    bag.modifiers.new("Lattice", "LATTICE").object = cage
    by_modifier = oracle.evaluate(scene, rate_hz=6)
    bag.modifiers.clear()
    bag.parent_type = "LATTICE"
    by_parent = oracle.evaluate(scene, rate_hz=6)
    sizes = {len(sample.vertices) for sample in by_parent.samples["Bag"].values()}
    assert len(sizes) > 2
    _assert_same(by_modifier, by_parent)


def test_a_modifier_that_is_switched_on_later(scene: Any, ball: Any) -> None:
    bpy.ops.mesh.primitive_ico_sphere_add(radius=0.3)
    bag = oracle.add_mesh_volume("Bag", "temperature", bpy.context.object)
    bag.modifiers.new("Smooth", "SMOOTH").show_viewport = False
    assert curve_reading.is_rigid(bag)
    oracle.key(bag, 'modifiers["Smooth"].show_viewport', [(12, True), (1, False)])
    assert not curve_reading.is_rigid(bag)


def test_faults_that_differ_in_numbers_only_are_told_once() -> None:
    faults: dict[str, set[int]] = {}
    soundness.add_fault(faults, "'a' is not closed: 3 of its 9 edges", 1)
    soundness.add_fault(faults, "'a' is not closed: 4 of its 9 edges", 2)
    soundness.add_fault(faults, "'b' is not closed: 4 of its 9 edges", 2)
    assert faults == {
        "'a' is not closed: 3 of its 9 edges": {1, 2},
        "'b' is not closed: 4 of its 9 edges": {2},
    }


def test_a_driver_of_other_objects_is_no_reason(scene: Any, ball: Any) -> None:
    lever = oracle.empty(scene)
    oracle.key(lever, "location", [(1, (0, 0, 0)), (24, (0, 0, 23))])
    _, variable = _driver(ball, "hfx.temperature")
    variable.type = "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = lever, "LOC_Z"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.reader.stepping_note == SCRATCH + "'Ball' has drivers"
    assert evaluation.of("Ball", 0).parameters[0] == pytest.approx(0.0, abs=1e-5)
    assert evaluation.of("Ball", 23).parameters[0] == pytest.approx(23.0, abs=1e-5)


@pytest.fixture
def lifting(ball: Any) -> Iterator[Any]:
    """Frame-change handler lifting the ball."""

    def lift(scene: Any, _graph: Any) -> None:
        bpy.data.objects["Ball"].location.z = 0.5 + 0.05 * scene.frame_current

    yield lift
    bpy.app.handlers.frame_change_pre.clear()


@pytest.mark.parametrize("is_partial", [False, True])
def test_a_handler_on_frame_changes(scene: Any, lifting: Any, is_partial: bool) -> None:
    handler = functools.partial(lifting) if is_partial else lifting
    bpy.app.handlers.frame_change_pre.append(handler)
    evaluation = oracle.evaluate(scene, record=("positions",), rate_hz=24)
    name = "partial" if is_partial else "lift"
    assert evaluation.reader.stepping_note == OWN + f"the handler '{name}' runs on frame changes"
    heights = [sample.positions[:, 2].mean() for sample in evaluation.samples["Ball"].values()]
    assert heights[-1] - heights[0] > 0.5


def test_code_that_reads_the_scene(scene: Any, ball: Any) -> None:
    """Data read by a driver's code is unknown: some frames are compared, the own scene wins."""
    bpy.app.driver_namespace["lift"] = lambda: 0.02 * bpy.context.scene.frame_current
    ball.driver_add("location", 2).driver.expression = "lift()"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    del bpy.app.driver_namespace["lift"]
    assert evaluation.reader.stepping_note == (
        OWN + "a few frames came out differently in a scratch scene"
    )


@pytest.mark.parametrize("is_code", [False, True])
def test_only_code_has_the_users_scene_evaluated(
    scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch, is_code: bool
) -> None:
    """Evaluation of the user's scene includes objects without contact."""
    visits: list[Any] = []
    real = stepping.Stepper.set_frame

    def counted(self: stepping.Stepper, frame: Any) -> None:
        visits.append(self.is_own)
        real(self, frame)

    monkeypatch.setattr(stepping.Stepper, "set_frame", counted)
    expression = "max(*[0.1, 0.2])" if is_code else "0.2 * sin(frame)"
    ball.driver_add("location", 2).driver.expression = expression
    list(SceneReader(scene, rate_hz=oracle.Fraction(24)).blocks())
    assert any(visits) == is_code
    assert not all(visits)


def test_physics(scene: Any, ball: Any) -> None:
    """A ball parented to a falling body falls by gravity, also between frames."""
    scene.frame_end = 12
    bpy.ops.rigidbody.world_add()
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.0, 0.0, 1.5))
    cube = bpy.context.object
    bpy.ops.rigidbody.object_add()
    cube.rigid_body.linear_damping = 0.0
    ball.parent, ball.location = cube, (0.0, 0.0, 0.0)
    oracle.add_clip(ball, 6, 12)
    reader = SceneReader(scene, rate_hz=oracle.Fraction(50))
    heights = {}
    for block in reader.blocks():
        for index, matrix in zip(block.indices.tolist(), block.effects[0].matrices, strict=True):
            heights[index] = matrix[2, 3]
    assert reader.stepping_note == OWN + f"physics moves '{cube.name}'"
    assert sorted(heights) == reader.sample_indices.tolist()
    for index, height in heights.items():
        seconds = (float(reader.time.frame(index)) - 1) / 24
        # The solver's steps of 1/240 s, and straight lines between frames.
        assert height == pytest.approx(1.5 - 0.5 * 9.81 * seconds**2, abs=0.02)


# Nothing is left behind


def _everything(scene: Any) -> dict[str, Any]:
    lists = {
        prop.identifier: sorted(item.name for item in getattr(bpy.data, prop.identifier))
        for prop in bpy.data.bl_rna.properties
        if prop.type == "COLLECTION"
    }
    objects = {
        obj.name: (
            np.array(obj.matrix_world).round(9).tolist(),
            tuple(obj.location),
            obj.hfx.activation,
            obj.hide_viewport,
            obj.users,
            [collection.name for collection in obj.users_collection],
        )
        for obj in bpy.data.objects
    }
    bones = {
        bone.name: np.array(bone.matrix).round(6).tolist()
        for bone in bpy.data.objects["Avatar"].pose.bones
    }
    frame = scene.frame_current, scene.frame_subframe
    return {**lists, "_objects": objects, "_bones": bones, "_frame": frame}


def test_curves_that_come_out_otherwise_are_not_used(
    scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    oracle.key(ball, "location", [(1, (0, 0, 1.2)), (24, (0, 0.1, 1.2))])
    truth = oracle.evaluate(scene)
    assert truth.reader.stepping_note == CURVES
    real = reading_plan.CurveEffect.read

    def askew(self: Any, frames: Any) -> Any:
        block = real(self, frames)
        block.matrices[:, 0, 3] += 2e-4
        return block

    monkeypatch.setattr(reading_plan.CurveEffect, "read", askew)
    evaluation = oracle.evaluate(scene)
    assert evaluation.reader.stepping_note == (
        SCRATCH + "a few frames came out differently from F-curves"
    )
    assert {index: len(s.vertices) for index, s in evaluation.samples["Ball"].items()} == {
        index: len(s.vertices) for index, s in truth.samples["Ball"].items()
    }


def test_a_still_volume_is_not_stepped(
    scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sphere at rest below a rotated parent is placed without steps of the scene."""
    scene.frame_end = 480  # several chunks of samples
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.rotation_euler, parent.delta_location = (0.3, 0.2, 0.1), (0.1, 0.0, 0.0)
    ball.parent, ball.scale = parent, (1.0, 1.2, 0.7)
    quick = oracle.evaluate(scene)
    assert quick.reader.stepping_note == CURVES and quick.reader.counters.effects_read == 0
    step_own_scene(monkeypatch)
    _assert_same(quick, oracle.evaluate(scene))


@pytest.fixture(params=["curves", "scratch", "own"])
def busy(request: Any, scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """An animated scene, standing at a sub-frame."""
    body = bpy.data.objects["Avatar"]
    oracle.add_walk(body, [(0, 0, 0), (0, -1, 0)], 1, 24)
    oracle.add_clip(ball, 4, 20, fade_in=3)
    oracle.key(ball, "location", [(1, (0, 0, 1.2)), (24, (0, -1, 1.2))])
    if request.param != "curves":
        step_all(monkeypatch)
    if request.param == "own":
        step_own_scene(monkeypatch)
    scene.frame_set(7, subframe=0.25)
    return scene


def _read_all(scene: Any) -> None:
    assert sum(len(block.indices) for block in SceneReader(scene).blocks()) > 50


def _stop_half_way(scene: Any) -> None:
    blocks = SceneReader(scene).blocks()
    next(blocks)
    blocks.close()


def _drop_it(scene: Any) -> None:
    next(SceneReader(scene).blocks())


def _fail_in_the_consumer(scene: Any) -> None:
    with pytest.raises(ZeroDivisionError):
        for _ in SceneReader(scene).blocks():
            raise ZeroDivisionError


def _fail_in_the_reader(scene: Any) -> None:
    reader = SceneReader(scene)
    real, calls = stepping.Stepper.set_frame, []

    def failing(self: stepping.Stepper, frame: Any) -> None:
        calls.append(frame)
        if len(calls) > 3:
            raise KeyboardInterrupt
        real(self, frame)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(stepping.Stepper, "set_frame", failing)
        list(reader.blocks())


@pytest.mark.parametrize(
    "way", [_read_all, _stop_half_way, _drop_it, _fail_in_the_consumer, _fail_in_the_reader]
)
def test_nothing_is_left_behind(busy: Any, way: Any) -> None:
    before = _everything(busy)
    assert before["_frame"] == (7, 0.25)
    way(busy)
    after = _everything(busy)
    for key, value in before.items():
        assert after[key] == value, key


def test_muted_volumes_are_not_evaluated_with_the_own_scene(scene: Any, ball: Any) -> None:
    """Unless needed: a parent of an active effect, a collider of a simulated object."""
    test_a_driver_that_reads_the_scene(scene, ball)
    idle, parent, collider = (
        oracle.add_volume(name, "pressure", "SPHERE", (0.0, 0.0, 3.0), radius=0.1)
        for name in ("Idle", "Parent", "Collider")
    )
    ball.parent = parent
    collider.modifiers.new("Collision", "COLLISION")
    for muted in (idle, parent, collider):
        muted.hfx.is_muted = True
    reader, there = SceneReader(scene), []
    with pytest.raises(KeyboardInterrupt), stepping.own_scene(reader.found) as stepper:
        stepper.set_frame(oracle.Fraction(3))
        there = [obj for obj in reader.found.dormant if stepper.evaluated(obj).is_evaluated]
        raise KeyboardInterrupt
    assert set(there) == {parent, collider}
    graph = bpy.context.view_layer.depsgraph
    assert not idle.hide_viewport
    assert idle.evaluated_get(graph).is_evaluated


def _moving_cube(scene: Any, name: str = "Prop") -> Any:
    mesh = bpy.data.meshes.new(name)
    low, high = (-0.1, 0.1)
    corners = [(x, y, z) for x in (low, high) for y in (low, high) for z in (low, high)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 2, 6, 4), (1, 5, 7, 3)])
    prop = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(prop)
    oracle.key(prop, "location", [(1, (0, 0, 1)), (24, (1, -1, 1.5))])
    return prop


def _by_parent(scene: Any, ball: Any, prop: Any) -> None:
    above = oracle.empty(scene, parent=prop)
    ball.parent = above


def _by_constraint(scene: Any, ball: Any, prop: Any) -> None:
    ball.constraints.new("COPY_LOCATION").target = prop


def _by_driver(scene: Any, ball: Any, prop: Any) -> None:
    _, variable = _driver(ball, "location", 0)
    variable.type = "TRANSFORMS"
    variable.targets[0].id = prop


def _by_vertices(scene: Any, ball: Any, prop: Any) -> None:
    prop.modifiers.new("Wave", "WAVE")
    ball.parent, ball.parent_type = prop, "VERTEX_3"
    ball.parent_vertices = (0, 1, 2)


def _by_shrinkwrap(scene: Any, ball: Any, prop: Any) -> None:
    ball.constraints.new("SHRINKWRAP").target = prop


def _by_path(scene: Any, ball: Any, prop: Any) -> None:
    curve = bpy.data.curves.new("Path", "CURVE")
    curve.dimensions = "3D"
    curve.splines.new("POLY").points.add(1)
    curve.splines[0].points[1].co = (0, 1, 0, 1)
    path = bpy.data.objects.new("Path", curve)
    scene.collection.objects.link(path)
    path.parent = prop
    follow = ball.constraints.new("FOLLOW_PATH")
    follow.target, follow.use_fixed_location, follow.offset_factor = path, True, 0.5


def _by_bone(scene: Any, ball: Any, prop: Any) -> None:
    armature = bpy.data.armatures.new("Other")
    second = bpy.data.objects.new("Other", armature)
    scene.collection.objects.link(second)
    bpy.context.view_layer.objects.active = second
    bpy.ops.object.mode_set(mode="EDIT")
    armature.edit_bones.new("Bone").tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    second.pose.bones["Bone"].constraints.new("COPY_LOCATION").target = prop
    ball.parent, ball.parent_type, ball.parent_bone = second, "BONE", "Bone"


def _by_displacing(scene: Any, ball: Any, prop: Any) -> None:
    """Place the prop by a texture of the parent's mesh."""
    cube = _moving_cube(scene, "Shaped")
    displace = cube.modifiers.new("Displace", "DISPLACE")
    displace.texture = bpy.data.textures.new("Clouds", "CLOUDS")
    displace.texture_coords, displace.texture_coords_object = "OBJECT", prop
    ball.parent, ball.parent_type = cube, "VERTEX"


def _by_nodes(scene: Any, ball: Any, prop: Any) -> None:
    """Place the prop in a collection shown by nodes of the parent's mesh."""
    shown = bpy.data.collections.new("Shown")
    shown.objects.link(prop)
    cube = _moving_cube(scene, "Shows")
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes = [
        tree.nodes.new(f"GeometryNode{entry}") for entry in ("CollectionInfo", "RealizeInstances")
    ]
    nodes.append(tree.nodes.new("NodeGroupOutput"))
    nodes[0].inputs["Collection"].default_value = shown
    for one, second in itertools.pairwise(nodes):
        tree.links.new(one.outputs[0], second.inputs[0])
    cube.modifiers.new("Nodes", "NODES").node_group = tree
    ball.parent, ball.parent_type = cube, "VERTEX"


def _evaluated_beside(scene: Any, ball: Any) -> set[bool]:
    """Test if a bystander is evaluated in the own scene.

    The ball must be placed as by Blender with everything evaluated.
    """
    bystander = _moving_cube(scene, "Bystander")
    graph, places, actual = bpy.context.view_layer.depsgraph, {}, set()
    for frame in range(1, 25):
        scene.frame_set(frame)
        places[frame] = np.array(ball.evaluated_get(graph).matrix_world)
    assert not np.array_equal(places[1], places[24])
    reader = SceneReader(scene)
    with stepping.own_scene(reader.found) as stepper:
        for frame, position in places.items():
            stepper.set_frame(oracle.Fraction(frame))
            assert np.array_equal(stepper.evaluated(ball).matrix_world, position)
            actual.add(bool(stepper.evaluated(bystander).is_evaluated))
    assert not bystander.hide_viewport
    return actual


@pytest.mark.parametrize(
    "depend",
    [
        *(_by_parent, _by_constraint, _by_driver, _by_vertices, _by_shrinkwrap, _by_path),
        *(_by_bone, _by_displacing, _by_nodes),
    ],
)
def test_the_own_scene_evaluates_what_the_felt_depends_on(
    scene: Any, ball: Any, depend: Any
) -> None:
    """And nothing else."""
    test_a_driver_that_reads_the_scene(scene, ball)
    prop = _moving_cube(scene)
    depend(scene, ball, prop)
    assert _evaluated_beside(scene, ball) == {False}
    assert not prop.hide_viewport


def test_a_driver_that_goes_through_the_objects_of_the_scene(scene: Any, ball: Any) -> None:
    """Blender's dependency graph does not follow such a path."""
    prop = _moving_cube(scene)
    _, variable = _driver(ball, "location", 0)
    variable.targets[0].id_type, variable.targets[0].id = "SCENE", scene
    variable.targets[0].data_path = f'objects["{prop.name}"].location[0]'
    assert _evaluated_beside(scene, ball) == {True}


def test_an_interrupt_while_the_own_scene_is_restored(
    scene: Any, ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    test_a_driver_that_reads_the_scene(scene, ball)
    bystander = _moving_cube(scene)
    scene.frame_set(5)
    actual = SceneReader(scene).found

    class Late:
        """Stand-in for an object: the first unhiding raises KeyboardInterrupt."""

        shown: ClassVar[list[bool]] = []

        def __setattr__(self, _name: str, value: bool) -> None:
            if not value and not self.shown:
                self.shown.append(True)
                raise KeyboardInterrupt

        hide_viewport = False

    monkeypatch.setattr(stepping, "idle_objects", lambda _found: [Late(), bystander])
    with pytest.raises(KeyboardInterrupt), stepping.own_scene(actual) as stepper:
        stepper.set_frame(oracle.Fraction(9))
        assert bystander.hide_viewport
    assert not bystander.hide_viewport
    assert scene.frame_current == 5


def test_where_code_may_read_anything_all_of_the_own_scene_is_evaluated(
    scene: Any, ball: Any
) -> None:
    bystander = _moving_cube(scene, "Bystander")
    driver, _ = _driver(ball, "hfx.temperature")
    driver.type, driver.expression = "SCRIPTED", "len(str(var))"
    reader = SceneReader(scene)
    with stepping.own_scene(reader.found) as stepper:
        stepper.set_frame(oracle.Fraction(3))
        assert stepper.evaluated(bystander).is_evaluated


def test_a_scene_that_is_not_the_active_one(scene: Any, ball: Any) -> None:
    second = bpy.data.scenes.new("Other")
    for obj in scene.objects:
        second.collection.objects.link(obj)
    second.frame_start, second.frame_end = 1, 10
    here, there = oracle.evaluate(scene, frames=(1, 10)), oracle.evaluate(second)
    assert bpy.context.scene == scene
    _assert_same(here, there)
    assert sorted(entry.name for entry in bpy.data.scenes) == ["Other", scene.name]


def test_blocks_are_cut_at_multiples() -> None:
    cut = [
        block.tolist()
        for block in scene_reader.contiguous_blocks(np.array([0, 1, 30, 31, 32, 33, 70]), 32)
    ]
    assert cut == [[0, 1], [30, 31], [32, 33], [70]]
    assert list(scene_reader.contiguous_blocks(np.zeros(0, np.int64), 32)) == []
