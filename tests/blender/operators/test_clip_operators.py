# SPDX-License-Identifier: GPL-3.0-or-later
"""Clip operators of a creator: remove, copy, fades as curves; muting and solo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring import clips, drawn_fades
from hfx_blender.engine.counters import Unfelt
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.export import ExportSettings, export_scene
from hfx_blender.reading.description import activation
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.ui.panels import list_rows


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm")
    return bpy.context.object


def level(effect: Any, frame: float) -> float:
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1.0)
    return effect.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.activation


def second(name: str = "Other") -> Any:
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name=name)
    return bpy.context.object


def felt(names_only: bool = True) -> set[str]:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.update()
    live = LiveScene(scene, layer, PAPER)
    names = {e.id: e.name for e in live.description.effects}
    return {names[run.stream.effect_id] for run in live.runs()}


def test_removing_the_last_clip_leaves_the_effect_always_on(effect: Any) -> None:
    clips.add_clip(effect, 1, 5, name="A")
    clips.add_clip(effect, 10, 15, name="B")
    bpy.ops.hfx.remove_clip(name="A")
    assert [strip.name for _, strip in clips.strips_of(effect)] == ["B"]
    with pytest.raises(RuntimeError, match="no clip 'A'; it has: 'B'"):
        bpy.ops.hfx.remove_clip(name="A")
    bpy.ops.hfx.remove_clip(name="B")
    assert activation.activation_of(effect).source is activation.ActivationSource.ALWAYS_ON


def test_copied_clips_play_alike_and_are_independent(effect: Any) -> None:
    clips.add_clip(effect, 10, 30, fade_in=4, fade_out=10)
    clips.add_heartbeat(effect, 50, 98, beats_per_minute=120.0)
    alternative = second()
    alternative.select_set(True)
    effect.select_set(True)
    bpy.context.view_layer.objects.active = effect
    bpy.ops.hfx.copy_clips()
    for frame in (5, 12, 20, 25, 29, 40, 51, 52.5, 60, 70):
        assert level(alternative, frame) == pytest.approx(level(effect, frame), abs=1e-5)
    clips.remove_clip(alternative, "Heartbeat")
    assert len(clips.strips_of(effect)) == 2


def test_fades_become_a_curve_with_the_same_ends_and_can_be_bent(effect: Any) -> None:
    strip = clips.add_clip(effect, 10, 50, fade_in=10, fade_out=20, name="Clip")
    bpy.ops.hfx.draw_fades(name="Clip")
    assert level(effect, 10) == pytest.approx(0.0, abs=1e-6)
    assert level(effect, 25) == pytest.approx(1.0)
    assert 0.05 < level(effect, 40) < 0.95
    curve = strip.fcurves.find("influence")
    curve.keyframe_points.insert(40, 0.25)
    assert level(effect, 40) == pytest.approx(0.25, abs=1e-4)
    assert level(effect, 60) == 0.0


def test_a_muted_effect_is_not_felt_and_the_export_says_so(effect: Any) -> None:
    alternative = second()
    alternative.location.z = 1.2
    assert felt() == {"Touch", "Other"}
    effect.hfx.is_muted = True
    assert felt() == {"Other"}
    reader = SceneReader(bpy.context.scene)
    assert reader.unfelt == {"Touch": Unfelt("is muted", is_expected=True)}
    assert reader.description.warnings == ()


def test_solo_silences_all_others(effect: Any) -> None:
    second().location.z = 1.2
    effect.hfx.is_solo = True
    assert felt() == {"Touch"}
    effect.hfx.is_muted = True
    assert felt() == set()


def test_a_heartbeat_lasts_as_long_as_shown(effect: Any) -> None:
    bpy.ops.hfx.add_heartbeat(start=13.0)  # 2 s at 24 frames a second, 72 beats a minute
    ((_, strip),) = clips.strips_of(effect)
    assert (strip.frame_start, strip.frame_end) == (13.0, 61.0)
    assert (strip.repeat, strip.scale) == pytest.approx((2.4, 1.0))
    # A beat is 20 frames: the second begins at 33, with its peak after 0.08 of a beat.
    assert level(effect, 13 + 1.6) == pytest.approx(1.0)
    assert level(effect, 33 + 1.6) == pytest.approx(1.0)
    assert level(effect, 61.5) == 0.0
    strip = clips.add_heartbeat(effect, 50, 140, beats_per_minute=60.0)
    assert (strip.frame_end, strip.repeat) == (140.0, 3.75)


@pytest.mark.parametrize("share", [0.04, 0.34])
def test_a_heartbeat_shorter_than_a_beat_is_cut(effect: Any, share: float) -> None:
    strip = clips.add_heartbeat(effect, 10, 10 + share * 240, beats_per_minute=6.0)
    assert (strip.repeat, strip.scale) == pytest.approx((1.0, 1.0))
    # Half way up the strong pulse (0 to 0.08), and half way up the weak one (0.3 to 0.38, 0.6).
    expected = {0.04: 0.5, 0.34: 0.3}[share]
    assert clips.envelope(strip, 2)[-1][1] == pytest.approx(expected, abs=1e-4)


def test_seconds_of_clips_are_seconds_of_playback(effect: Any) -> None:
    scene = bpy.context.scene
    # Every frame of the animation is played as two: a second has 12 frames of the animation.
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 200
    bpy.ops.hfx.add_clip(start=13.0, duration=2.0, fade_in=0.5)
    ((_, strip),) = clips.strips_of(effect)
    assert (strip.frame_end, strip.blend_in) == (37.0, 6.0)
    bpy.ops.hfx.add_heartbeat(start=50.0, duration=2.0, beats_per_minute=60.0)
    (_, beats) = (strip for _, strip in clips.strips_of(effect))
    assert (beats.frame_end, beats.repeat) == (74.0, 2.0)


ADDITIONS = {
    "clip": lambda: bpy.ops.hfx.add_clip(start=40.0),
    "heartbeat": lambda: bpy.ops.hfx.add_heartbeat(start=40.0),
    "rain": lambda: bpy.ops.hfx.add_rain(duration=0.5),
    "sensation": lambda: bpy.ops.hfx.add_from_library(name="hug"),
    "paste": lambda: (bpy.ops.hfx.copy_effects(), bpy.ops.hfx.paste_effects()),
    "mirrored": lambda: bpy.ops.hfx.effect_mirrored(),
}


@pytest.mark.parametrize("name", ADDITIONS)
def test_added_clips_are_the_only_selected_clips(effect: Any, name: str) -> None:
    bpy.ops.hfx.add_clip(start=10.0)
    camera = bpy.data.cameras.new("Camera")
    camera.keyframe_insert("lens", frame=1)
    data = camera.animation_data
    data.nla_tracks.new().strips.new("Zoom", 1, data.action)
    older = {strip.as_pointer() for strip in all_strips()}
    ADDITIONS[name]()
    added = [strip for strip in all_strips() if strip.as_pointer() not in older]
    assert added and all(strip.select for strip in added)
    assert not [strip.name for strip in all_strips() if strip.select and strip not in added]


def all_strips() -> list[Any]:
    owners = [*bpy.data.objects, *bpy.data.cameras]
    tracks = [t for o in owners if o.animation_data for t in o.animation_data.nla_tracks]
    return [strip for track in tracks for strip in track.strips]


def test_an_envelope_is_what_the_effect_is_evaluated_to(effect: Any) -> None:
    clip = clips.add_heartbeat(effect, 10, 58, beats_per_minute=60.0, fade_in=10, fade_out=20)
    drawn = clips.add_clip(effect, 70, 90, profile=[(0, 0.2), (5, 1.0), (10, 0.4)], repeat=2.0)
    drawn_fades.draw(effect, drawn)
    for strip in (clip, drawn):
        for frame, value in clips.envelope(strip, 25)[:-1]:  # the end is the next clip's
            assert value == pytest.approx(level(effect, frame), abs=0.02), (strip.name, frame)


def test_times_of_clips_are_in_the_unit_of_the_scene(effect: Any) -> None:
    bpy.context.view_layer.objects.active = effect
    clips.add_clip(effect, 12, 60, fade_in=6)
    list_rows.refresh()
    (row,) = bpy.context.window_manager.hfx_clips
    assert (row.start, row.end, row.fade_in) == (12.0, 60.0, 6.0)
    scene = bpy.context.scene
    scene.hfx.time_unit = "SECONDS"
    scene.frame_start = 0
    assert (row.start, row.end, row.fade_in) == (0.5, 2.5, 0.25)
    row.fade_out = 0.5
    ((_, strip),) = clips.strips_of(effect)
    assert strip.blend_out == 12.0


def test_seconds_count_from_the_first_frame_as_in_the_track(effect: Any, tmp_path: Path) -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 25, 120  # 24 frames a second
    bpy.context.view_layer.objects.active = effect
    clips.add_clip(effect, 61, 85)
    list_rows.refresh()
    (row,) = bpy.context.window_manager.hfx_clips
    scene.hfx.time_unit = "SECONDS"
    assert (row.start, row.end) == (1.5, 2.5)
    manager = bpy.context.window_manager
    effect.hfx.group = "all"
    assert manager.hfx_group_start == 1.5
    (line,) = export_scene(scene, tmp_path, "a", ExportSettings()).effects
    assert line["from_s"] == pytest.approx(row.start, abs=0.011)
    row.start = 2.0
    ((_, strip),) = clips.strips_of(effect)
    assert strip.frame_start == 73.0
    manager.hfx_group_start = 0.0
    assert strip.frame_start == 25.0
    # Every frame of the animation is played as two: 0.5 s are 6 frames of the animation.
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 200
    strip.frame_start_ui = 12.5 + 6.0
    assert row.start == pytest.approx(0.5)


def test_clips_of_an_effect_that_is_deselected_are_deselected(scene: Any) -> None:
    """*G* in the NLA Editor moves every selected strip."""
    bpy.ops.hfx.add_volume(modality="temperature", shape="SPHERE")
    first = bpy.context.object
    bpy.ops.hfx.add_clip()
    assert [strip.select for _, strip in clips.strips_of(first)] == [True]
    bpy.ops.hfx.add_volume(modality="wind", shape="CUBOID")
    assert [strip.select for _, strip in clips.strips_of(first)] == [False]


def test_a_mesh_stands_for_the_volume_of_its_shape(scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.hfx.volume_from_mesh(modality="temperature")
    assert bpy.context.object.name == "Cube Heat"  # short, for the narrow list
    bpy.context.view_layer.objects.active = cube
    bpy.ops.hfx.add_clip(duration=2.0)
    assert len(clips.strips_of(bpy.data.objects["Cube Heat"])) == 1
    assert cube.animation_data is None
