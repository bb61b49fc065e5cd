# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects from body to body and file to file: copied, pasted, saved, listed among the shipped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effect_file, effects
from hfx_blender.engine.body.model import load_model
from hfx_blender.files import resources
from hfx_blender.operators.effects import sensation_library


@pytest.fixture
def body(scene: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    monkeypatch.setenv(resources.EFFECTS_VARIABLE, str(tmp_path / "own"))
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


def only(obj: Any) -> None:
    for selected_object in bpy.context.selected_objects:
        selected_object.select_set(False)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def touch_and_ball() -> list[Any]:
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    touch = bpy.context.object
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    bpy.ops.hfx.add_clip(start=10.0, duration=1.0)
    bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE", name="Ball", location=(1, 0, 1))
    touch.select_set(True)
    return [touch, bpy.context.object]


def test_pasted_effects_are_on_the_active_body_from_now_on(body: Any) -> None:
    touch, _ = touch_and_ball()
    bpy.ops.hfx.copy_effects()
    bpy.ops.hfx.add_avatar()
    second = bpy.context.object
    second.location = (5, 0, 0)
    only(second)
    bpy.context.scene.frame_set(101)
    bpy.context.view_layer.update()
    bpy.ops.hfx.paste_effects()
    pasted = {obj.hfx.kind: obj for obj in bpy.context.selected_objects}
    assert pasted["PAINTED"].hfx.body == second and touch.hfx.body == body
    assert effects.area(pasted["PAINTED"]) == effects.area(touch)
    ((_, strip),) = clips.strips_of(pasted["PAINTED"])
    assert strip.frame_start == 101
    # Equal distance: copy to second body, and original to first body.
    assert tuple(pasted["VOLUME"].location) == pytest.approx((6, 0, 1))


def test_a_copy_is_pasted_in_place_on_a_body_that_stands_elsewhere(body: Any) -> None:
    body.location = (3, 2, 0)
    bpy.context.view_layer.update()
    _, ball = touch_and_ball()
    only(ball)
    bpy.ops.hfx.copy_effects()
    bpy.ops.hfx.paste_effects()
    assert tuple(bpy.context.object.location) == pytest.approx((1, 0, 1))


def test_a_copy_of_another_file_is_pasted(body: Any, tmp_path: Path) -> None:
    touch_and_ball()
    bpy.ops.hfx.copy_effects()
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.paste_effects()
    assert len(effects.effects_of(bpy.context.scene)) == 2


def test_nothing_copied_is_told(body: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for text, words in (("", "no effects to paste"), ("{]", "What was copied"), ("{}", "'schema'")):
        monkeypatch.setattr(sensation_library, "copied_sensation", text)
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.hfx.paste_effects()
    assert effects.effects_of(bpy.context.scene) == []


def test_large_areas_that_were_saved_can_be_loaded(body: Any, tmp_path: Path) -> None:
    for number in range(2):
        bpy.ops.hfx.add_painted(modality="vibration", name=f"All {number}")
        bpy.ops.hfx.fill_part(part="all")
    for effect in effects.effects_of(bpy.context.scene):
        effect.select_set(True)
    path = tmp_path / "large.hfxeffect"
    bpy.ops.hfx.save_effects(filepath=str(path))
    assert path.stat().st_size > 1 << 20
    loaded, size = effect_file.load(path), len(load_model("hfx-vibration-1"))
    assert [len(entry.where.vertices) for entry in loaded.effects] == [size, size]


def test_own_sensations_are_listed_and_spoilt_ones_left_out(body: Any) -> None:
    folder = resources.user_effects()
    folder.mkdir()
    (folder / "spoilt.hfxeffect").write_text("{")
    shipped = list(sensation_library.sensation_items(None, None))
    assert len(shipped) >= 20 and all(item[0] for item in shipped)
    _, ball = touch_and_ball()
    only(ball)
    bpy.ops.hfx.save_effects(filepath=str(folder / "my_wind.hfxeffect"))
    listed = sensation_library.sensation_items(None, None)
    assert listed[len(shipped) :] == [
        ("", "Your Own", ""),
        ("own/my_wind", "My Wind", "A sensation of your own"),
    ]
    bpy.ops.hfx.add_from_library(name="own/my_wind")
    assert bpy.context.object.hfx.modality == "wind"


def test_effects_are_saved_under_a_name_only(body: Any) -> None:
    touch_and_ball()
    with pytest.raises(RuntimeError, match="no name of a file"):
        bpy.ops.hfx.save_effects()
