# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms of clips in the sidebar."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.blender import compat
from hfx_blender.ui.panels import clip_waveforms


@pytest.fixture
def effect(scene: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    return bpy.context.object


def test_a_waveform_is_activation_times_intensity(effect: Any) -> None:
    strip = clips.add_clip(effect, 10, 58, fade_in=24, fade_out=12)
    effect.hfx.intensity = 0.5
    levels = clip_waveforms.waveform(effect, strip, 49)  # a value for each frame
    assert levels[[0, 12, 24, 36, 42, 48]] == pytest.approx([0, 0.25, 0.5, 0.5, 0.25, 0], abs=1e-6)
    curve = compat.own_fcurve(effect, "hfx.intensity", "Key")
    compat.set_keys(curve, [(34, 1.0), (35, 0.0)])
    assert clip_waveforms.waveform(effect, strip, 49)[[12, 24, 25]] == pytest.approx(
        [0.5, 1.0, 0.0]
    )


def test_the_preview_has_the_colour_of_the_modality_and_follows_the_clip(effect: Any) -> None:
    strip = clips.add_clip(effect, 10, 58)

    def pixels() -> np.ndarray:
        clip_waveforms.icon(bpy.context, effect, strip, 0)
        flat = np.array(clip_waveforms._previews[0]["0"].image_pixels[:], np.int32)
        return flat.view(np.uint8).reshape(clip_waveforms.SIZE, clip_waveforms.SIZE, 4)

    full = pixels()
    red, green, blue, alpha = full[clip_waveforms.SIZE // 2, clip_waveforms.SIZE // 2]
    assert green > 2 * red and green > 2 * blue and alpha == 255
    strip.blend_in = 48  # a ramp: the upper left corner is empty now
    ramp = pixels()
    assert (ramp[-5, 5] != full[-5, 5]).any() and (ramp[5, -5] == full[5, -5]).all()
    bpy.context.scene.frame_set(34)  # 24 of 48 frames: a white line in the middle
    middle = clip_waveforms.SIZE // 2
    assert (pixels()[:, middle] == 255).all() and not (pixels()[:, middle + 1] == 255).all()
    bpy.context.scene.frame_set(59)  # after the clip
    assert not (pixels()[..., :3] == 255).all(axis=2).any()
    strip.mute = True
    assert pixels()[5, -5, 1] < green
    strip.blend_in, effect.hfx.modality = 0.0, "vibration"
    effect.hfx.intensity = 0.5  # half of both sides of the middle
    rows = (pixels()[:, clip_waveforms.SIZE // 2, :3] != 25).any(axis=1).nonzero()[0]
    assert (rows[0], rows[-1]) == pytest.approx((24, 71), abs=1)
