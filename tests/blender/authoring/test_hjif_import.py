# SPDX-License-Identifier: GPL-3.0-or-later
"""An exported HJIF file, imported as painted effects: the same is felt again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import pytest
from hfx_scenes import small_scene

from hfx_blender.authoring import clips
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
    scene.frame_set(scene.frame_start)
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


@pytest.mark.parametrize("suffix", [".hjif", ".haptic"])
def test_imported_effects_and_clips_alone_are_selected(
    registered: Any, tmp_path: Path, suffix: str
) -> None:
    """The NLA Editor moves every selected strip, so older clips must not be selected."""
    scene = small_scene()
    if suffix == ".hjif":
        exported(scene, tmp_path, "first")
    else:
        envelope = {"amplitude": [{"time": time, "amplitude": 0.5} for time in (0.0, 2.0)]}
        document = {
            "version": {"major": 1, "minor": 0, "patch": 0},
            "metadata": {},
            "signals": {"continuous": {"envelopes": envelope}},
        }
        (tmp_path / "first.haptic").write_text(json.dumps(document))
    old = set(effects.effects_of(scene))
    for effect in old:
        for _, strip in clips.strips_of(effect):
            strip.select = True
    assert bpy.ops.hfx.import_hjif(filepath=str(tmp_path / f"first{suffix}")) == {"FINISHED"}
    new = set(effects.effects_of(scene)) - old
    assert new and set(bpy.context.selected_objects) == new and bpy.context.object in new
    selected = {e for e in old | new for _, strip in clips.strips_of(e) if strip.select}
    assert selected == new


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


def _ahap(amplitude: float) -> str:
    """A continuous event of two seconds, as Apple's documentation writes it."""
    parameters = [
        {"ParameterID": "HapticIntensity", "ParameterValue": amplitude},
        {"ParameterID": "HapticSharpness", "ParameterValue": 0.5},
    ]
    event = {
        "Time": 0.0,
        "EventType": "HapticContinuous",
        "EventDuration": 2.0,
        "EventParameters": parameters,
    }
    return json.dumps({"Version": 1.0, "Pattern": [{"Event": event}]})


def _haptic(amplitude: float) -> str:
    """A clip of Meta's format of two seconds with a constant envelope."""

    def points(name: str, value: float) -> list[dict[str, float]]:
        return [{"time": time, name: value} for time in (0.0, 2.0)]

    envelopes = {"amplitude": points("amplitude", amplitude), "frequency": points("frequency", 0.5)}
    return json.dumps(
        {
            "version": {"major": 1, "minor": 0, "patch": 0},
            "metadata": {},
            "signals": {"continuous": {"envelopes": envelopes}},
        }
    )


@pytest.mark.parametrize(("suffix", "text_of"), [("ahap", _ahap), ("haptic", _haptic)])
def test_vibration_of_other_formats_is_felt_on_the_whole_body(
    registered: Any, tmp_path: Path, suffix: str, text_of: Any
) -> None:
    """Intensity .5 of the default amplitude, from the current frame on for two seconds."""
    scene = small_scene()
    scene.frame_end, scene.render.fps = 100, 24
    for effect in effects.effects_of(scene):
        effect.hfx.is_muted = True
    default = scene.objects["Ball"].hfx.bl_rna.properties["amplitude"].default
    scene.frame_set(25)
    path = tmp_path / f"buzz.{suffix}"
    path.write_text(text_of(0.5))
    assert bpy.ops.hfx.import_hjif(filepath=str(path)) == {"FINISHED"}
    (created,) = (effect for effect in effects.effects_of(scene) if not effect.hfx.is_muted)
    assert created.hfx.modality == "vibration"
    assert created.hfx.amplitude == pytest.approx(0.5 * default, rel=1e-3)
    assert len(effects.area(created)[0]) == len(effects.model_of(created))
    (samples,) = export_scene(scene, tmp_path, "x", ExportSettings(("track",))).felt
    start = (25 - scene.frame_start) / 24
    assert samples["first_s"] == pytest.approx(start, abs=0.05)
    assert samples["seconds"] == pytest.approx(2.0, abs=0.1)


def test_files_dropped_on_a_window_are_imported(registered: Any, tmp_path: Path) -> None:
    handlers = [
        handler for handler in bpy.types.FileHandler.__subclasses__() if "hfx" in handler.__module__
    ]
    by_suffix = {
        suffix: handler.bl_import_operator
        for base in handlers
        for handler in base.__subclasses__()
        for suffix in handler.bl_file_extensions.split(";")
    }
    for suffix, operator in {
        ".hfxeffect": "hfx.load_effects",
        ".hfxpath": "hfx.load_path",
        ".hjif": "hfx.import_hjif",
        ".haptic": "hfx.import_hjif",
        ".ahap": "hfx.import_hjif",
    }.items():
        assert by_suffix[suffix] == operator
        options = getattr(bpy.ops.hfx, operator.removeprefix("hfx.")).get_rna_type()
        assert options.properties["filepath"].is_skip_save, "or a menu would take the last file"


def test_a_dropped_path_needs_no_point(scene: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_spot()
    bpy.ops.hfx.path_from_library(name="circle_chest")
    file = tmp_path / "circle.hfxpath"
    bpy.ops.hfx.save_path(filepath=str(file))
    bpy.ops.hfx.remove_effects()
    assert not effects.effects_of(scene)
    bpy.ops.hfx.load_path(filepath=str(file))
    (spot,) = effects.effects_of(scene)
    assert spot.hfx.kind == "SPOT" and len(spot["hfx_path"]) > 10
