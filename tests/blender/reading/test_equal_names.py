# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects with the same name, one of the scene and one of a library, are told apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.engine.tolerance import PAPER
from hfx_blender.reading.scene_reader import SceneReader


def ball(name: str) -> bpy.types.Object:
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name=name, radius=0.2, location=(0.0, 0.0, 1.2)
    )
    return bpy.context.object


@pytest.fixture
def linked(scene: Any, tmp_path: Path) -> bpy.types.Collection:
    """Collection "Props" of library.blend, with the volume "Ball"; a scene with an avatar."""
    collection = bpy.data.collections.new("Props")
    collection.objects.link(ball("Ball"))
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {collection})
    bpy.data.batch_remove([collection, *bpy.data.objects])
    bpy.ops.hfx.add_avatar()
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.collections = ["Props"]
    return wanted.collections[0]


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
