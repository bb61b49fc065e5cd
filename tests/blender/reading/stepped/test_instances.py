# SPDX-License-Identifier: GPL-3.0-or-later
"""Many small objects: instances and particles of a haptic volume are felt like volumes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import oracle
import pytest

from hfx_blender.authoring.effects import effects
from hfx_blender.engine.counters import Unfelt
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.samples import SampleRun
from hfx_blender.errors import InputError
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.reading.scene_reader import SceneReader

FPS = 25
BELLY = (0.0, -0.15, 1.08)
PLACES = (BELLY, (0.0, 0.06, 1.08), (5.0, 0.0, 0.0))


@pytest.fixture
def ball(scene: Any) -> Any:
    """A ball of 4 cm in a collection outside of all scenes; an avatar stands at the origin."""
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, 9
    scene.hfx.rate = FPS
    bpy.ops.hfx.add_avatar()
    ball = effects.add_volume(scene, "vibration", "SPHERE", "Ball")
    ball.hfx.radius = 0.04
    for collection in list(ball.users_collection):
        collection.objects.unlink(ball)
    bpy.data.collections.new("Source").objects.link(ball)
    return ball


def _empty(name: str, place: tuple[float, float, float]) -> Any:
    empty = bpy.data.objects.new(name, None)
    empty.instance_type = "COLLECTION"
    empty.instance_collection = bpy.data.collections["Source"]
    empty.location = place
    bpy.context.scene.collection.objects.link(empty)
    return empty


def _read(**settings: Any) -> tuple[list[SampleRun], SceneReader]:
    reader = SceneReader(bpy.context.scene, **settings)
    engine = Engine(reader.description)
    return [run for block in reader.blocks() for run in engine.evaluate(block)], reader


def _felt(runs: list[SampleRun]) -> set[tuple[Any, ...]]:
    return {
        (int(i), s.level, s.vertices.tobytes(), s.weights.tobytes())
        for run in runs
        for i, s in zip(run.indices, run, strict=True)
    }


def test_a_collection_instance_is_felt_like_the_volume_itself(ball: Any) -> None:
    for k, position in enumerate(PLACES):
        _empty(f"Here {k}", position)
    instances, reader = _read()
    assert [e.name for e in reader.description.effects] == [f"Ball Here {k} 0" for k in range(3)]
    assert {run.stream.effect_id for run in instances} == {
        f"{ball.hfx.uid}:Here 0 0",
        f"{ball.hfx.uid}:Here 1 0",
    }
    for k in range(3):
        bpy.data.objects.remove(bpy.data.objects[f"Here {k}"])
    for position in PLACES:
        copy = ball.copy()
        copy.location = position
        bpy.context.scene.collection.objects.link(copy)
    alone, _ = _read()
    assert _felt(instances) == _felt(alone) and instances


def test_instances_are_read_between_frames_and_are_the_same_in_any_part(ball: Any) -> None:
    empty = _empty("Here", (0.0, -0.5, 1.08))
    empty.keyframe_insert("location", frame=0)
    empty.location = (0.0, 0.4, 1.08)
    empty.keyframe_insert("location", frame=9)
    bpy.context.scene.hfx.rate = 100.0
    _, reader = _read()
    (block, *_) = reader.blocks()
    places = block.effects[0].matrices[:, :3, 3]
    for quarter in range(4):  # 100 samples a second, 25 frames
        bpy.context.scene.frame_set(2, subframe=quarter / 4)
        np.testing.assert_allclose(places[8 + quarter], empty.matrix_world.translation, atol=1e-6)
    part = [run.stream.effect_id for run in _read(frames=(3, 5))[0]]
    assert set(part) == {f"{ball.hfx.uid}:0"}


def test_an_instance_that_is_there_between_two_frames_only(ball: Any) -> None:
    for where, position in (("Here", BELLY), ("There", PLACES[2])):
        shown = _empty(where, position)
        oracle.key(shown, "hide_viewport", [(0, True), (4.2, False), (4.8, True)])
    bpy.context.scene.hfx.rate = 4 * FPS
    runs, reader = _read()
    assert np.concatenate([run.indices for run in runs]).tolist() == [17, 18, 19]
    assert not reader.faults


def test_clips_and_values_of_the_source_are_those_of_all_its_instances(ball: Any) -> None:
    _empty("Here", BELLY)
    bpy.context.scene.collection.objects.link(ball)
    bpy.context.view_layer.objects.active = ball
    ball.hfx.amplitude = 1.0
    ball.keyframe_insert("hfx.amplitude", frame=0)
    ball.hfx.amplitude = 10.0
    ball.keyframe_insert("hfx.amplitude", frame=9)
    bpy.ops.hfx.add_clip(start=4, duration=3 / FPS)
    bpy.context.scene.collection.objects.unlink(ball)
    runs, _ = _read()
    indices = np.concatenate([run.indices for run in runs])
    assert indices.min() == 4 and indices.max() in (6, 7)
    amplitudes = np.concatenate([run.parameters[:, 0] for run in runs])
    assert (np.diff(amplitudes) > 0.1).all()
    ball.hfx.is_muted = True
    with pytest.raises(InputError, match="no haptic effects"):
        _read()


def _emitter(ball: Any, count: int = 12) -> Any:
    mesh = bpy.data.meshes.new("Wall")
    y = -0.6
    mesh.from_pydata(
        [(-0.1, y, 1.0), (0.1, y, 1.0), (0.1, y, 1.2), (-0.1, y, 1.2)], [], [(0, 1, 2, 3)]
    )
    wall = bpy.data.objects.new("Wall", mesh)
    bpy.context.scene.collection.objects.link(wall)
    system = wall.modifiers.new("Rain", "PARTICLE_SYSTEM").particle_system
    system.settings.count = count
    system.settings.frame_start, system.settings.frame_end = 1, 5
    system.settings.lifetime = 4
    system.settings.normal_factor = 0.0
    system.settings.object_align_factor = (0.0, 4.0, 0.0)
    system.settings.effector_weights.gravity = 0.0
    system.settings.render_type = "OBJECT"
    system.settings.instance_object = ball
    system.settings.particle_size = 1.0
    return wall


def test_particles_are_volumes_with_ids_that_stay_while_they_live(ball: Any) -> None:
    _emitter(ball)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.scene.frame_end = 12
    runs, reader = _read()
    names = [effect.id for effect in reader.description.effects]
    assert names == [f"{ball.hfx.uid}:{k}.0" for k in range(12)] or len(names) == 12
    (block, *_) = reader.blocks()
    levels = np.stack([effect.levels for effect in block.effects])
    lives = (levels > 0.0).sum(axis=1)
    assert ((lives >= 3) & (lives <= 6)).all()
    for effect in block.effects:
        places = effect.matrices[:, 1, 3][effect.levels > 0.0]
        assert (np.diff(places) > 0.0).all()  # each flies on: no two have changed places
    assert runs


def test_a_scene_of_too_many_instances_is_refused(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hfx_blender.reading.stepped.instances.MOST", 2)
    for k, position in enumerate(PLACES):
        _empty(f"Here {k}", position)
    with pytest.raises(InputError, match="3 instances of haptic volumes; at most 2"):
        _read()


def test_scenes_without_instances_are_read_as_before(ball: Any) -> None:
    with pytest.raises(InputError, match="no haptic effects"):
        _read()
    bpy.context.scene.collection.objects.link(ball)
    ball.location = BELLY
    _, reader = _read()
    assert not reader.instances.descriptions
    assert reader.stepping_note == "sampled F-curves, stepped no scene"


def test_an_instancer_of_muted_volumes_alone_rests_while_the_scene_is_stepped(ball: Any) -> None:
    _empty("Here", BELLY)
    quiet = ball.copy()
    quiet.name, quiet.hfx.is_muted = "Quiet", True
    bpy.data.collections.new("Away").objects.link(quiet)
    objects = bpy.data.objects
    _empty("There", BELLY).instance_collection = bpy.data.collections["Away"]
    reader = SceneReader(bpy.context.scene)
    with reader.instances.stepper():
        assert objects["There"].hide_viewport and not objects["Here"].hide_viewport
    assert not objects["There"].hide_viewport
    assert reader.counters.skipped == {"Quiet": "is muted"}


def _of_a_collection(ball: Any) -> None:
    _empty("Here", BELLY)


def _of_a_nested_collection(ball: Any) -> None:
    """An instancer of the ball, in an excluded collection that an empty in the scene instances."""
    inner = bpy.data.objects.new("Inner", None)
    inner.location, inner.instance_type = BELLY, "COLLECTION"
    inner.instance_collection = bpy.data.collections["Source"]
    bpy.data.collections.new("Outer").objects.link(inner)
    _empty("Here", (0.0, 0.0, 0.0))
    bpy.data.objects["Here"].instance_collection = bpy.data.collections["Outer"]


@pytest.mark.parametrize("instance", [_of_a_collection, _of_a_nested_collection])
def test_a_source_in_an_excluded_collection_is_felt_as_instance(
    ball: Any, instance: Callable[[Any], None]
) -> None:
    instance(ball)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    for name in {"Source", "Outer"}.intersection(bpy.data.collections.keys()):
        scene.collection.children.link(bpy.data.collections[name])
        layer.layer_collection.children[name].exclude = True
    layer.update()
    listed = layer.depsgraph.object_instances  # Blender's own list
    assert sum(entry.is_instance and entry.object.name == "Ball" for entry in listed) == 1
    runs, reader = _read()
    assert len(reader.instances.descriptions) == 1
    assert reader.description.warnings == () and reader.unfelt == {}
    # A ball of the scene at the same place is felt alike.
    bpy.data.objects.remove(bpy.data.objects["Here"])
    scene.collection.objects.link(ball)
    ball.location = BELLY
    own, _ = _read()
    assert _felt(runs) == _felt(own) != set()


def test_a_source_in_a_disabled_collection_is_told(ball: Any) -> None:
    """Blender shows no instances of a collection that is disabled in viewports."""
    _empty("Here", BELLY)
    effects.add_volume(bpy.context.scene, "pressure", "SPHERE", "Own")
    source = bpy.data.collections["Source"]
    bpy.context.scene.collection.children.link(source)
    source.hide_viewport = True
    _, reader = _read()
    assert not reader.instances.descriptions and list(reader.unfelt) == ["Ball"]
    assert [text for text in reader.description.warnings if "'Ball'" in text] == [
        "effect 'Ball' is disabled in viewports or excluded from the view layer: it was left out"
    ]


def test_live_feels_instances_as_they_stand(ball: Any) -> None:
    from hfx_blender.engine.tolerance import STANDARD

    for k, position in enumerate(PLACES):
        _empty(f"Here {k}", position)
    scene = bpy.context.scene
    live = LiveScene(scene, bpy.context.view_layer, STANDARD)
    assert len(live.runs()) == 2
    bpy.data.objects["Here 1"].location = (0.0, 9.0, 0.0)
    bpy.context.view_layer.update()
    assert len(live.runs()) == 1


def test_a_source_that_is_not_felt_is_told(ball: Any) -> None:
    """The source is in no scene, so only this warning mentions the ball."""
    _empty("Here", BELLY)
    effects.add_volume(bpy.context.scene, "pressure", "SPHERE", "Own")
    bpy.context.view_layer.update()
    assert _read()[1].description.warnings == () == _read()[1].notes
    ball.hfx.is_muted = True
    reader = _read()[1]
    assert reader.unfelt == {"Ball": Unfelt("is muted", is_expected=True)}
    assert reader.description.warnings == () == reader.notes
    ball.hfx.is_muted, ball.hfx.intensity = False, 0.0
    reader = _read()[1]
    assert reader.unfelt == {"Ball": Unfelt("has intensity 0")}
    assert reader.description.warnings == ("effect 'Ball' has intensity 0: it is not felt",)


def test_a_volume_that_is_to_be_a_mesh_and_is_none_costs_itself(ball: Any) -> None:
    ring = bpy.data.objects.new("Ring", bpy.data.curves.new("Ring", "CURVE"))
    ring.hfx.role, ring.hfx.kind, ring.hfx.shape = "EFFECT", "VOLUME", "MESH"
    for item in (ball, ring):
        bpy.context.scene.collection.objects.link(item)
    ball.location = BELLY
    runs, reader = _read()
    assert {run.stream.effect_id for run in runs} == {ball.hfx.uid}
    ((fault, samples),) = reader.faults.items()
    assert "'Ring'" in fault and "is a curve object" in fault and len(samples) == 10
    bpy.context.scene.collection.objects.unlink(ring)
    bpy.data.collections["Source"].objects.link(ring)
    _empty("Here", BELLY)
    _, reader = _read()
    assert [text for text in reader.faults if "is a curve object" in text]
