# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact forces of volumes in exports, device scripts, live samples and effect files."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import oracle
import pytest

from hfx_blender.authoring.effects import effect_exchange, effect_file
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import approval
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.files import resources
from hfx_blender.formats.glb import glb
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.reading.scene_reader import SceneReader
from hfx_tools.formats import jsonl_rules

RADIUS_M, STIFFNESS = 0.3, 500.0
CENTRE = np.array([0.0, 0.0, 1.3])

SCRIPT = """
def render(haptics):
    felt = [effect for effect in haptics.felt if effect.forces_n is not None]
    if not felt:
        return None
    strongest = max((felt[0].forces_n ** 2).sum(axis=1)) ** 0.5
    return {a.id: {"pressure_kpa": strongest / 10.0} for a in haptics.actuators}
"""


@pytest.fixture
def pushed(scene: Any) -> Any:
    """A body at rest in a stiff ball, for four frames."""
    bpy.ops.hfx.add_avatar()
    scene.frame_start, scene.frame_end = 1, 4
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", CENTRE, radius=RADIUS_M)
    ball.hfx.stiffness = STIFFNESS
    return scene


def exported(scene: Any, folder: Path, *formats: str, devices: Any = ()) -> Path:
    report = export_scene(scene, folder, "x", ExportSettings(formats, devices, tolerance=PAPER))
    assert not report.left_out
    return folder


def samples(folder: Path) -> list[Any]:
    with TrackReader(folder / "x.hfxtrack") as track:
        return [sample for run in track.runs() for sample in run]


def test_forces_are_those_of_a_spring(pushed: Any, tmp_path: Path) -> None:
    folder = exported(pushed, tmp_path, "track", "jsonl", "glb")
    model = oracle.model_object(pushed, oracle_body(), "pressure")
    actual = samples(folder)
    assert len(actual) >= 4
    for sample in actual:
        arms = oracle.world_vertices(pushed, model)[sample.vertices] - CENTRE
        distances = np.linalg.norm(arms, axis=1)
        # Vertices outside count where a part of their cell is inside.
        inside = distances < RADIUS_M
        expected = STIFFNESS * (RADIUS_M - distances) * (arms / distances[:, None]).T
        np.testing.assert_allclose(sample.forces_n[inside], expected.T[inside], atol=0.3)
    lines = list(jsonl_rules.read(folder / "x.samples.jsonl"))
    first = next(line for line in lines if line["type"] == "sample")
    np.testing.assert_allclose(first["forces_n"], actual[0].forces_n, atol=1e-4)
    nodes = glb.read_json((folder / "x.scene.glb").read_bytes(), "x")["nodes"]
    (law,) = [n["extras"]["contact_law"] for n in nodes if "hfx_effect" in n.get("extras", {})]
    assert law["stiffness_n_m"] == STIFFNESS and law["damping_n_s_m"] == 0.0


def oracle_body() -> Any:
    return next(obj for obj in bpy.data.objects if obj.hfx.role == "BODY")


def test_without_stiffness_nothing_is_written(pushed: Any, tmp_path: Path) -> None:
    bpy.data.objects["Ball"].hfx.stiffness = 0.0
    folder = exported(pushed, tmp_path, "track", "jsonl", "glb")
    assert all(sample.forces_n is None for sample in samples(folder))
    assert b"forces_n" not in (folder / "x.samples.jsonl").read_bytes()
    assert b"contact_law" not in (folder / "x.scene.glb").read_bytes()


