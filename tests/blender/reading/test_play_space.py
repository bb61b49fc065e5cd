# SPDX-License-Identifier: GPL-3.0-or-later
"""The play space of a scene: a teleport moves the devices of the room, in exports and live."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.device_config import DeviceConfig, RoomPlace
from hfx_blender.engine.track import SUFFIX, TrackReader
from hfx_blender.errors import InputError
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.description.scene_settings import play_space_now, scene_tolerance
from hfx_blender.reading.live_scene import LiveScene
from hfx_tools.track_rendering import render_devices


@pytest.fixture
def fan(scene: Any) -> DeviceConfig:
    """A storm around a resting avatar at the origin; the play space jumps at frame 5."""
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 8, 10
    scene.hfx.rate = 10
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Storm", radius=3.0)
    space = bpy.data.objects.new("Room", None)
    scene.collection.objects.link(space)
    scene.hfx.play_space = space
    space.keyframe_insert("location", frame=1)
    space.location.x = 20.0
    space.keyframe_insert("location", frame=5)
    space.location.x = 20.0
    for layer in space.animation_data.action.layers if bpy.app.version >= (4, 4) else ():
        for strip in layer.strips:
            for bag in strip.channelbags:
                for curve in bag.fcurves:
                    for key in curve.keyframe_points:
                        key.interpolation = "CONSTANT"
    if bpy.app.version < (4, 4):
        for curve in space.animation_data.action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "CONSTANT"
    device = load_device("fan_heater")
    room_place = RoomPlace(("torso",), at_m=(0.0, -2.0, 1.2), aim=(0.0, 1.0, 0.0), range_m=3.0)
    actuators = [a for a in device.actuators if a.type.modality == "wind"]
    kind = replace(actuators[0].type, latency_ms=0.0, update_interval_ms=1.0)
    return replace(device, actuators=(replace(actuators[0], type=kind, place=room_place),))


def test_a_teleport_leaves_the_wearer_out_of_reach(fan: DeviceConfig, tmp_path: Path) -> None:
    export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(("track", "csv"), (fan,)))
    with TrackReader(tmp_path / f"x{SUFFIX}") as track:
        ((_, raster),) = render_devices(track, [fan])
        assert track.header.time.rate_hz == Fraction(10)
    assert (raster.values[:4, 0] > 0.0).all()
    assert (raster.values[4:, 0] == 0.0).all()
    report = json.loads((tmp_path / "x.report.json").read_text())
    (lost,) = report["unrendered"]
    assert lost["effect"] == "Storm" and lost["seconds"] == 0.4


def test_as_it_stands_it_is_where_an_export_has_it(fan: DeviceConfig) -> None:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    for frame, x in ((4, 0.0), (5, 20.0)):
        scene.frame_set(frame)
        assert play_space_now(scene, layer, 1.0)[0, 3] == x
    scene.hfx.play_space = None
    assert play_space_now(scene, layer, 1.0).tolist() == np.eye(4).tolist()


def test_live_samples_tell_where_they_are_if_that_is_needed(fan: DeviceConfig) -> None:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    tolerance = scene_tolerance(scene)
    assert all(run.positions is None for run in LiveScene(scene, layer, tolerance).runs())
    live_scene = LiveScene(scene, layer, tolerance, with_positions=True)
    (run,) = live_scene.runs()
    assert run.positions is not None and len(run.positions) == len(run.vertices)


def test_a_play_space_that_something_else_moves_is_told(fan: DeviceConfig, tmp_path: Path) -> None:
    bpy.context.scene.hfx.play_space.constraints.new("COPY_LOCATION")
    with pytest.raises(InputError, match=r"Play space 'Room'.*constraints"):
        export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(("track",), (fan,)))
