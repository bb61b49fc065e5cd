# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of effects: a row for each effect, and an expandable row for each group."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects, response_recipes, swarms
from hfx_blender.ui.panels import list_rows


def rows() -> list[tuple[str, str]]:
    list_rows.refresh()
    return [(row.effect, row.group) for row in bpy.context.window_manager.hfx_rows]


def volume(name: str, group: str = "") -> Any:
    created = effects.add_volume(bpy.context.scene, "wind", "SPHERE", name)
    created.hfx.group = group
    return created


def test_effects_of_a_group_follow_its_row(scene: Any) -> None:
    for name, group in (("C", "Storm"), ("A", ""), ("B", "Storm"), ("D", "")):
        volume(name, group)
    assert rows() == [("A", ""), ("", "Storm"), ("B", "Storm"), ("C", "Storm"), ("D", "")]
    bpy.data.objects.remove(bpy.data.objects["B"])
    assert rows() == [("A", ""), ("C", ""), ("D", "")], "what is left of a group stands alone"


def test_the_row_of_a_group_mutes_and_selects_all_of_it(scene: Any) -> None:
    storm = [volume(name, "Storm") for name in "AB"]
    alone = volume("C")
    rows()
    manager = bpy.context.window_manager
    storm[0].hfx.is_muted = True
    for is_muted in (True, False):
        manager.hfx_rows[0].is_muted = is_muted
        assert effects.muted_effects([*storm, alone]) == (storm if is_muted else storm[:1])
        assert manager.hfx_rows[0].is_muted == is_muted
        assert manager.hfx_rows[1].is_muted, "an effect's own mute stays"
    manager.hfx_row = 0
    assert bpy.context.selected_objects == storm and bpy.context.object == storm[0]
    assert manager.hfx_row == 0, "the active effect is in a closed group: its row"
    manager.hfx_rows[0].is_open = True
    assert manager.hfx_rows[0].is_open and all(map(list_rows.is_shown, manager.hfx_rows))
    assert manager.hfx_row == 1
    manager.hfx_row = 3
    assert bpy.context.selected_objects == [alone] == [bpy.context.object]
    manager.hfx_rows[0].is_open = False


@pytest.mark.parametrize("names", ["A", "AB", "ABC"])
def test_duplicated_effects_have_the_only_selected_clips(scene: Any, names: str) -> None:
    for name in "ABC":
        clips.add_clip(volume(name), 1.0, 10.0)
    clips.deselect_all((bpy.data.objects["C"],))  # as each effect added in a window does
    rows()
    bpy.ops.object.select_all(action="DESELECT")
    for name in names:
        bpy.data.objects[name].select_set(True)
    bpy.ops.object.duplicate()
    rows()
    effect_clips = {effect.name: clips.strips_of(effect) for effect in effects.effects_of(scene)}
    assert {name for name, ((_, strip),) in effect_clips.items() if strip.select} == {
        f"{name}.001" for name in names
    }


def test_rain_is_one_group_and_each_sensation_another(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_rain(duration=1.0, drops_per_second=8.0)
    assert rows() == [("Rain", "")], "an effect alone"
    bpy.ops.hfx.add_rain(duration=1.0, drops_per_second=16.0)  # at most 10 in each effect
    assert rows() == [("", "Rain"), ("Rain 01", "Rain"), ("Rain 02", "Rain")]
    strips = [strip for effect in effects.effects_of(scene) for _, strip in clips.strips_of(effect)]
    first = min(strip.frame_start for strip in strips)
    before = [(strip.frame_start, strip.frame_end) for strip in strips]
    for start in (first + 30.0, first - 0.5):  # the group's clips are moved together
        bpy.context.window_manager.hfx_group_start = start
        now = [(strip.frame_start, strip.frame_end) for strip in strips]
        assert np.allclose(now, np.array(before) + start - first, atol=1e-3)
    bpy.ops.hfx.add_from_library(name="hug")
    bpy.ops.hfx.add_from_library(name="hug")
    groups = {effects.group_of(effect) for effect in effects.effects_of(scene)} - {""}
    assert groups in ({"Rain"}, {"Rain", "Hug", "Hug 2"})


def test_a_swarm_is_one_row_that_selects_its_emitter(scene: Any) -> None:
    bee = volume("Bee")
    recipe = response_recipes.SwarmRecipe(count=40)
    emitter = swarms.add_swarm(scene, bee, recipe, 1.0, 0.0, 24.0, (0.0, 0.0, 0.0))
    volume("Alone")
    assert rows() == [("Alone", ""), ("Bee", "")]
    manager = bpy.context.window_manager
    manager.hfx_row = 1
    assert bpy.context.selected_objects == [emitter] == [bpy.context.object]
    assert manager.hfx_row == 1
    manager.hfx_rows[1].is_muted = True
    assert bee.hfx.is_muted
    bpy.ops.hfx.add_clip()
    assert [strip.name for _, strip in clips.strips_of(bee)] == ["Clip"]


def test_several_rows_are_selected_and_deleted(scene: Any) -> None:
    for name in "ABCD":
        volume(name)
    rows()
    manager = bpy.context.window_manager
    manager.hfx_row = 1
    bpy.ops.hfx.select_effects(row=3, extend=True)  # as a click with Shift
    assert sorted(obj.name for obj in bpy.context.selected_objects) == ["B", "C", "D"]
    assert bpy.context.object.name == "D"
    manager.hfx_rows[2].is_selected = False
    manager.hfx_rows[0].is_selected = True
    assert [row.is_selected for row in manager.hfx_rows] == [True, True, False, True]
    assert bpy.context.object.name == "D", "the active effect stays"
    bpy.ops.hfx.remove_effects()
    assert rows() == [("C", "")]
    with pytest.raises(RuntimeError, match="Select effects first"):
        bpy.ops.hfx.remove_effects()


def test_rows_are_sorted_by_name_or_by_time(scene: Any) -> None:
    for name, frame in (("A", 30.0), ("B", 10.0), ("C", None)):
        created = volume(name)
        if frame is not None:
            clips.add_clip(created, frame, frame + 5.0)
    assert [effect for effect, _ in rows()] == ["A", "B", "C"]
    scene.hfx.list_order = "TIME"
    assert [effect for effect, _ in rows()] == ["C", "B", "A"]