def test_a_device_script_has_the_forces(
    pushed: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HFX_DEVICES", str(tmp_path / "devices"))
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    (tmp_path / "devices").mkdir()
    content = json.loads((resources.device_configs() / "pressure_vest.json").read_text())
    (tmp_path / "devices" / "pusher.json").write_text(json.dumps(content | {"id": "pusher"}))
    (tmp_path / "devices" / "pusher.py").write_text(SCRIPT)
    script = approval.script_of("pusher")
    assert script is not None
    approval.approve(script)
    device = load_device("pusher")
    folder = exported(pushed, tmp_path, "track", "csv", "clip", devices=(device,))
    strongest = max(float(np.linalg.norm(s.forces_n, axis=1).max()) for s in samples(folder))
    (table,) = folder.glob("*.csv")
    rows = list(csv.DictReader(table.open()))
    values = {float(v) for row in rows for k, v in row.items() if "pressure" in k}
    limit = device.actuators[0].type.strength.highest
    assert max(values) == pytest.approx(min(strongest / 10.0, limit), rel=1e-5)
    shutil.rmtree(tmp_path / "devices")


def test_live_samples_have_forces_and_speeds(pushed: Any) -> None:
    ball = bpy.data.objects["Ball"]
    ball.hfx.stiffness, ball.hfx.damping, ball.hfx.friction = STIFFNESS, 50.0, 0.0
    seconds = iter(np.arange(100.0))
    live = LiveScene(pushed, bpy.context.view_layer, PAPER)
    live.clock = type(live.clock)(pushed, lambda: 0.1 * next(seconds))
    (run,) = live.runs()
    still = run.forces_n.copy()
    # The body stays, the ball moves against it by 5 mm in 0.1 s: 0.05 m/s.
    ball.location.y += 0.005
    bpy.context.view_layer.update()
    (moved,) = live.runs()
    lengths = np.linalg.norm(moved.forces_n, axis=1)
    normals = moved.forces_n[lengths > 1.0] / lengths[lengths > 1.0, None]
    places = oracle.world_vertices(pushed, oracle.model_object(pushed, oracle_body(), "pressure"))
    arms = places[moved.vertices[lengths > 1.0]] - np.array(ball.location)
    depths = RADIUS_M - np.linalg.norm(arms, axis=1)
    # The skin moves at -0.05 m/s along Y relative to the ball.
    expected = STIFFNESS * depths + 50.0 * 0.05 * normals[:, 1]
    chosen = depths > 0.0
    np.testing.assert_allclose(lengths[lengths > 1.0][chosen], expected[chosen], atol=0.4)
    assert still.shape[1] == 3


def test_an_effect_file_keeps_the_law(pushed: Any, tmp_path: Path) -> None:
    ball = bpy.data.objects["Ball"]
    ball.hfx.damping, ball.hfx.friction = 3.5, 0.75
    path = tmp_path / "push.hfxeffect"
    effect_file.save(effect_exchange.sensation_of(pushed, [ball], "Push"), path)
    (volume,) = [effect["volume"] for effect in json.loads(path.read_text())["effects"]]
    assert volume["law"] == {"stiffness_n_m": 500.0, "damping_n_s_m": 3.5, "friction": 0.75}
    created = effect_exchange.place_sensation(pushed, effect_file.load(path), body=None, frame=1.0)
    hfx = created[0].hfx
    assert (hfx.stiffness, hfx.damping, hfx.friction) == (500.0, 3.5, 0.75)
    ball.hfx.stiffness = 0.0
    effect_file.save(effect_exchange.sensation_of(pushed, [ball], "Push"), path)
    assert "law" not in path.read_text()


def plate_at_a_fingertip(scene: Any) -> tuple[Any, np.ndarray]:
    """Plate 2 mm above the lowest fingertip of an avatar, and the places of the model's vertices
    (V, 3)."""
    bpy.ops.hfx.add_avatar()
    model = oracle.model_object(scene, oracle_body(), "vibration")
    places = oracle.world_vertices(scene, model)
    fingers = load_model("hfx-vibration-1").part == PARTS.index("fingers")
    tip = places[fingers][np.argmin(places[fingers, 2])]
    bpy.ops.mesh.primitive_plane_add(size=0.04, location=(tip[0], tip[1], tip[2] + 2e-3))
    bpy.ops.hfx.add_surface(source="PROCEDURAL", procedural="wood-oak")
    plate = bpy.context.object
    plate.hfx.stiffness, plate.hfx.friction = STIFFNESS, 0.0
    return plate, places


def test_a_surface_pushes_skin_behind_its_faces(scene: Any, tmp_path: Path) -> None:
    """A plate 2 mm above the lowest fingertip pushes it up by stiffness times depth."""
    scene.frame_start, scene.frame_end = 1, 3
    plate, places = plate_at_a_fingertip(scene)
    top_m = plate.location.z
    folder = exported(scene, tmp_path, "track", "jsonl", "glb")
    actual = samples(folder)
    assert len(actual) >= 3
    for sample in actual:
        depths = np.maximum(top_m - places[sample.vertices, 2], 0.0)
        expected = np.zeros((len(depths), 3))
        expected[:, 2] = STIFFNESS * depths
        np.testing.assert_allclose(sample.forces_n, expected, atol=1e-3)
        assert expected.max() == pytest.approx(STIFFNESS * 2e-3, rel=1e-3)
        assert sample.parameters[0] == 0.0  # nothing slides
    (report,) = folder.glob("*report.json")
    (warning,) = [text for text in json.loads(report.read_text())["warnings"] if "felt" in text]
    assert "has amplitude 0, and its contact force goes to scripts and files alone" in warning
    lines = list(jsonl_rules.read(folder / "x.samples.jsonl"))
    first = next(line for line in lines if line["type"] == "sample")
    np.testing.assert_allclose(first["forces_n"], actual[0].forces_n, atol=1e-4)
    nodes = glb.read_json((folder / "x.scene.glb").read_bytes(), "x")["nodes"]
    (extras,) = [n["extras"] for n in nodes if "hfx_effect" in n.get("extras", {})]
    assert extras["shape"] == "surface" and extras["contact_law"]["stiffness_n_m"] == STIFFNESS


def test_normals_that_point_inward_are_named(scene: Any) -> None:
    """A closed surface is turned inside out; an open one has no inside."""
    plate, _ = plate_at_a_fingertip(scene)
    assert not any("inward" in text for text in SceneReader(scene).description.warnings)
    bpy.ops.mesh.primitive_cube_add(size=0.04, location=plate.location)
    cube = bpy.context.object.data
    old, plate.data = plate.data, cube
    assert not any("inward" in text for text in SceneReader(scene).description.warnings)
    cube.flip_normals()
    (warning,) = (t for t in SceneReader(scene).description.warnings if "inward" in t)
    assert warning.startswith(f"surface '{plate.name}': its normals point inward")
    plate.hfx.stiffness = 0.0
    assert not any("inward" in text for text in SceneReader(scene).description.warnings)
    old.flip_normals()
    plate.data, plate.hfx.stiffness = old, STIFFNESS
    assert not any("inward" in text for text in SceneReader(scene).description.warnings)


def warnings_of(folder: Path) -> list[str]:
    (report,) = folder.glob("*report.json")
    warnings: list[str] = json.loads(report.read_text())["warnings"]
    return warnings


@pytest.mark.parametrize(
    ("depth_m", "is_turned", "count"),
    [(2e-3, False, 0), (8e-3, False, 10), (-8e-3, True, 10), (-8e-3, False, 0), (-30e-3, True, 0)],
    ids=["pressed", "too deep", "plate faces away", "in front", "far"],
)
def test_skin_too_far_behind_a_surface_is_counted(
    scene: Any, tmp_path: Path, depth_m: float, is_turned: bool, count: int
) -> None:
    """A fingertip 8 mm behind a plate in 3 frames, 0.1 s: 10 samples at 100 Hz. Forces end at 5
    mm."""
    scene.frame_start, scene.frame_end = 1, 3
    scene.render.fps = 30
    plate, _ = plate_at_a_fingertip(scene)
    plate.location.z += depth_m - 2e-3
    if is_turned:
        plate.data.flip_normals()
    texts = [t for t in warnings_of(exported(scene, tmp_path, "track")) if "behind it" in t]
    assert len(texts) == bool(count)
    for text in texts:
        start = f"surface '{plate.name}': skin stood more than 5 mm behind it, where no force is"
        assert text.startswith(start) and text.endswith(f"({count} times)")


def test_a_surface_that_touches_without_sliding_is_said_to(scene: Any, tmp_path: Path) -> None:
    scene.frame_start, scene.frame_end = 1, 3
    plate, _ = plate_at_a_fingertip(scene)
    plate.hfx.stiffness = 0.0
    (warning,) = (t for t in warnings_of(exported(scene, tmp_path / "1", "track")) if "felt" in t)
    assert warning == (
        f"effect '{plate.name}' touches a body, but does not slide along the skin: it is not felt"
    )
    plate.location.z -= 0.5
    (warning,) = (t for t in warnings_of(exported(scene, tmp_path / "2", "track")) if "felt" in t)
    assert warning == f"effect '{plate.name}' touches no body: it is not felt"


def test_a_surface_pushes_live_and_damps(scene: Any) -> None:
    plate, places = plate_at_a_fingertip(scene)
    plate.hfx.damping = 50.0
    seconds = iter(np.arange(100.0))
    live = LiveScene(scene, bpy.context.view_layer, PAPER)
    live.clock = type(live.clock)(scene, lambda: 0.1 * next(seconds))
    (still,) = live.runs()
    depths = np.maximum(plate.location.z - places[still.vertices, 2], 0.0)
    np.testing.assert_allclose(still.forces_n[:, 2], STIFFNESS * depths, atol=1e-3)
    # Upwards by 0.5 mm in 0.1 s: the skin moves into the plate at 5 mm/s.
    plate.location.z += 5e-4
    bpy.context.view_layer.update()
    (moved,) = live.runs()
    depths = np.maximum(plate.location.z - places[moved.vertices, 2], 0.0)
    expected = np.where(depths > 0.0, STIFFNESS * depths + 50.0 * 5e-3, 0.0)
    np.testing.assert_allclose(moved.forces_n[:, 2], expected, atol=2e-3)
