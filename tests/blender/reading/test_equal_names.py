# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects with the same name, one of the scene and one of a library, are told apart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender import cli
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.reading.scene_reader import SceneReader


def ball(name: str) -> bpy.types.Object:
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name=name, radius=0.2, location=(0.0, 0.0, 1.2)
    )
    return bpy.context.object


def link(folder: Path, driver: str = "") -> bpy.types.Collection:
    """Collection "Props" linked from library.blend, with the volume "Ball", whose intensity has a
    driver unless empty; the scene has an avatar."""
    collection = bpy.data.collections.new("Props")
    collection.objects.link(ball("Ball"))
    if driver:
        collection.objects[0].driver_add("hfx.intensity").driver.expression = driver
    path = str(folder / "library.blend")
    bpy.data.libraries.write(path, {collection})
    bpy.data.batch_remove([collection, *bpy.data.objects])
    bpy.ops.hfx.add_avatar()
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.collections = ["Props"]
    return wanted.collections[0]


@pytest.fixture
def linked(scene: Any, tmp_path: Path) -> bpy.types.Collection:
    return link(tmp_path)


def instance(collection: bpy.types.Collection) -> None:
    maker = bpy.data.objects.new("Maker", None)
    maker.instance_type, maker.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(maker)


def test_a_hidden_effect_named_as_an_instanced_one_gets_its_warning(linked: Any) -> None:
    ball("Ball").hide_viewport = True
    instance(linked)
    reader = SceneReader(bpy.context.scene, tolerance=PAPER)
    (instanced,) = reader.instances.descriptions
    assert instanced.name.startswith("Ball [library.blend]")
    assert "is disabled in viewports" in reader.unfelt["Ball"].reason
    assert any("effect 'Ball' is disabled" in text for text in reader.description.warnings)


def test_an_absent_effect_with_instances_gets_no_warning(linked: Any) -> None:
    instance(linked)
    hidden = bpy.data.collections.new("Hidden")
    bpy.context.scene.collection.children.link(hidden)
    hidden.objects.link(linked.objects[0])
    bpy.context.view_layer.layer_collection.children["Hidden"].exclude = True
    reader = SceneReader(bpy.context.scene, tolerance=PAPER)
    assert reader.unfelt == {} and not reader.description.warnings


def test_reasons_of_effects_with_one_name_are_kept_apart_and_counted(linked: Any) -> None:
    bpy.context.scene.collection.children.link(linked)
    own = ball("Ball")
    own.hfx.is_muted = True
    reader = SceneReader(bpy.context.scene, tolerance=PAPER)
    names = {effect.name for effect in reader.description.effects}
    assert names == {"Ball", "Ball [library.blend]"}
    assert list(reader.unfelt) == ["Ball"]
    own.hfx.is_muted = False
    for effect in (own, linked.objects[0]):
        effect.hfx.amplitude = 0.0
    warnings = SceneReader(bpy.context.scene, tolerance=PAPER).description.warnings
    (counted,) = [text for text in warnings if "not felt" in text]
    assert "2 (Ball, Ball [library.blend])" in counted


def test_an_effect_with_the_shown_name_of_a_linked_one_has_an_id_of_its_own(linked: Any) -> None:
    bpy.context.scene.collection.children.link(linked)
    for name in ("Ball", "Ball [library.blend]"):
        ball("Volume").name = name
    described = SceneReader(bpy.context.scene, tolerance=PAPER).description.effects
    assert len({effect.id for effect in described}) == len(described) == 3


def test_an_instance_gets_no_name_of_an_effect_of_the_scene(linked: Any) -> None:
    instance(linked)
    ball("Ball 0")
    reader = SceneReader(bpy.context.scene, tolerance=PAPER)
    names = [effect.name for effect in reader.description.effects]
    assert names == ["Ball 0", "Ball Maker 0"]


def test_a_failed_driver_is_the_reason_of_its_own_effect(scene: Any, tmp_path: Path) -> None:
    scene.collection.children.link(link(tmp_path, driver="1 / 0"))
    ball("Ball")
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert cli.run(["export", str(path), "-o", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "scene.report.json").read_text())
    lines = {line["effect"]: line for line in report["effects"]}
    assert lines["Ball"]["felt"]
    assert "has a driver" in lines["Ball [library.blend]"]["reason"]
