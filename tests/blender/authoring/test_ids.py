# SPDX-License-Identifier: GPL-3.0-or-later
"""Ids and painted areas stay with their effect: renamed, copied, saved, appended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import hfx_scenes
import pytest

from hfx_blender.authoring.effects import effects


@pytest.fixture
def small(registered: Any) -> Any:
    return hfx_scenes.small_scene()


def ids() -> dict[str, str]:
    scene = bpy.context.scene
    objects = [*effects.bodies_of(scene), *effects.effects_of(scene)]
    return {obj.name_full: uid for obj, uid in effects.unique_ids(objects).items()}


def test_everything_has_an_id_of_its_own(small: Any) -> None:
    assert sorted(ids()) == ["Avatar", "Ball", "Touch"]
    assert len(set(ids().values())) == 3 and all(ids().values())


def test_an_id_survives_renaming_saving_and_loading(small: Any, tmp_path: Path) -> None:
    before = ids()
    area = effects.area(bpy.data.objects["Touch"])
    bpy.data.objects["Touch"].name = "A Touch"
    bpy.data.objects["Avatar"].name = "Zoe"
    path = hfx_scenes.save(tmp_path / "x.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    renamed = {"Touch": "A Touch", "Avatar": "Zoe"}
    assert ids() == {renamed.get(name, name): uid for name, uid in before.items()}
    assert effects.area(bpy.data.objects["A Touch"]) == area and len(area[0]) > 100
    assert bpy.data.objects["A Touch"].hfx.body == bpy.data.objects["Zoe"]


@pytest.mark.parametrize("linked", [False, True])
def test_a_copy_gets_an_id_of_its_own_and_keeps_the_area(small: Any, linked: bool) -> None:
    before = ids()
    touch = bpy.data.objects["Touch"]
    bpy.context.view_layer.objects.active = touch
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    touch.select_set(True)
    for _ in range(2):
        bpy.ops.object.duplicate(linked=linked)
    copies = [bpy.data.objects[name] for name in ("Touch.001", "Touch.002")]
    after = ids()
    assert {name: after[name] for name in before} == before
    assert len(set(after.values())) == len(after) == 5
    assert after == ids()  # the same each time
    for copy in copies:
        assert effects.area(copy) == effects.area(touch)
    effects.set_area(copies[0], [1], [1.0])
    assert len(effects.area(touch)[0]) > 100  # not shared


def test_an_effect_brings_its_area_into_another_file(small: Any, tmp_path: Path) -> None:
    touch = bpy.data.objects["Touch"]
    uid, area, pressure = touch.hfx.uid, effects.area(touch), touch.hfx.pressure
    path = hfx_scenes.save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (_, expected):
        expected.objects = ["Touch"]
    [appended] = expected.objects
    assert (appended.hfx.uid, effects.area(appended)) == (uid, area)
    assert appended.hfx.pressure == pressure


def test_a_failed_change_of_an_area_keeps_the_old_one(small: Any) -> None:
    touch = bpy.data.objects["Touch"]
    before = effects.area(touch)
    for vertices, weights in (([1, 1], [1.0, 1.0]), ([1], []), ([-1], [1.0]), ([1], [2.0])):
        with pytest.raises(effects.InputError, match="'Touch'"):
            effects.set_area(touch, vertices, weights)
        assert effects.area(touch) == before


def test_saving_settles_the_ids_of_copies(small: Any, tmp_path: Path) -> None:
    touch = bpy.data.objects["Touch"]
    copy = touch.copy()
    bpy.context.scene.collection.objects.link(copy)
    original, second = ids()["Touch"], ids()[copy.name]
    hfx_scenes.save(tmp_path / "x.blend")
    touch.name = "Zebra"  # now sorted after the copy
    assert (ids()["Zebra"], ids()[copy.name]) == (original, second)


def test_a_linked_body_of_the_same_name_has_an_id_of_its_own(small: Any, tmp_path: Path) -> None:
    path = hfx_scenes.save(tmp_path / "x.blend")
    hfx_scenes.small_scene()
    with bpy.data.libraries.load(str(path), link=True) as (_, here):
        here.objects = ["Avatar", "Ball"]
    for obj in here.objects:
        bpy.context.scene.collection.objects.link(obj)
    actual = ids()
    assert sorted(actual) == ["Avatar", "Avatar [x.blend]", "Ball", "Ball [x.blend]", "Touch"]
    assert len(set(actual.values())) == 5
