# SPDX-License-Identifier: GPL-3.0-or-later
"""An exported HJIF file, imported as painted effects: the same is felt again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest
from hfx_scenes import small_scene

from hfx_blender.authoring.effects import effects, hjif_import
from hfx_blender.export.scene_export import ExportSettings, export_scene


def exported(scene: bpy.types.Scene, folder: Path, stem: str) -> dict[str, Any]:
    report = export_scene(scene, folder, stem, ExportSettings(("track", "hjif")))
    return {item["effect"]: item for item in report.felt}


@pytest.mark.parametrize("most_keys", [hjif_import.MOST_KEYS, 0])
def test_what_was_exported_is_felt_again(
    registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_keys: int
) -> None:
    """Also with more keyframes than an effect should have: import reduces the keyframes."""
    monkeypatch.setattr(hjif_import, "MOST_KEYS", most_keys)
    scene = small_scene()
    before = exported(scene, tmp_path, "first")
    vertices, _ = effects.area(bpy.data.objects["Touch"])
    for effect in effects.effects_of(scene):
        effect.hfx.is_muted = True
    assert bpy.ops.hfx.import_hjif(filepath=str(tmp_path / "first.hjif")) == {"FINISHED"}
    touch = bpy.data.objects["Touch.001"]
    assert effects.area(touch)[0] == vertices
    assert touch.hfx.pressure == pytest.approx(bpy.data.objects["Touch"].hfx.pressure, rel=0.01)
    balls = [item for item in effects.effects_of(scene) if item.name.startswith("Ball, ")]
    assert balls and all(ball.hfx.modality == "vibration" for ball in balls)
    assert balls[0].hfx.frequency == pytest.approx(bpy.data.objects["Ball"].hfx.frequency, abs=1)
    after = exported(scene, tmp_path, "second")
    assert after["Touch.001"]["seconds"] == pytest.approx(before["Touch"]["seconds"])
    assert after["Touch.001"]["peak_level"] == pytest.approx(1.0, abs=0.02)


def test_the_area_is_the_body_part_without_our_mesh(registered: Any, tmp_path: Path) -> None:
    scene = small_scene()
    exported(scene, tmp_path, "first")
    for mesh in tmp_path.glob("*.glb"):
        mesh.unlink()
    assert bpy.ops.hfx.import_hjif(filepath=str(tmp_path / "first.hjif")) == {"FINISHED"}
    palms = effects.area(bpy.data.objects["Touch.001"])[0]
    assert set(palms) >= set(effects.area(bpy.data.objects["Touch"])[0])


def test_a_broken_file_adds_nothing(registered: Any, tmp_path: Path) -> None:
    scene = small_scene()
    (tmp_path / "x.hjif").write_text("{}")
    with pytest.raises(RuntimeError, match="HJIF-MISSING"):
        bpy.ops.hfx.import_hjif(filepath=str(tmp_path / "x.hjif"))
    assert len(effects.effects_of(scene)) == 2
