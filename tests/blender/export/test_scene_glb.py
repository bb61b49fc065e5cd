# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of a scene file, read by Blender's own glTF importer: where Blender had the skin."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_validator import gltf_faults

from hfx_blender.engine.tolerance import EXACT
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.formats.glb import glb

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
SCHEMA = Path(__file__).resolve().parents[3] / "docs" / "formats" / "scene-volume.schema.json"


def _scene(scene: Any) -> dict[str, dict[int, np.ndarray]]:
    """A walking, bending, painted body and a moving ball; Blender's skin at some frames."""
    scene.frame_start, scene.frame_end = 1, 9
    body = oracle.add_avatar()
    for bone in body.pose.bones:
        bone.rotation_mode = "XYZ"
        bone.keyframe_insert("rotation_euler", frame=1)
    oracle.bend(body, 3)
    for bone in body.pose.bones:
        bone.keyframe_insert("rotation_euler", frame=9)
    oracle.add_walk(body, [(0, 0, 0), (0.3, -0.4, 0.1)], 1, 9)
    body.rotation_euler, body.scale = (0.2, 0.1, 2.0), (1.3,) * 3
    oracle.add_painted("Felt", "pressure", body)
    oracle.add_painted("Warm", "temperature", body)
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (0, 0, 1), radius=0.4)
    oracle.add_clip(ball, 2, 6)
    references = {m: oracle.model_object(scene, body, m) for m in ("pressure", "temperature")}
    actual: dict[str, dict[int, np.ndarray]] = {}
    for modality, reference in references.items():
        actual[modality] = {}
        for frame in (1, 5, 9):
            oracle.set_time(scene, Fraction(frame))
            actual[modality][frame] = oracle.world_vertices(scene, reference)
    return actual


@pytest.fixture
def exported(scene: Any, tmp_path: Path) -> tuple[Path, dict[str, dict[int, np.ndarray]]]:
    skin = _scene(scene)
    settings = ExportSettings(("glb", "hjif"), rate_hz=Fraction(24), tolerance=EXACT, threads=1)
    export_scene(scene, tmp_path, "x", settings)
    return tmp_path, skin


def test_a_body_that_follows_its_mesh_is_where_its_mesh_is(scene: Any, tmp_path: Path) -> None:
    scene.frame_start, scene.frame_end = 1, 9
    body = oracle.add_avatar()
    oracle.add_walk(body, [(0, 0, 0), (0.3, -0.4, 0.1)], 1, 9)
    oracle.add_painted("Felt", "pressure", body)
    body.hfx.follow = "SURFACE"
    # The mesh moves with the bones of the model, as evaluated by Blender.
    reference = oracle.model_object(scene, body, "pressure")
    skin = {}
    for frame in (1, 6, 9):
        oracle.set_time(scene, Fraction(frame))
        skin[frame] = oracle.world_vertices(scene, reference)
    settings = ExportSettings(("glb",), rate_hz=Fraction(24), tolerance=EXACT, threads=1)
    report = export_scene(scene, tmp_path, "x", settings)
    (note,) = (item for item in report.notes if "follows its mesh" in item)
    most_mm, all_mm = (float(match) for match in re.findall(r"within ([0-9.]+) mm", note))
    assert most_mm < 15.0
    for actual, expected in _imported(tmp_path, {"pressure": skin}):
        off_mm = 1000.0 * np.linalg.norm(actual - expected, axis=1)
        assert np.median(off_mm) < 2.0 and off_mm.max() < all_mm + 2.0


def test_blenders_importer_poses_the_skin_as_blender_did(
    exported: tuple[Path, dict[str, dict[int, np.ndarray]]],
) -> None:
    folder, skin = exported
    for actual, expected in _imported(folder, skin):
        assert np.linalg.norm(actual - expected, axis=1).max() < 1e-5


def _imported(
    folder: Path, skin: dict[str, dict[int, np.ndarray]]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """World positions of the skin posed by Blender's importer, and expected positions."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.import_scene.gltf(filepath=str(folder / "x.scene.glb"))
    for modality, frames in skin.items():
        (mesh,) = [item for item in bpy.data.objects if item.name.endswith(f"hfx-{modality}-1")]
        for frame, expected in frames.items():
            scene.frame_set(frame - 1)  # the imported animation begins at 0
            posed = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
            vertices = np.array([v.co for v in posed.data.vertices])
            world = np.array(posed.matrix_world)
            yield vertices @ world[:3, :3].T + world[:3, 3], expected


def test_what_a_file_names_is_there_and_volumes_have_what_a_collider_needs(
    exported: tuple[Path, dict[str, dict[int, np.ndarray]]],
) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    folder, _ = exported
    scene = glb.read_json((folder / "x.scene.glb").read_bytes(), "x")
    hjif = json.loads((folder / "x.hjif").read_text())
    files = ["x.scene.glb", *(avatar["mesh"] for avatar in hjif["avatars"])]
    for name in files:
        assert gltf_faults(folder / name) == []
        actual = glb.read_json((folder / name).read_bytes(), name)
        (media,) = actual["extensions"]["MPEG_media"]["media"]
        (alternative,) = media["alternatives"]
        assert alternative == {"mimeType": "haptics/hjif", "uri": "x.hjif"}
        assert set(actual["extensionsUsed"]) == set(actual["extensions"])
    (ball,) = [node for node in scene["nodes"] if node["name"] == "Ball"]
    judge = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
    assert [*judge.iter_errors(ball["extras"])] == []
    assert ball["extras"]["shape"] == "sphere"
    assert ball["extras"]["size_m"] == pytest.approx([0.8] * 3)
    (clip,) = ball["extras"]["clips"]
    assert [clip["start_s"], clip["end_s"]] == pytest.approx([1 / 24, 5 / 24], abs=1e-6)
    assert len(scene["animations"]) == 1
