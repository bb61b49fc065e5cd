# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms of clips in the sidebar."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.blender import compat
from hfx_blender.ui.panels import waveforms


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    return bpy.context.object


def test_a_waveform_is_activation_times_intensity(effect: Any, scene: Any) -> None:
    strip = clips.add_clip(effect, 10, 58, fade_in=24, fade_out=12)
    effect.hfx.intensity = 0.5
    lowest, highest = waveforms.waveform(scene, effect, strip, 48)
    assert not lowest.any()
    # A column for each frame: half of the fade in, full strength, half of the fade out.
    for column, expected in ((11, 0.25), (30, 0.5), (42, 0.25)):
        assert highest[column] == pytest.approx(expected, abs=0.03)
    curve = compat.own_fcurve(effect, "hfx.intensity", "Key")
    compat.set_keys(curve, [(34, 1.0), (35, 0.0)])
    _, highest = waveforms.waveform(scene, effect, strip, 48)
    assert highest[23] == pytest.approx(1.0, abs=0.05) and not highest[26:].any()


def test_a_slow_vibration_oscillates_and_a_fast_one_fills_the_envelope(
    effect: Any, scene: Any
) -> None:
    effect.hfx.modality = "vibration"
    strip = clips.add_clip(effect, 10, 58)  # 2 s
    effect.hfx.frequency = 1.0
    lowest, highest = waveforms.waveform(scene, effect, strip, 8)  # quarters of the period
    assert highest == pytest.approx([1, 1, 0, 0, 1, 1, 0, 0], abs=1e-6)
    assert lowest == pytest.approx([0, 0, -1, -1, 0, 0, -1, -1], abs=1e-6)
    effect.hfx.frequency = 100.0
    lowest, highest = waveforms.waveform(scene, effect, strip, 8)
    assert np.array_equal(highest, np.ones(8)) and np.array_equal(lowest, -np.ones(8))


def test_an_effect_without_clips_has_the_waveform_of_the_scene(effect: Any, scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 96
    curve = compat.own_fcurve(effect, "hfx.activation", "Key")
    compat.set_keys(curve, [(48, 0.0), (49, 1.0)])
    _, highest = waveforms.waveform(scene, effect, None, 96)
    assert not highest[:46].any() and highest[49:] == pytest.approx(1.0)


def test_the_preview_has_the_colour_of_the_modality_and_follows_the_clip(effect: Any) -> None:
    strip = clips.add_clip(effect, 10, 58)

    def pixels() -> np.ndarray:
        waveforms.icon(bpy.context, effect, strip)
        flat = np.array(waveforms._previews["0"].image_pixels[:], np.int32)
        return flat.view(np.uint8).reshape(waveforms.SIZE, waveforms.SIZE, 4)

    full = pixels()
    red, green, blue, alpha = full[waveforms.SIZE // 2, waveforms.SIZE // 2]
    assert green > 2 * red and green > 2 * blue and alpha == 255
    strip.blend_in = 48  # a ramp: the upper left corner is empty now
    ramp = pixels()
    assert (ramp[-5, 5] != full[-5, 5]).any() and (ramp[5, -5] == full[5, -5]).all()
    strip.mute = True
    assert pixels()[5, -5, 1] < green
