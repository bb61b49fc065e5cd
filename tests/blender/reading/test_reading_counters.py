# SPDX-License-Identifier: GPL-3.0-or-later
"""Counters of reading: effects without contact are not made, indexed, evaluated or stepped for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.counters import ReadingCounters, as_reported
from hfx_blender.reading.stepped.stepped_volumes import FarVolumes

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

RATE_HZ = 24
NEAR, FAR = (0.0, 0.0, 1.2), (30.0, 0.0, 1.2)


@pytest.fixture
def felt(scene: Any) -> Any:
    """A scene of 12 frames with a body and a touching volume."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    return oracle.add_volume("Felt", "pressure", "SPHERE", NEAR, radius=0.2)


def _ball(name: str, place: Any) -> Any:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=0.3)
    source = bpy.context.object
    effect = oracle.add_mesh_volume(name, "vibration", source)
    effect.parent, effect.location = None, place
    bpy.data.objects.remove(source)
    return effect


def formula(place: Any) -> Any:
    return oracle.add_volume("Formula", "vibration", "CUBOID", place, size=(0.4, 0.4, 0.4))


def static(place: Any) -> Any:
    return _ball("Static", place)


def deforming(place: Any) -> Any:
    effect = _ball("Deforming", place)
    modifier = effect.modifiers.new("Bend", "SIMPLE_DEFORM")
    oracle.key(effect, f'modifiers["{modifier.name}"].angle', [(1, 0.0), (12, 1.0)])
    return effect


def constrained(place: Any) -> Any:
    """With a keyed size, and a driven strength."""
    effect = oracle.add_volume("Constrained", "wind", "CAPSULE", place, radius=0.2, height=0.8)
    effect.constraints.new("LIMIT_LOCATION")
    oracle.key(effect, "hfx.radius", [(1, 0.1), (12, 0.3)])
    variable = effect.driver_add("hfx.amplitude").driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = effect, "location.x"
    return effect


def parented(place: Any) -> Any:
    lever = oracle.empty(bpy.context.scene, "Lever")
    lever.location = place
    lever.constraints.new("COPY_ROTATION").target = bpy.data.objects["Felt"]
    effect = oracle.add_volume("Parented", "temperature", "CYLINDER", (0, 0, 0), radius=0.2)
    effect.parent = lever
    return effect


KINDS = (formula, static, deforming, constrained, parented)


def _collected(source: Any) -> None:
    """The source as an instanced collection; only the instance is in the scene."""
    collection = bpy.data.collections.new("Shown")
    for used in source.users_collection:
        used.objects.unlink(source)
    collection.objects.link(source)
    shown = oracle.empty(bpy.context.scene, "Shows")
    shown.instance_type, shown.instance_collection = "COLLECTION", collection


