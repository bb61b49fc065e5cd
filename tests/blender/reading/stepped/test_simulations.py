# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulations without a bake give the same contacts as with a bake."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")


def _cloth(_scene: Any) -> Any:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.3)
    source = bpy.context.object
    volume = oracle.add_mesh_volume("Cloth", "vibration", source)
    volume.parent, volume.location = None, (0, 0, 1.4)
    bpy.data.objects.remove(source)
    modifier = volume.modifiers.new("Cloth", "CLOTH")
    modifier.point_cache.frame_end = 14
    settings = modifier.settings
    settings.use_pressure, settings.uniform_pressure_force = True, 2.0
    return volume


def _soft(_scene: Any) -> Any:
    volume = _cloth(_scene)
    volume.modifiers.clear()
    volume.modifiers.new("Soft", "SOFT_BODY").point_cache.frame_end = 14
    volume.soft_body.use_goal = False
    return volume


def _particles(scene: Any) -> Any:
    ball = oracle.add_volume("Drop", "vibration", "SPHERE", (0, 0, 0), radius=0.1)
    for used in list(ball.users_collection):
        used.objects.unlink(ball)
    bpy.ops.mesh.primitive_plane_add(size=0.6, location=(0, 0, 1.2))
    bpy.ops.object.particle_system_add()
    settings = bpy.context.object.particle_systems[0].settings
    settings.count, settings.frame_end, settings.lifetime = 12, 6, 5
    settings.brownian_factor, settings.particle_size = 6.0, 1.0
    settings.render_type, settings.instance_object = "OBJECT", ball
    return ball


def _felt(scene: Any) -> dict[tuple[str, int], bytes]:
    actual = oracle.evaluate(scene, rate_hz=60)
    return {
        (name, index): sample.vertices.tobytes()
        for name, samples in actual.samples.items()
        for index, sample in samples.items()
    }


@pytest.mark.parametrize("make", [_cloth, _soft, _particles])
def test_unbaked_is_felt_as_baked(scene: Any, make: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 10
    oracle.add_avatar()
    make(scene)
    bpy.context.view_layer.update()
    unbaked = _felt(scene)
    bpy.ops.ptcache.bake_all(bake=True)
    baked = _felt(scene)
    assert unbaked == baked and len(baked) > 10


def test_a_simulation_of_nodes_goes_evenly_between_frames(scene: Any) -> None:
    """The ball rises by 2 cm at each simulated frame, also at the first frame."""
    scene.frame_start, scene.frame_end = 1, 6
    oracle.add_avatar()
    volume = _cloth(scene)
    volume.modifiers.clear()
    tree = bpy.data.node_groups.new("Rise", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    names = ("NodeGroupInput", "GeometryNodeSimulationInput", "GeometryNodeSetPosition")
    names += ("GeometryNodeSimulationOutput", "NodeGroupOutput")
    nodes = [tree.nodes.new(name) for name in names]
    nodes[1].pair_with_output(nodes[3])
    nodes[2].inputs["Offset"].default_value = (0.0, 0.0, 0.02)
    for one, two in itertools.pairwise(nodes):
        taken = (output for output in one.outputs if output.type == "GEOMETRY")
        tree.links.new(next(taken), next(e for e in two.inputs if e.type == "GEOMETRY"))
    volume.modifiers.new("Rise", "NODES").node_group = tree
    reader = oracle.SceneReader(scene, rate_hz=oracle.Fraction(100))
    rise = {}
    for block in reader.blocks():
        (effect,) = block.effects
        which = effect.shapes_at(np.arange(len(effect.levels)))
        for index, k in zip(block.indices.tolist(), which.tolist(), strict=True):
            rise[float(reader.time.frame(index))] = effect.shapes[k].bounds[:, 2].mean()
    start = rise[1.0]
    assert {
        f: r for f, r in rise.items() if f <= 6 and abs(r - start - 0.02 * (f - 1)) > 1e-4
    } == {}


def test_a_second_reading_is_the_same_and_a_cache_stays(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 8
    oracle.add_avatar()
    volume = _cloth(scene)
    bpy.context.view_layer.update()
    for frame in range(1, 12):
        scene.frame_set(frame)
    vertices = oracle.local_vertices(scene, volume)
    cache = volume.modifiers[0].point_cache
    assert _felt(scene) == _felt(scene)
    scene.frame_set(11)
    assert not cache.is_outdated and not cache.is_baked
    assert np.array_equal(oracle.local_vertices(scene, volume), vertices)


def test_under_time_remapping_what_to_bake_is_told(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 4
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 80
    oracle.add_avatar()
    cache = _cloth(scene).modifiers[0].point_cache
    cache.frame_end = 8
    (text,) = oracle.SceneReader(scene).description.warnings
    assert "'Cloth' is not baked: bake it" in text
    assert (scene.render.frame_map_old, scene.render.frame_map_new) == (100, 80)
    bpy.ops.ptcache.bake_all(bake=True)
    assert not oracle.SceneReader(scene).description.warnings


def test_unbaked_paint_and_fluid_are_told_where_they_are_felt(scene: Any) -> None:
    """Between frames Blender gives a different shape of both at each evaluation."""
    oracle.add_avatar()
    bpy.ops.mesh.primitive_cube_add(size=0.3, location=(0.0, 0.0, 1.1))
    canvas = bpy.context.object
    canvas.modifiers.new("Paint", "DYNAMIC_PAINT").ui_type = "CANVAS"
    bpy.ops.dpaint.type_toggle(type="CANVAS")
    (surface,) = canvas.modifiers[0].canvas_settings.canvas_surfaces
    surface.surface_type = "DISPLACE"
    canvas.modifiers.new("Water", "FLUID").fluid_type = "DOMAIN"
    canvas.hfx.role, canvas.hfx.kind, canvas.hfx.shape = "EFFECT", "VOLUME", "MESH"
    messages = [
        "the dynamic paint of 'Cube' is not baked: bake it to feel it",
        "the fluid of 'Cube' is not baked: bake it to feel it",
    ]
    assert [*oracle.SceneReader(scene).description.warnings] == messages
    canvas.hfx.is_muted = True
    oracle.add_volume("Ball", "vibration", "SPHERE", (0, 0, 1.1), radius=0.2)
    reader = oracle.SceneReader(scene)
    assert reader.description.warnings == () and reader.unfelt["Cube"].reason == "is muted"


def test_what_reading_leaves_is_no_fault_of_the_file(scene: Any) -> None:
    """Reading a pointer property never set stores an empty group in 4.5."""
    scene.frame_end = 2
    oracle.add_avatar()
    oracle.add_volume("Ball", "vibration", "SPHERE", (0, 0, 1.1), radius=0.2)
    for _ in range(2):
        assert not oracle.SceneReader(scene).description.warnings
