# SPDX-License-Identifier: GPL-3.0-or-later
"""The asset library of shipped sensations, and the effects of a dropped asset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring.effects import effect_assets, effect_exchange, effects
from hfx_blender.authoring.effects.effect_file import VolumeRecipe
from hfx_blender.files import resources
from hfx_blender.operators.effects import asset_browser


@pytest.fixture
def dropped(scene: Any) -> Any:
    """Drop a sensation at a place, as Blender appends the empty of an asset."""

    def drop(name: str, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
        empty = bpy.data.objects.new(name, None)
        empty[effect_assets.SENSATION] = name
        empty.location = place
        scene.collection.objects.link(empty)
        bpy.context.view_layer.update()
        return empty

    return drop


def made() -> list[Any]:
    return effects.effects_of(bpy.context.scene)


def test_every_sensation_is_an_asset_with_a_catalog_a_picture_and_tags(scene: Any) -> None:
    folder = resources.effect_library()
    with bpy.data.libraries.load(str(folder / effect_assets.LIBRARY_FILE), assets_only=True) as (
        inside,
        requested,
    ):
        requested.objects = inside.objects
    actual = {obj[effect_assets.SENSATION]: obj for obj in requested.objects}
    library = effect_exchange.library()
    assert set(actual) == set(library), "run docs/regenerate.py assets"
    catalogs = (folder / "blender_assets.cats.txt").read_text(encoding="utf-8")
    for stem in library:
        sensation, obj = effect_exchange.load_library(stem), actual[stem]
        assert obj.name == sensation.name
        assert obj.asset_data.description == sensation.description
        assert obj.asset_data.catalog_id in catalogs
        tags = {tag.name for tag in obj.asset_data.tags}
        assert tags == {effect.modality for effect in sensation.effects}
        assert tuple(obj.preview.image_size) == (128, 128)


def test_what_is_dropped_on_the_body_is_painted_on_it(dropped: Any) -> None:
    bpy.ops.hfx.add_avatar()
    dropped("heartbeat", (0.0, -0.15, 1.3))
    bpy.context.scene.frame_set(20)
    assert bpy.ops.hfx.place_dropped() == {"FINISHED"}
    (body,) = effects.bodies_of(bpy.context.scene)
    assert made() and all(effect.hfx.body == body for effect in made())
    assert effect_assets.dropped_objects(bpy.context.scene) == []
    starts = {s.frame_start for e in made() for t in e.animation_data.nla_tracks for s in t.strips}
    assert min(starts) == 20


def test_a_volume_stands_where_it_was_dropped(dropped: Any) -> None:
    bpy.ops.hfx.add_avatar()
    sensation = effect_exchange.load_library("hot_object")
    recipe = sensation.effects[0].where
    assert isinstance(recipe, VolumeRecipe)
    dropped("hot_object", (3.0, 1.0, 0.5))
    bpy.ops.hfx.place_dropped()
    expected = [a + b for a, b in zip((3.0, 1.0, 0.5), recipe.location_m, strict=True)]
    assert list(made()[0].location) == pytest.approx(expected)


def test_of_several_bodies_the_nearest_feels_it(dropped: Any) -> None:
    bpy.ops.hfx.add_avatar()
    first = bpy.context.object
    bpy.ops.hfx.add_avatar()
    second = bpy.context.object
    second.location.x = 5.0
    bpy.context.view_layer.update()
    dropped("heartbeat", (4.9, -0.1, 1.2))
    bpy.ops.hfx.place_dropped()
    assert made() and all(effect.hfx.body == second for effect in made())
    assert first != second


def test_what_needs_a_body_says_so_and_leaves_nothing_behind(dropped: Any) -> None:
    empty = dropped("hug").name
    assert bpy.ops.hfx.place_dropped() == {"FINISHED"}
    assert made() == [] and empty not in bpy.data.objects


def test_a_name_that_is_no_sensation_does_no_harm(dropped: Any) -> None:
    dropped("../../etc/passwd")
    assert bpy.ops.hfx.place_dropped() == {"FINISHED"}
    assert made() == []


def test_the_library_is_there_while_the_add_on_is_and_gone_afterwards(registered: Any) -> None:
    libraries = bpy.context.preferences.filepaths.asset_libraries

    def ours() -> list[Any]:
        return [item for item in libraries if item.name == asset_browser.LIBRARY_NAME]

    others = len(libraries) - len(ours())
    asset_browser.unregister()
    assert ours() == [] and len(libraries) == others
    asset_browser.register()
    asset_browser.register()  # state after a crash of Blender
    (library,) = ours()
    assert Path(library.path).samefile(resources.effect_library())
    assert library.import_method == "APPEND"
