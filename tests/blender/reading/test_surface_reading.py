# SPDX-License-Identifier: GPL-3.0-or-later
"""A finger stroking a plane renders the plane's material: exported and live, by one code path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.surfaces import surfaces
from hfx_blender.blender import compat
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.scene import HapticSurface
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.reading.scene_reader import SceneReader

FPS = 25
RATE = 200
SIZE = 0.4
WAVES = 128
SPEED = 0.3125  # 100 Hz: whole periods in the window of 50 ms


@pytest.fixture
def scene_of_a_stroke(scene: Any) -> Any:
    """A standing avatar, and a grating moving by under the lowest fingertip."""
    scene.render.fps, scene.hfx.rate = FPS, RATE
    scene.frame_start, scene.frame_end = 0, 5
    bpy.ops.hfx.add_avatar()
    model = load_model("hfx-vibration-1")
    fingers = np.flatnonzero(np.asarray(model.part) == PARTS.index("fingers"))
    tip = model.vertices[fingers[np.argmin(model.vertices[fingers, 2])]]
    bpy.ops.mesh.primitive_plane_add(size=SIZE, location=(tip[0], tip[1], tip[2] - 0.001))
    plane = bpy.context.object
    plane.name = "Grating"
    surfaces.add_surface(plane, "IMAGE")
    settings = plane.hfx.surface
    settings.image, settings.height_mm, settings.renderer = grating(), 0.05, "DIRECT"
    surfaces.make_maps(plane)
    move(plane, SPEED)
    return scene


def grating() -> Any:
    image = bpy.data.images.new("Grating", 2048, 4, float_buffer=True, is_data=True)
    u = (np.arange(2048) + 0.5) / 2048
    pixels = np.ones((4, 2048, 4), np.float32)
    pixels[..., :3] = (0.5 + 0.5 * np.sin(2.0 * np.pi * WAVES * u))[None, :, None]
    image.pixels.foreach_set(pixels.ravel())
    return image


def move(obj: Any, speed: float) -> None:
    x = obj.location.x
    for frame in (0, 5):
        obj.location.x = x + speed * frame / FPS
        obj.keyframe_insert("location", index=0, frame=frame)
    for curve in compat.fcurves(obj):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"


def felt(scene: Any) -> tuple[SceneReader, list[Any]]:
    reader = SceneReader(scene, tolerance=STANDARD)
    engine = Engine(reader.description, tolerance=STANDARD)
    return reader, [run for block in reader.blocks() for run in engine.evaluate(block)]


def frequencies(runs: list[Any]) -> np.ndarray:
    times = np.concatenate([run.times_s for run in runs])
    values = np.concatenate([run.parameters for run in runs])
    return values[times >= 0.1, 1]  # after the first window


def test_the_frequency_is_the_speed_over_the_wavelength(scene_of_a_stroke: Any) -> None:
    reader, runs = felt(scene_of_a_stroke)
    assert reader.stepping_note == "sampled F-curves, stepped no scene"
    actual = frequencies(runs)
    assert len(actual) and np.median(actual) == pytest.approx(SPEED / (SIZE / WAVES), rel=0.01)


def test_a_plane_that_stands_still_is_silent(scene_of_a_stroke: Any) -> None:
    bpy.data.objects["Grating"].animation_data_clear()
    assert not sum(len(run) for run in felt(scene_of_a_stroke)[1])


def test_what_is_stepped_feels_the_same(scene_of_a_stroke: Any) -> None:
    """A driven modifier without effect: the scene has to be stepped, the stroke stays."""
    plane = bpy.data.objects["Grating"]
    before = frequencies(felt(scene_of_a_stroke)[1])
    plane.modifiers.new("Still", "SIMPLE_DEFORM").factor = 0.0
    reader, runs = felt(scene_of_a_stroke)
    assert "stepped" in reader.stepping_note and "sampled" not in reader.stepping_note
    assert np.allclose(frequencies(runs), before, rtol=1e-3)


def test_a_deforming_surface_is_stroked_by_its_own_movement(scene_of_a_stroke: Any) -> None:
    """Shape keys slide the mesh while the object stands: the same stroke."""
    plane = bpy.data.objects["Grating"]
    before = frequencies(felt(scene_of_a_stroke)[1])
    plane.animation_data_clear()
    plane.location.x = 0.5672144
    plane.shape_key_add(name="Basis")
    slid = plane.shape_key_add(name="Slid")
    for point in slid.data:
        point.co.x += SPEED * 5 / FPS
    for frame in (0, 5):
        slid.value = frame / 5
        slid.keyframe_insert("value", frame=frame)
    for curve in compat.fcurves(plane.data.shape_keys):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    bpy.context.view_layer.update()
    assert np.median(frequencies(felt(scene_of_a_stroke)[1])) == pytest.approx(
        np.median(before), rel=0.02
    )


def test_the_stroke_is_in_the_exported_track(scene_of_a_stroke: Any, tmp_path: Path) -> None:
    report = export_scene(scene_of_a_stroke, tmp_path, "stroke", ExportSettings())
    (row,) = report.felt
    assert row["effect"] == "Grating" and row["seconds"] > 0.15


def test_coordinates_are_millimetres_on_the_object(scene_of_a_stroke: Any) -> None:
    plane = bpy.data.objects["Grating"]
    reader, _ = felt(scene_of_a_stroke)
    area = reader.description.effects[0].area
    assert isinstance(area, HapticSurface)
    assert np.ptp(area.coordinates_m.reshape(-1, 2), axis=0) == pytest.approx([SIZE, SIZE])
    plane.hfx.surface.source = "PROCEDURAL"
    plane.hfx.surface.resolution = 32
    plane.data.uv_layers.remove(plane.data.uv_layers[0])
    surfaces.make_maps(plane)
    area = SceneReader(scene_of_a_stroke).description.effects[0].area
    assert np.ptp(area.coordinates_m.reshape(-1, 2), axis=0) == pytest.approx([SIZE, SIZE])


def test_a_stroke_is_felt_live_and_stops_when_nothing_moves(scene_of_a_stroke: Any) -> None:
    scene_of_a_stroke.frame_set(0)
    live = LiveScene(scene_of_a_stroke, bpy.context.view_layer, STANDARD)
    actual = []
    for frame in (0, 1, 2, 2):
        scene_of_a_stroke.frame_set(frame)
        actual.append(sum(len(run) for run in live.runs()))
    assert actual[0] == 0 and actual[1] and actual[2] and actual[3] == 0


def test_a_surface_that_changes_its_faces_is_told(scene_of_a_stroke: Any) -> None:
    plane = bpy.data.objects["Grating"]
    array = plane.modifiers.new("More", "ARRAY")
    array.use_relative_offset = False
    for frame, count in ((0, 1), (3, 2)):
        array.count = count
        array.keyframe_insert("count", frame=frame)
    scene_of_a_stroke.frame_set(0)
    reader, _ = felt(scene_of_a_stroke)
    assert any("change its faces" in text for text in reader.faults)


def test_a_surface_without_its_maps_is_told_by_name(scene_of_a_stroke: Any) -> None:
    plane = bpy.data.objects["Grating"]
    plane.hfx.surface.image = None
    with pytest.raises(Exception, match="'Grating' is made of an image"):
        SceneReader(scene_of_a_stroke)
