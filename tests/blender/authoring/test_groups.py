# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of effects: a common gain, mute and start, in exports and live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hfx_scenes
import numpy as np
import oracle
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effect_exchange, effects
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.ui.panels import list_rows

bpy = pytest.importorskip("bpy")


@pytest.fixture
def pair(scene: Any) -> list[Any]:
    """Two effects on the head, selected, in a scene of thirty frames."""
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 30, 24
    body = oracle.add_avatar()
    created = [oracle.add_painted(name, "pressure", body, part="head") for name in "AB"]
    for effect in created:
        effect.select_set(True)
    bpy.context.view_layer.objects.active = created[0]
    list_rows.refresh()
    return created


def levels(name: str) -> tuple[list[float], str]:
    """Levels at the frames from 1 to 30, NaN where nothing is felt, and how the scene is read."""
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=24)
    actual = evaluation.levels(name)
    return [actual.get(k, np.nan) for k in range(30)], evaluation.reader.stepping_note


def test_the_gain_is_a_factor_of_each_level(pair: list[Any]) -> None:
    """Half the intensity, a rise over 4 frames, and a gain of one quarter."""
    a = pair[0]
    a.hfx.intensity = 0.5
    oracle.add_clip(a, 5, 17, fade_in=4)
    bpy.ops.hfx.move_to_group(group="NEW")
    bpy.context.window_manager.hfx_group_gain = 0.25
    assert [effect.hfx.group_gain for effect in pair] == [0.25, 0.25]
    actual, note = levels("A")
    assert note == "sampled F-curves, stepped no scene"
    expected = [0.5 * 0.25 * min((frame - 5) / 4, 1.0) for frame in range(6, 18)]
    assert np.allclose(actual[5:17], expected, atol=1e-6)
    assert levels("B")[0] == [0.25] * 30
    # An animated monitor icon has to be stepped.
    a.keyframe_insert("hide_viewport", frame=1)
    stepped, note = levels("A")
    assert note != "sampled F-curves, stepped no scene"
    assert np.allclose(stepped[5:17], expected, atol=1e-6)


def test_the_gain_is_live(pair: list[Any]) -> None:
    bpy.ops.hfx.move_to_group(group="NEW")
    for gain in (1.0, 0.25, 0.5):
        bpy.context.window_manager.hfx_group_gain = gain
        for effect in pair:
            effect.update_tag()
        bpy.context.view_layer.update()
        live = LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD)
        assert [run.levels.tolist() for run in live.runs()] == [[gain], [gain]]


def test_a_gain_of_0_is_a_reason(pair: list[Any], tmp_path: Path) -> None:
    pair[0].hfx.group, pair[0].hfx.group_gain = "Quiet", 0.0
    report = export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(("track",)))
    a, b = report.effects
    assert (a["felt"], a["reason"]) == (False, "is in a group of gain 0")
    assert b["felt"] and any("is in a group of gain 0" in text for text in report.warnings)


def test_a_muted_group_is_a_reason_and_silent_live(pair: list[Any], tmp_path: Path) -> None:
    bpy.ops.hfx.move_to_group(group="NEW")
    list_rows.refresh()
    bpy.context.window_manager.hfx_rows[0].is_muted = True
    report = export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(("track",)))
    assert [fact["reason"] for fact in report.effects] == ["is in a muted group"] * 2
    assert not report.warnings, "as intended"
    bpy.context.view_layer.update()
    assert LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD).runs() == []
    pair[0].select_set(False)
    bpy.ops.hfx.move_to_group(group="NONE")
    report = export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(("track",)))
    assert [fact["felt"] for fact in report.effects] == [False, True]


def test_a_group_of_gain_1_exports_the_bytes_of_no_group(pair: list[Any], tmp_path: Path) -> None:
    for folder in ("without", "with"):
        export_scene(bpy.context.scene, tmp_path / folder, "x", ExportSettings(("track", "jsonl")))
        bpy.ops.hfx.move_to_group(group="NEW")
    contents = [hfx_scenes.contents_of(tmp_path / folder) for folder in ("without", "with")]
    for name in ("x.hfxtrack", "x.samples.jsonl"):
        assert contents[0][name] == contents[1][name]


def test_effects_join_and_leave_a_group(pair: list[Any]) -> None:
    a, b = pair
    b.select_set(False)
    bpy.ops.hfx.move_to_group(group="NEW")
    bpy.context.window_manager.hfx_group_gain = 0.5
    list_rows.refresh()
    rows = bpy.context.window_manager.hfx_rows
    assert [row.name for row in rows] == ["Group", "A", "B"], "its gain needs a row"
    a.select_set(False)
    b.select_set(True)
    bpy.ops.hfx.move_to_group(group="TO Group")
    assert (b.hfx.group, b.hfx.group_gain) == ("Group", 0.5)
    list_rows.refresh()
    rows[0].title = "Storm"
    assert [effect.hfx.group for effect in pair] == ["Storm", "Storm"]
    bpy.ops.hfx.move_to_group(group="NONE")
    assert (b.hfx.group, b.hfx.group_gain, a.hfx.group_gain) == ("", 1.0, 0.5)
    bpy.ops.object.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match="Select effects first"):
        bpy.ops.hfx.move_to_group(group="NEW")


def test_rain_can_leave_its_group(scene: Any) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_rain(duration=1.0, drops_per_second=16.0)
    bpy.ops.hfx.move_to_group(group="NONE")
    list_rows.refresh()
    rows = bpy.context.window_manager.hfx_rows
    assert [(row.effect, row.group) for row in rows] == [("Rain 01", ""), ("Rain 02", "")]
    bpy.ops.hfx.add_rain(duration=1.0, drops_per_second=8.0)
    assert [effect.name for effect in effects.effects_of(scene)] == ["Rain"], "replaced"


def test_groups_are_stored_and_saved_effects_keep_the_strength(
    pair: list[Any], tmp_path: Path
) -> None:
    pair[0].hfx.intensity = 0.8
    bpy.ops.hfx.move_to_group(group="NEW")
    bpy.context.window_manager.hfx_group_gain = 0.5
    saved = effect_exchange.sensation_of(bpy.context.scene, pair, "Saved")
    assert [recipe.intensity for recipe in saved.effects] == pytest.approx([0.4, 0.5])
    path = tmp_path / "groups.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    stored = [bpy.data.objects[name].hfx for name in "AB"]
    assert [(hfx.group, hfx.group_gain) for hfx in stored] == [("Group", 0.5)] * 2


def test_the_start_of_a_group_moves_all_of_its_clips(pair: list[Any]) -> None:
    for effect, frame in zip(pair, (5.0, 9.0), strict=True):
        clips.add_clip(effect, frame, frame + 4.0)
    bpy.ops.hfx.move_to_group(group="NEW")
    bpy.context.window_manager.hfx_group_start = 8.0  # frames
    starts = [strip.frame_start for effect in pair for _, strip in clips.strips_of(effect)]
    assert starts == pytest.approx([8.0, 12.0])
