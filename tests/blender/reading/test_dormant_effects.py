# SPDX-License-Identifier: GPL-3.0-or-later
"""Nothing is read of effects without a possible contact: no mesh, no matrix, no stepped scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from hfx_blender.engine.scene import HapticVolume
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped import stepped_reading, stepping

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

CURVES = "sampled F-curves, stepped no scene"


def _mute(effect: Any) -> None:
    effect.hfx.is_muted = True


def _drain(effect: Any) -> None:
    effect.hfx.intensity = 0.0


def _key_at_nothing(effect: Any) -> None:
    oracle.key(effect, "hfx.intensity", [(1, 0.0), (12, 0.0)])


def _mute_its_clip(effect: Any) -> None:
    oracle.add_clip(effect, 2, 5).mute = True


def _play_it_later(effect: Any) -> None:
    oracle.add_clip(effect, 100, 110)


def _play_another_alone(effect: Any) -> None:
    bpy.data.objects["Felt"].hfx.is_solo = True


WAYS: dict[str, tuple[Callable[[Any], None], str]] = {
    "muted": (_mute, "is muted"),
    "intensity 0": (_drain, "has intensity 0"),
    "intensity keyed at 0": (_key_at_nothing, "has intensity 0"),
    "muted clip": (_mute_its_clip, "has clips, all of them muted"),
    "later": (_play_it_later, "has no clip within the frames of the scene"),
    "not solo": (_play_another_alone, "is silent because others are solo: 'Felt'"),
}


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the effects read from evaluated objects from now on."""
    names: list[str] = []
    real = stepped_reading.SteppedReading.read_effect

    def read_effect(self: Any, which: int, stepper: Any, index: int) -> Any:
        names.append(self._found.effects[which].name)
        return real(self, which, stepper, index)

    monkeypatch.setattr(stepped_reading.SteppedReading, "read_effect", read_effect)
    return names


@pytest.fixture
def felt(scene: Any) -> Any:
    """A scene of 12 frames with a body and a touching volume."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    return oracle.add_volume("Felt", "pressure", "SPHERE", (0.0, 0.0, 1.2), radius=0.2)


def _restless(name: str) -> Any:
    """A deforming mesh volume with a constraint, in reach: only Blender can place the volume."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=0.3)
    source = bpy.context.object
    effect = oracle.add_mesh_volume(name, "vibration", source)
    effect.parent = None
    effect.location = (0.0, 0.0, 1.2)
    modifier = effect.modifiers.new("Bend", "SIMPLE_DEFORM")
    oracle.key(modifier.id_data, f'modifiers["{modifier.name}"].angle', [(1, 0.0), (12, 1.0)])
    effect.constraints.new("LIMIT_LOCATION")
    bpy.data.objects.remove(source)
    return effect


def _entries(evaluation: Any, name: str) -> dict[int, tuple[list[int], list[float]]]:
    return {
        index: (sample.vertices.tolist(), sample.weights.tolist())
        for index, sample in evaluation.samples[name].items()
    }


@pytest.mark.parametrize("way", WAYS)
def test_nothing_of_it_is_read(
    scene: Any, felt: Any, made: list[str], read: list[str], way: str
) -> None:
    alone = oracle.evaluate(scene)
    restless = _restless("Restless")
    change, messages = WAYS[way]
    change(restless)
    del made[:], read[:]
    evaluation = oracle.evaluate(scene)
    assert made == []
    assert not read  # Felt stands still, and is compared without a step
    assert evaluation.reader.stepping_note == CURVES
    assert evaluation.counters.as_dict() == alone.counters.as_dict()
    assert _entries(evaluation, "Felt") == _entries(alone, "Felt")
    described = {item.name: item for item in evaluation.reader.description.effects}
    assert described["Restless"].kind == "volume"  # a track keeps the line of the effect
    assert evaluation.reader.unfelt["Restless"].reason == messages


def test_what_may_be_felt_is_read(scene: Any, felt: Any, made: list[str], read: list[str]) -> None:
    """The reverse case, as a check of the tests above."""
    _restless("Restless")
    evaluation = oracle.evaluate(scene)
    assert "Restless" in made and "Restless" in read
    assert evaluation.reader.stepping_note != CURVES
    assert evaluation.samples["Restless"]


@pytest.mark.parametrize("path", ["hfx.intensity", "hfx.activation"])
def test_an_effect_that_animation_turns_on_is_read(scene: Any, felt: Any, path: str) -> None:
    restless = _restless("Restless")
    if path == "hfx.intensity":
        oracle.key(restless, path, [(1, 0.0), (6, 0.0), (12, 1.0)])
        restless.hfx.intensity = 0.0
    else:
        oracle.add_clip(restless, 8, 12)
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert min(evaluation.samples["Restless"]) >= 6