def _by_nodes(source: Any) -> None:
    """The source, shown by a geometry nodes modifier."""
    group = bpy.data.node_groups.new("Shows", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    taken = group.nodes.new("GeometryNodeObjectInfo")
    taken.inputs["Object"].default_value, taken.inputs["As Instance"].default_value = source, True
    group.links.new(taken.outputs["Geometry"], group.nodes.new("NodeGroupOutput").inputs[0])
    bpy.ops.mesh.primitive_plane_add(location=FAR)
    bpy.context.object.modifiers.new("Shows", "NODES").node_group = group


def _by_particles(source: Any) -> None:
    bpy.ops.mesh.primitive_plane_add(size=1, location=FAR)
    bpy.ops.object.particle_system_add()
    settings = bpy.context.object.particle_systems[0].settings
    settings.count, settings.render_type, settings.instance_object = 20, "OBJECT", source


SHOWN = (_collected, _by_nodes, _by_particles)


def mute(effect: Any) -> None:
    effect.hfx.is_muted = True


def silence(effect: Any) -> None:
    effect.hfx.intensity = 0.0


def mute_its_clip(effect: Any) -> None:
    oracle.add_clip(effect, 2, 5).mute = True


def play_it_later(effect: Any) -> None:
    oracle.add_clip(effect, 100, 110)


def always_on(volumes: FarVolumes, frames: Any) -> Any:
    return np.ones((len(volumes.numbers), len(frames)), np.bool_)


def _without_names(counters: ReadingCounters) -> dict[str, Any]:
    return {**counters.as_dict(), "skipped": {}}


def _entries(evaluation: Any, name: str = "Felt") -> dict[int, tuple[list[int], list[float]]]:
    actual = evaluation.samples[name].items()
    return {index: (item.vertices.tolist(), item.weights.tolist()) for index, item in actual}


@pytest.mark.parametrize("change", [mute, silence, mute_its_clip, play_it_later])
def test_what_cannot_be_felt_takes_nothing(
    scene: Any, felt: Any, change: Callable[[Any], None]
) -> None:
    alone = oracle.evaluate(scene, rate_hz=RATE_HZ)
    for kind in KINDS:
        change(kind(NEAR))
    for shown in SHOWN:
        source = oracle.add_volume(shown.__name__, "vibration", "SPHERE", NEAR, radius=0.1)
        change(source)
        shown(source)
    evaluation = oracle.evaluate(scene, rate_hz=RATE_HZ)
    read = evaluation.reader.counters
    assert _without_names(read) == _without_names(alone.reader.counters)
    assert {"Formula", "Static", "Deforming", "Constrained", "Parented"} <= read.skipped.keys()
    assert evaluation.counters.as_dict() == alone.counters.as_dict()
    assert _entries(evaluation) == _entries(alone)


def test_of_what_is_far_only_places_are_read(scene: Any, felt: Any) -> None:
    alone = oracle.evaluate(scene, rate_hz=RATE_HZ)
    for kind in KINDS:
        kind(FAR)
    evaluation = oracle.evaluate(scene, rate_hz=RATE_HZ)
    read, samples = evaluation.reader.counters, evaluation.reader.time.sample_count
    stepped = {"Deforming", "Constrained", "Parented"}
    assert as_reported(read.as_dict())["far"] == dict.fromkeys(stepped, samples)
    assert read.places_read == len(stepped) * samples
    probes = read.times_stepped - samples  # comparisons with Blender's evaluation
    assert probes <= 10 and read.effects_read <= probes * (1 + len(KINDS))
    assert read.meshes_made == 1  # the static mesh, once, for the early warning about holes
    assert evaluation.counters.meshes_searched == 0
    assert evaluation.counters.vertices_posed == alone.counters.vertices_posed
    assert _entries(evaluation) == _entries(alone)


@pytest.mark.parametrize("kind", [deforming, constrained])
def test_blocks_of_samples_outside_a_clip_are_not_stepped(
    scene: Any, felt: Any, kind: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In reach, and on at 12 of 96 frames: blocks have 32 samples."""
    scene.frame_end = 96
    oracle.add_clip(kind(NEAR), 40, 52)
    lazy = oracle.evaluate(scene, rate_hz=RATE_HZ)
    read = lazy.reader.counters
    assert read.times_stepped <= 2 * 33 + 10  # a block, read again in full near the skin; probes
    assert read.meshes_made <= 33
    name = kind.__name__.capitalize()
    monkeypatch.setattr(FarVolumes, "may_be_on", always_on)
    whole = oracle.evaluate(scene, rate_hz=RATE_HZ)
    assert whole.reader.counters.times_stepped >= 96
    assert _entries(lazy) == _entries(whole)
    assert _entries(lazy, name) == _entries(whole, name) != {}


def test_what_comes_near_is_counted(scene: Any, felt: Any) -> None:
    """The reverse case, as a check of the tests above."""
    for kind in KINDS:
        kind(NEAR)
    evaluation = oracle.evaluate(scene, rate_hz=RATE_HZ)
    assert set(evaluation.samples) == {"Felt", *(kind.__name__.capitalize() for kind in KINDS)}
    read = evaluation.reader.counters
    assert read.far == {} and read.meshes_made > evaluation.reader.time.sample_count
    assert evaluation.counters.meshes_searched == 2 * evaluation.reader.time.sample_count


def test_a_body_that_nothing_reaches_is_not_looked_at(scene: Any, felt: Any) -> None:
    alone = oracle.evaluate(scene, rate_hz=RATE_HZ)
    avatar = oracle.add_avatar()
    avatar.location = FAR
    avatar.pose.bones["head"].constraints.new("DAMPED_TRACK").target = felt
    evaluation = oracle.evaluate(scene, rate_hz=RATE_HZ)
    assert len(evaluation.reader.description.bodies) == 2
    assert evaluation.reader.counters.poses_read >= evaluation.reader.time.sample_count
    assert len(evaluation.counters.bodies_reached) == 1
    assert evaluation.counters.vertices_posed == alone.counters.vertices_posed
    assert _entries(evaluation) == _entries(alone)


def test_a_mesh_is_read_where_it_is_near_in_the_users_own_scene(scene: Any, felt: Any) -> None:
    """With a driver, so that the scene is stepped."""
    variable = felt.driver_add("location", 1).driver.variables.new()
    variable.targets[0].id_type, variable.targets[0].id = "SCENE", scene
    variable.targets[0].data_path = "frame_current"
    felt.animation_data.drivers[0].driver.expression = "0.0 * frame_current"
    effect = deforming(FAR)
    away = oracle.evaluate(scene, rate_hz=RATE_HZ)
    assert "the whole scene" in away.reader.stepping_note
    assert away.reader.counters.meshes_read == away.reader.counters.meshes_made == 0
    effect.location = NEAR
    assert oracle.evaluate(scene, rate_hz=RATE_HZ).samples["Deforming"]
