# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay of effects: wind arrows, volumes that are off, legend; graphics state after an error."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector

from hfx_blender.authoring import clips, volumes
from hfx_blender.playback.preview import drawing, effect_overlay
from hfx_blender.ui import gizmos


def volume(modality: str, shape: str = "CUBOID", **settings: object) -> Any:
    bpy.ops.hfx.add_volume(modality=modality, shape=shape, **settings)
    bpy.context.view_layer.update()
    return bpy.context.object


def off_names(scene: Any) -> list[str]:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return [effect.name for effect in effect_overlay.off_volumes(scene, depsgraph)]


def test_an_arrow_ends_a_quarter_beyond_the_boundary_in_the_direction_of_the_air(
    scene: Any,
) -> None:
    wind = volume("wind", size=(1.0, 1.0, 2.0), location=(3.0, 0.0, 1.0))
    wind.scale.z = 2.0  # the boundary is at 2 m, the tip at 2.5 m
    bpy.context.view_layer.update()
    assert tuple(effect_overlay.wind_tip(wind)) == pytest.approx((3.0, 0.0, 3.5))
    wind.rotation_euler.y = np.pi / 2.0
    bpy.context.view_layer.update()
    assert tuple(effect_overlay.wind_tip(wind)) == pytest.approx((5.5, 0.0, 1.0), abs=1e-6)
    lines = effect_overlay.arrow_lines(wind)
    assert lines[0] == pytest.approx((3.0, 0.0, 1.0)) and lines[1] == pytest.approx((5.5, 0, 1))
    # The head is 0.16 of 2.5 m long, and 0.06 of it to each side.
    assert lines[3:10:2, 0] == pytest.approx(5.5 - 0.4)
    away = np.linalg.norm(lines[3:10:2, 1:] - (0.0, 1.0), axis=1)
    assert away == pytest.approx(0.15, abs=1e-5)
    assert not effect_overlay.is_windy(volume("pressure"))


def test_a_wind_is_turned_without_moving_scaling_or_rolling(scene: Any) -> None:
    wind = volume("wind", location=(1.0, 2.0, 3.0))
    wind.scale = (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    gizmos.turn_wind(wind, Vector((0.5, 0.0, 0.0)))
    bpy.context.view_layer.update()
    world = wind.matrix_world
    assert tuple(world.translation) == pytest.approx((1.0, 2.0, 3.0))
    assert tuple(world.to_scale()) == pytest.approx((1.0, 2.0, 3.0))
    assert tuple(world.col[2].to_3d().normalized()) == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    assert tuple(world.col[1].to_3d().normalized()) == pytest.approx((0.0, 1.0, 0.0), abs=1e-6)
    before = world.copy()
    gizmos.turn_wind(wind, Vector())
    bpy.context.view_layer.update()
    assert wind.matrix_world == before
    assert wind.animation_data is None
    wind.keyframe_insert("rotation_euler", frame=1)
    scene.frame_set(10)
    bpy.context.tool_settings.use_keyframe_insert_auto = True
    gizmos.turn_wind(wind, Vector((0.0, 1.0, 0.0)))
    bpy.context.tool_settings.use_keyframe_insert_auto = False
    bpy.context.view_layer.update()
    scene.frame_set(1)
    scene.frame_set(10)
    assert tuple(wind.matrix_world.col[2].to_3d().normalized()) == pytest.approx(
        (0, 1, 0), abs=1e-5
    )


def test_volumes_are_off_outside_of_clips_when_muted_and_at_intensity_0(scene: Any) -> None:
    scene.frame_set(1)
    clipped, muted, silent = (volume("wind", name=name) for name in ("Clipped", "Muted", "Silent"))
    volume("pressure", name="On")
    clips.add_clip(clipped, 10.0, 15.0)
    muted.hfx.is_muted = True
    silent.hfx.intensity = 0.0
    silent.update_tag()
    assert off_names(scene) == ["Clipped", "Muted", "Silent"]
    scene.frame_set(12)
    assert off_names(scene) == ["Muted", "Silent"]
    bpy.data.objects["On"].hfx.is_solo = True
    assert off_names(scene) == ["Clipped", "Muted", "Silent"]


def test_wires_are_the_edges_in_world_space(scene: Any) -> None:
    box = volume("pressure", size=(2.0, 2.0, 2.0), location=(5.0, 0.0, 0.0))
    ends = effect_overlay.wires_of(box, bpy.context.evaluated_depsgraph_get())
    assert ends.shape == (24, 3)
    assert np.linalg.norm(ends[::2] - ends[1::2], axis=1) == pytest.approx(2.0)
    assert ends.min(axis=0) == pytest.approx((4.0, -1.0, -1.0))


def test_a_legend_names_the_modalities_of_the_scene(scene: Any) -> None:
    assert effect_overlay.legend(scene) == []
    volume("wind")
    volume("temperature")
    scales = [(label, full) for label, full, _ in effect_overlay.legend(scene)]
    assert scales == [("Warm", "+6 °C"), ("Cold", "-6 °C"), ("Wind", "6 m/s")]


def test_a_new_scene_shows_fire_warm_and_ice_cold(scene: Any) -> None:
    assert scene.hfx.palette == "WARM_COLD"
    fire = volume("temperature")
    red, _, blue = fire.color[:3]
    assert fire.hfx.temperature == 30.0 and red > blue
    (*_, warm), (*_, cold) = effect_overlay.legend(scene)
    assert tuple(fire.color[:3]) == pytest.approx(warm)
    fire.hfx.temperature_reference = "CONTACT"  # a touched object of 30 degrees is cold
    fire.hfx.temperature = 30.0
    assert volumes.effect_colour(fire.hfx)[:3] == pytest.approx(cold)
    assert tuple(fire.color[:3]) == pytest.approx(cold)


def test_a_mesh_becomes_a_wire_around_its_volume_but_an_avatar_does_not(scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.hfx.volume_from_mesh(modality="pressure")
    assert cube.display_type == "WIRE"
    bpy.ops.hfx.add_avatar()
    (skin,) = (obj for obj in bpy.context.object.children if obj.type == "MESH")
    bpy.context.view_layer.objects.active = skin
    bpy.ops.hfx.volume_from_mesh(modality="pressure")
    assert skin.display_type == "TEXTURED"


def test_the_cards_state_is_restored_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    state = {"depth_mask": True}

    def setter(name: str) -> Any:
        return lambda value: state.__setitem__(name, value)

    names = ("blend", "depth_test", "depth_mask", "face_culling", "point_size", "line_width")
    card = SimpleNamespace(**{f"{name}_set": setter(name) for name in names})
    card.depth_mask_get = lambda: state["depth_mask"]
    monkeypatch.setattr(drawing, "gpu", SimpleNamespace(state=card))
    with pytest.raises(ValueError, match="a driver"), drawing.card_state("ALPHA", "LESS_EQUAL"):
        assert state == {"blend": "ALPHA", "depth_test": "LESS_EQUAL", "depth_mask": False}
        card.face_culling_set("BACK")
        raise ValueError("a driver")
    assert (state["blend"], state["depth_test"], state["depth_mask"]) == ("NONE", "NONE", True)
    assert state["face_culling"] == "NONE"