def test_a_driver_may_turn_an_effect_on(scene: Any, felt: Any) -> None:
    lever = oracle.empty(scene)
    lever.location.x = 1.0
    felt.hfx.intensity = 0.0
    driver = felt.driver_add("hfx.intensity").driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.type = "TRANSFORMS"
    variable.targets[0].id, variable.targets[0].transform_type = lever, "LOC_X"
    assert oracle.evaluate(scene).samples["Felt"]


def test_a_handler_may_turn_an_effect_on(scene: Any, felt: Any) -> None:
    felt.hfx.intensity = 0.0

    def turn_on(scene: Any, _graph: Any) -> None:
        felt.hfx.intensity = 1.0
        felt.update_tag()  # Blender does not notice the change automatically

    bpy.app.handlers.frame_change_pre.append(turn_on)
    try:
        assert oracle.evaluate(scene).samples["Felt"]
    finally:
        bpy.app.handlers.frame_change_pre.remove(turn_on)


def test_a_surface_that_is_muted_makes_no_maps(
    scene: Any, felt: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.authoring.surfaces import surfaces

    requests: list[str] = []
    monkeypatch.setattr(surfaces, "texture_of", lambda obj: requests.append(obj.name))
    bpy.ops.mesh.primitive_grid_add(location=(0.0, 0.0, 1.2))
    surface = bpy.context.object
    surface.name = "Cloth"
    surface.hfx.role, surface.hfx.kind, surface.hfx.is_muted = "EFFECT", "SURFACE", True
    evaluation = oracle.evaluate(scene)
    assert requests == []
    described = {item.name: item.area for item in evaluation.reader.description.effects}
    assert isinstance(described["Cloth"], HapticVolume)


def _constrain(scene: Any) -> None:
    """Have the body stepped."""
    body = next(obj for obj in scene.objects if obj.hfx.role == "BODY")
    body.pose.bones["head"].constraints.new("DAMPED_TRACK").target = oracle.empty(scene)


def _curtain(scene: Any) -> Any:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, location=(20.0, 0.0, 1.0))
    bpy.context.object.modifiers.new("Cloth", "CLOTH")
    return bpy.context.object


@pytest.mark.parametrize("kind", ["curtain", "muted cloth", "driver", "muted particles"])
def test_what_nobody_feels_does_not_have_the_whole_scene_stepped(
    scene: Any, felt: Any, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    _constrain(scene)
    if kind == "curtain":
        _curtain(scene)
    elif kind == "muted cloth":
        curtain = _curtain(scene)
        curtain.hfx.role, curtain.hfx.kind = "EFFECT", "VOLUME"
        curtain.hfx.shape, curtain.hfx.is_muted = "MESH", True
    elif kind == "driver":
        volume = oracle.add_volume("Other", "vibration", "SPHERE", (0.0, 0.0, 1.2))
        volume.hfx.is_muted = True
        variable = volume.driver_add("location", 0).driver.variables.new()
        variable.targets[0].id_type = "SCENE"
        variable.targets[0].id = scene
        variable.targets[0].data_path = "frame_current"
    else:
        source = oracle.add_volume("Spark", "vibration", "SPHERE", (9.0, 0.0, 1.2), radius=0.1)
        source.hfx.is_muted = True
        bpy.ops.mesh.primitive_plane_add(size=1, location=(0.0, 0.0, 1.2))
        bpy.ops.object.particle_system_add()
        settings = bpy.context.object.particle_systems[0].settings
        settings.count, settings.render_type, settings.instance_object = 20, "OBJECT", source
    own_frames: list[float] = []
    real = stepping.Stepper.set_frame

    def set_frame(self: stepping.Stepper, frame: Any) -> None:
        if self._scene == scene:
            own_frames.append(float(frame))
        real(self, frame)

    monkeypatch.setattr(stepping.Stepper, "set_frame", set_frame)
    reader = SceneReader(scene)
    for _ in reader.blocks():
        pass
    assert reader.stepping_note.startswith("stepped a scratch scene, because bone 'head' of")
    assert not own_frames


def test_felt_cloth_has_the_whole_scene_stepped(scene: Any, felt: Any) -> None:
    """Also with a volume parented to a physics object."""
    felt.parent = _curtain(scene)
    reader = SceneReader(scene)
    for _ in reader.blocks():
        pass
    _constrain(scene)
    assert SceneReader(scene).why_in_one_go() == f"physics moves '{felt.parent.name}'"


def test_the_range_that_is_read_does_not_change_what_is_felt(scene: Any, felt: Any) -> None:
    """Effects beginning right after the range count when motion is read, as in a longer range."""
    restless = _restless("Restless")
    oracle.add_clip(restless, 7.01, 12)
    scene_reader = SceneReader(scene, frames=(1, 6))
    assert scene_reader.description.effects and not any(
        "Restless" in note for note in scene_reader.notes
    )
