# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh volumes changing during playback."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import oracle
import pytest
from hfx_scenes import FPS, small_scene

from hfx_blender.engine.track.track_reader import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene

FLAT_FROM = 5


def _box(scene: Any) -> Any:
    """A box around the avatar as the only active effect, pressed flat from a frame on."""
    for obj in [item for item in scene.objects if item.hfx.role == "EFFECT"]:
        bpy.data.objects.remove(obj)
    bpy.ops.mesh.primitive_cube_add(size=3.0)
    box = bpy.context.object
    box.shape_key_add(name="Basis")
    flat = box.shape_key_add(name="Flat")
    for point in flat.data:
        point.co.z = 0.0
    for frame, value in ((0, 0.0), (FLAT_FROM - 1, 0.0), (FLAT_FROM, 1.0)):
        flat.value = value
        flat.keyframe_insert("value", frame=frame)
    return box


@pytest.fixture
def small(registered: Any) -> Any:
    return small_scene()


def _exported(scene: Any, folder: Path) -> Any:
    scene.frame_set(0)
    return export_scene(scene, folder, "box", ExportSettings())


def test_a_mesh_that_loses_its_inside_is_silent_and_counted(small: Any, tmp_path: Path) -> None:
    _box(small)
    bpy.ops.hfx.volume_from_mesh(modality="pressure", name="Press")
    report = _exported(small, tmp_path)
    warned = [text for text in report.warnings if "is flat" in text]
    assert len(warned) == 1 and warned[0].startswith("'Press'")
    with TrackReader(tmp_path / "box.hfxtrack") as track:
        assert track.samples_at((FLAT_FROM - 2) / FPS)
        assert not track.samples_at((FLAT_FROM + 1) / FPS)


def test_a_hole_that_was_closed_is_told(small: Any, tmp_path: Path) -> None:
    box = _box(small)
    box.shape_key_clear()
    mesh = box.data
    faces = [tuple(face.vertices) for face in mesh.polygons][:-1]
    points = [tuple(vertex.co) for vertex in mesh.vertices]
    mesh.clear_geometry()
    mesh.from_pydata(points, [], faces)
    bpy.ops.hfx.volume_from_mesh(modality="pressure", name="Press")
    report = _exported(small, tmp_path)
    assert [text for text in report.notes if "1 hole was filled" in text]


def test_a_mesh_in_edit_mode_is_felt_as_it_is_edited(small: Any, tmp_path: Path) -> None:
    box = _box(small)
    box.shape_key_clear()
    bpy.ops.hfx.volume_from_mesh(modality="pressure", name="Press")
    bpy.ops.object.mode_set(mode="EDIT")
    assert _exported(small, tmp_path).engine["contacts"]
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(50.0, 0.0, 0.0))
    assert not _exported(small, tmp_path).engine["contacts"]
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_volume_of_a_curve_is_felt_as_it_is_evaluated(scene: Any) -> None:
    """An increasingly extruded square is a growing cuboid."""
    scene.frame_start, scene.frame_end = 0, 4
    oracle.add_avatar()
    cuboid = oracle.add_volume("Cuboid", "pressure", "CUBOID", (0.0, 0.0, 1.1))
    curve = bpy.data.curves.new("Square", "CURVE")
    curve.dimensions, curve.fill_mode = "2D", "BOTH"
    spline = curve.splines.new("POLY")
    spline.points.add(3)
    for point, corner in zip(spline.points, ((-1, -1), (1, -1), (1, 1), (-1, 1)), strict=True):
        point.co = (0.15 * corner[0], 0.15 * corner[1], 0.0, 1.0)
    spline.use_cyclic_u = True
    square = bpy.data.objects.new("Square", curve)
    scene.collection.objects.link(square)
    square.location = cuboid.location
    hfx = square.hfx
    hfx.role, hfx.kind, hfx.modality, hfx.shape = "EFFECT", "VOLUME", "pressure", "MESH"
    oracle.key(curve, "extrude", [(0, 0.05), (4, 0.3)])
    oracle.key(cuboid, "hfx.size", [(0, (0.3, 0.3, 0.1)), (4, (0.3, 0.3, 0.6))])
    samples = oracle.evaluate(scene, rate_hz=24).samples
    strengths, true = (
        [item.vertices.tolist() for _, item in sorted(samples[name].items())]
        for name in ("Square", "Cuboid")
    )
    assert strengths == true and len(strengths[4]) > 2 * len(strengths[0]) > 0
