# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances are volumes exactly where and when Blender shows the instances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.tolerance import STANDARD

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
shown = pytest.importorskip("shown")


@pytest.fixture
def stage(scene: Any) -> Any:
    """A body and 12 frames."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    return scene


def _put_away(*objects: Any, name: str = "Source") -> Any:
    """A collection of objects removed from all scenes."""
    collection = bpy.data.collections.new(name)
    for obj in objects:
        for used in list(obj.users_collection):
            used.objects.unlink(obj)
        collection.objects.link(obj)
    return collection


def _instance(collection: Any, name: str, place: Any) -> Any:
    obj = bpy.data.objects.new(name, None)
    obj.instance_type, obj.instance_collection, obj.location = "COLLECTION", collection, place
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _ball(name: str, radius: float, place: Any = (0, 0, 0)) -> Any:
    return oracle.add_volume(name, "vibration", "SPHERE", place, radius=radius)


def _growing(name: str) -> Any:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.1)
    source = bpy.context.object
    mesh = oracle.add_mesh_volume(name, "vibration", source)
    mesh.parent = None
    bpy.data.objects.remove(source)
    mesh.shape_key_add(name="Basis")
    large = mesh.shape_key_add(name="Large")
    for point in large.data:
        point.co *= 3
    for frame, value in ((1, 0.0), (12, 1.0)):
        large.value = value
        large.keyframe_insert("value", frame=frame)
    return mesh


def test_several_volumes_of_a_collection_are_not_mixed_up(stage: Any) -> None:
    big = _ball("zbig", 0.3, (0.1, 0, 0.1))
    oracle.key(big, "hfx.radius", [(1, 0.1), (12, 0.4)])
    _instance(_put_away(_ball("small", 0.06), big, _growing("grow")), "I", (0, 0, 1.1))
    assert len(shown.assert_felt(stage, 60).samples) == 3


@pytest.mark.parametrize("tolerance", [oracle.PAPER, STANDARD])
def test_a_fast_turntable_goes_round(stage: Any, tolerance: Any) -> None:
    table = _instance(_put_away(_ball("arm", 0.1, (0.2, 0, 0))), "Table", (0, 0, 1.1))
    oracle.key(table, "rotation_euler", [(1, (0, 0, 0)), (12, (0, 0, 30.0))])
    actual = oracle.evaluate(stage, rate_hz=96, tolerance=tolerance)
    (block, *_) = actual.reader.blocks()
    places = block.effects[0].matrices[:, :3, 3]
    radii = np.linalg.norm(places[:, :2], axis=1)
    np.testing.assert_allclose(radii, 0.2, atol=1e-5)


def test_a_linked_volume_and_a_local_one_of_its_name(scene: Any, tmp_path: Path) -> None:
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {_put_away(_ball("Ball", 0.25), name="Lib")})
    bpy.ops.wm.read_homefile(use_empty=True)
    stage = bpy.context.scene
    stage.frame_start, stage.frame_end = 1, 4
    oracle.add_avatar()
    with bpy.data.libraries.load(library, link=True) as (_, into):
        into.collections = ["Lib"]
    _instance(into.collections[0], "Linked", (0.1, 0, 1.3))
    local = _ball("Ball", 0.05)
    local.name = "Ball"
    _instance(_put_away(local, name="Local"), "Mine", (0, 0, 0.9))
    actual = shown.assert_felt(stage, 24)
    assert len({effect.id for effect in actual.reader.description.effects}) == 2


def test_nested_instances_and_a_clip_come_and_go(stage: Any) -> None:
    ball = _ball("clipped", 0.15)
    oracle.add_clip(ball, 4, 9)
    inner = _instance(_put_away(ball), "Inner", (0.1, 0, 0))
    outer = _instance(_put_away(inner, name="Outer"), "Top", (0, 0, 1.1))
    oracle.key(outer, "hide_viewport", [(1, False), (6, True), (7, False)])
    actual = oracle.evaluate(stage, rate_hz=96)
    on = {i for samples in actual.samples.values() for i in samples}
    frames = sorted(float(actual.reader.time.frame(i)) for i in on)
    assert frames[0] == 4.0 and frames[-1] <= 9.0
    assert not [frame for frame in frames if 6 <= frame < 7]
    assert {4.0, 4.25, 5.75, 7.0, 8.75} <= set(frames)


def _points(realized: bool) -> Any:
    """Nodes making turned instances of cubes along a line."""
    tree = bpy.data.node_groups.new("Cubes", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    line, cube, position, end = (
        tree.nodes.new(kind)
        for kind in (
            "GeometryNodeMeshLine",
            "GeometryNodeMeshCube",
            "GeometryNodeInstanceOnPoints",
            "NodeGroupOutput",
        )
    )
    line.inputs["Count"].default_value = 3
    line.inputs["Start Location"].default_value = (0, 0, 0.8)
    line.inputs["Offset"].default_value = (0.1, 0, 0.3)
    cube.inputs["Size"].default_value = (0.2, 0.2, 0.1)
    link = tree.links.new
    link(line.outputs[0], position.inputs["Points"])
    link(cube.outputs[0], position.inputs["Instance"])
    last = position.outputs[0]
    if realized:
        real = tree.nodes.new("GeometryNodeRealizeInstances")
        link(last, real.inputs[0])
        last = real.outputs[0]
    link(last, end.inputs[0])
    return tree


@pytest.mark.parametrize("realized", [False, True])
def test_geometry_that_nodes_make_instances_of(stage: Any, realized: bool) -> None:
    volume = _growing("own")
    volume.modifiers.new("Nodes", "NODES").node_group = _points(realized)
    oracle.key(volume, "rotation_euler", [(1, (0, 0, 0)), (12, (0, 0, 6.0))])
    if realized:
        shown.assert_felt(stage, 48, every=5)
        return
    # The object itself has an empty mesh: only the instances exist.
    actual = oracle.evaluate(stage, rate_hz=24)
    assert sum(name.startswith("own ") for name in actual.samples) == 3
    assert "own" not in actual.samples


def test_children_on_vertices_and_hair(stage: Any) -> None:
    bpy.ops.mesh.primitive_plane_add(size=0.4, location=(0, 0, 1.1))
    plane = bpy.context.object
    plane.instance_type = "VERTS"
    child = _ball("child", 0.06)
    child.parent = plane
    bpy.ops.mesh.primitive_plane_add(size=0.4, location=(0, 0, 0.6))
    bpy.ops.object.particle_system_add()
    settings = bpy.context.object.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length = "HAIR", 12, 1.0
    settings.render_type, settings.particle_size = "OBJECT", 1.0
    settings.instance_object = _ball("tip", 0.05)
    _put_away(settings.instance_object)
    oracle.key(plane, "rotation_euler", [(1, (0, 0, 0)), (12, (0, 1, 9.0))])
    shown.assert_felt(stage, 60)
