# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the parameters of effects and of clips, in Blender's own preset system."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring.effects import effects


def _files(modality: str) -> dict[str, Path]:
    folders = bpy.utils.preset_paths(f"hfx_haptics/{modality}")
    return {path.stem: path for folder in folders for path in Path(folder).glob("*.py")}


def test_a_preset_of_parameters_is_added_loaded_and_removed(scene: Any) -> None:
    effect = effects.add_volume(scene, "vibration", "SPHERE")
    bpy.context.view_layer.objects.active = effect
    effect.hfx.frequency, effect.hfx.amplitude, effect.hfx.intensity = 60.0, 7.0, 0.5
    bpy.ops.hfx.effect_preset(name="Low Rumble")
    effect.hfx.frequency, effect.hfx.amplitude, effect.hfx.intensity = 250.0, 1.0, 1.0
    effect.hfx.radius = 2.0
    (path,) = _files("vibration").values()
    assert path.stem == "Low_Rumble"
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="HFX_PT_effect_presets")
    values = effect.hfx.frequency, effect.hfx.amplitude, effect.hfx.intensity
    assert values == pytest.approx((60.0, 7.0, 0.5))
    assert effect.hfx.radius == 2.0, "the place and size stay"
    effect.hfx.modality = "wind"
    assert not _files("wind"), "each modality has its own presets"
    bpy.ops.hfx.effect_preset(name="Breeze")
    assert list(_files("wind")) == ["Breeze"]
    bpy.ops.hfx.effect_preset(name="Breeze", remove_name=True)
    assert not _files("wind") and len(_files("vibration")) == 1


def test_clips_and_exports_have_presets_without_the_start(registered: Any) -> None:
    for name in ("HFX_OT_add_clip", "HFX_OT_add_heartbeat", "HFX_OT_export"):
        assert "PRESET" in getattr(bpy.types, name).bl_options
    properties = bpy.ops.hfx.add_clip.get_rna_type().properties
    assert properties["start"].is_skip_save and not properties["duration"].is_skip_save
