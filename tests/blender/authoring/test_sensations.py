# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects in files of their own, and the shipped sensations."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips, painting
from hfx_blender.authoring.effects import effect_exchange, effect_file, effects
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.errors import InputError
from hfx_blender.reading.live_scene import LiveScene

NAMES = tuple(effect_exchange.library())


@pytest.fixture
def body(scene: Any) -> Any:
    scene.render.fps = 50
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


def test_there_are_at_least_twenty_sensations() -> None:
    assert len(NAMES) >= 20
    titles = [effect_file.load(path).name for path in effect_exchange.library().values()]
    assert len(set(titles)) == len(titles)


@pytest.mark.parametrize("name", NAMES)
def test_every_sensation_is_read_and_written_without_loss(name: str, tmp_path: Path) -> None:
    sensation = effect_exchange.load_library(name)
    assert sensation.description
    effect_file.save(sensation, tmp_path / "copy.hfxeffect")
    assert effect_file.load(tmp_path / "copy.hfxeffect") == sensation


def test_every_sensation_can_be_added_and_most_are_felt(body: Any) -> None:
    """Hot and cold objects stay in front of the body, without contact."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    silent = set()
    for name in NAMES:
        placed_effects = effect_exchange.place_sensation(
            scene, effect_exchange.load_library(name), body=body, frame=0.0
        )
        samples = False
        for frame in range(0, 150, 5):
            scene.frame_set(frame)
            samples |= bool(LiveScene(scene, layer, PAPER).runs()) if not samples else True
        if not samples:
            silent.add(name)
        for effect in placed_effects:
            bpy.data.objects.remove(effect)
    assert silent <= {"hot_object", "cold_object"}


def test_a_sensation_starts_at_the_current_frame_and_stands_at_the_body(body: Any) -> None:
    body.location = (2.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    bpy.context.scene.frame_set(100)
    bpy.ops.hfx.add_from_library(name="scanning_line")
    line = bpy.context.object
    ((_, strip),) = clips.strips_of(line)
    assert (strip.frame_start, strip.frame_end) == (100, 250)  # 3 s at 50 frames a second
    for frame, height in ((100, 0.0), (175, 0.925), (250, 1.85)):
        bpy.context.scene.frame_set(frame)
        assert line.matrix_world.translation[:] == pytest.approx((2.0, 0.0, height), abs=1e-4)


def test_composed_sensations_combine_unitary_effects(body: Any) -> None:
    bpy.ops.hfx.add_from_library(name="hug")
    modalities = {obj.hfx.modality for obj in bpy.context.selected_objects}
    assert modalities == {"pressure", "temperature"}


def test_effects_are_saved_and_loaded_with_all_that_they_are(body: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.add_painted(modality="vibration", name="Tap")
    tap = bpy.context.object
    effects.set_area(tap, [3, 7, 11], [0.25, 0.5, 1.0])
    tap.hfx.amplitude, tap.hfx.frequency, tap.hfx.intensity = 4.0, 80.0, 0.5
    clips.add_heartbeat(tap, 10, 60, beats_per_minute=120.0, fade_in=5, fade_out=10)
    bpy.ops.hfx.add_volume(modality="temperature", shape="CUBOID", name="Box", size=(1, 2, 3))
    box = bpy.context.object
    box.hfx.temperature, box.hfx.temperature_reference = 12.0, "CONTACT"
    box.hfx.falloff, box.hfx.falloff_share = "smooth", 0.5
    for frame, x in ((20, 0.0), (45, 1.5)):
        box.location = (x, -1.0, 0.5)
        box.keyframe_insert("location", frame=frame)
    tap.select_set(True)
    path = tmp_path / "mine.hfxeffect"
    bpy.ops.hfx.save_effects(filepath=str(path))
    bpy.context.scene.frame_set(200)
    bpy.ops.hfx.load_effects(filepath=str(path))
    loaded = {obj.name.split()[1].split(".")[0]: obj for obj in bpy.context.selected_objects}
    again, cube = loaded["Tap"], loaded["Box"]
    assert effects.area(again) == effects.area(tap)
    assert (again.hfx.amplitude, again.hfx.frequency, again.hfx.intensity) == (4.0, 80.0, 0.5)
    assert again.hfx.uid != tap.hfx.uid

    def level(effect: Any, frame: float) -> float:
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
        return effect.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.activation

    for frame in (9, 12, 15.5, 30, 37, 55, 61):  # the first clip began at 10, now at 200
        assert level(again, frame + 190) == pytest.approx(level(tap, frame), abs=1e-4)
    assert tuple(cube.hfx.size) == pytest.approx((1, 2, 3))
    assert (cube.hfx.temperature, cube.hfx.temperature_reference) == (12.0, "CONTACT")
    assert (cube.hfx.falloff, cube.hfx.falloff_share) == ("smooth", 0.5)
    for frame in (20, 30, 45):
        bpy.context.scene.frame_set(frame)
        before = np.array(box.matrix_world.translation)
        bpy.context.scene.frame_set(frame + 190)
        assert cube.matrix_world.translation[:] == pytest.approx(before, abs=0.12)
    bpy.context.scene.frame_set(235)
    assert cube.matrix_world.translation[:] == pytest.approx((1.5, -1.0, 0.5), abs=1e-5)


def document() -> dict[str, Any]:
    return json.loads(effect_exchange.library()["scanning_line"].read_text())


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda d: d.update(schema="other"), "schema"),
        (lambda d: d.update(version=2), "version"),
        (lambda d: d.pop("name"), "'name' is missing"),
        (lambda d: d.update(extra=1), "'extra' is unknown"),
        (lambda d: d["effects"].clear(), "effects is"),
        (lambda d: d["effects"][0].update(modality="smell"), r"effects\[0\].modality"),
        (lambda d: d["effects"][0]["parameters"].update(amplitude_m_s2=-1), "amplitude_m_s2"),
        (lambda d: d["effects"][0]["parameters"].pop("frequency_hz"), "frequency_hz"),
        (lambda d: d["effects"][0].pop("volume"), "exactly one of area, volume, spot, actuators"),
        (lambda d: d["effects"][0]["volume"].update(shape="TORUS"), "volume.shape"),
        (lambda d: d["effects"][0]["volume"].update(size_m=[1, 2]), "size_m"),
        (lambda d: d["effects"][0]["clips"][0].update(duration_s=0), "duration_s"),
        (lambda d: d["effects"][0]["clips"][0].update(fade_in_s=99), "fade_in_s"),
        (lambda d: d["effects"][0]["clips"][0].update(profile=[[0.5, 0], [0.2, 1]]), "profile"),
    ],
)
def test_faults_of_a_file_name_their_place(tmp_path: Path, change: Any, place: str) -> None:
    content = document()
    change(content)
    path = tmp_path / "bad.hfxeffect"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=place) as caught:
        effect_file.load(path)
    assert "bad.hfxeffect" in str(caught.value)


def test_too_many_effects_for_a_file_are_refused_before_writing(tmp_path: Path) -> None:
    """A reader allows 256 effects."""
    sensation = effect_exchange.load_library("hug")
    path = tmp_path / "many.hfxeffect"
    for count, is_written in ((256, True), (257, False)):
        effects_ = (sensation.effects[0],) * count
        many = replace(sensation, effects=effects_)
        if is_written:
            effect_file.save(many, path)
            assert effect_file.load(path) == many
            path.unlink()
        else:
            with pytest.raises(InputError, match="allowed is a list of 1 to 256 items"):
                effect_file.save(many, path)
    assert not path.exists()


def test_an_area_of_another_edition_is_refused_and_nothing_is_made(body: Any) -> None:
    recipe = effect_file.EffectRecipe(
        "Old",
        "pressure",
        {"pressure_kpa": 1.0},
        effect_file.VertexArea("hfx-pressure-1", "0" * 64, (1,), (1.0,)),
    )
    good = effect_exchange.load_library("hug").effects[0]
    before = len(bpy.data.objects)
    with pytest.raises(InputError, match="another edition"):
        effect_exchange.place_sensation(
            bpy.context.scene,
            effect_file.Sensation("Both", "", (good, recipe)),
            body=body,
            frame=0.0,
        )
    assert len(bpy.data.objects) == before


def test_a_painted_sensation_needs_a_body(scene: Any) -> None:
    with pytest.raises(RuntimeError, match="add an avatar"):
        bpy.ops.hfx.add_from_library(name="hug")


def test_saving_nothing_or_a_mesh_is_refused(body: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "x.hfxeffect")
    with pytest.raises(RuntimeError, match="Select the effects"):
        bpy.ops.hfx.save_effects(filepath=path)
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.hfx.volume_from_mesh(modality="pressure")
    with pytest.raises(RuntimeError, match="shape of a mesh"):
        bpy.ops.hfx.save_effects(filepath=path)
    assert not Path(path).exists()


def test_library_areas_are_soft_at_their_edges(body: Any) -> None:
    bpy.ops.hfx.add_from_library(name="breath")
    weights = painting.weights_of(bpy.context.object)
    assert weights.max() == pytest.approx(1.0) and ((weights > 0.1) & (weights < 0.9)).any()
