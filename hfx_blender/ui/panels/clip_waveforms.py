# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms of clips in the sidebar: previews, as of Blender's icons, in colours of modalities."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import bpy.utils.previews

from ...authoring import clips
from ...authoring.effects import effects
from ...authoring.volumes import effect_colour
from ...blender import compat

if TYPE_CHECKING:
    from ...engine.arrays import F64

SIZE = 96  # of a preview, pixels

_previews: list[bpy.utils.previews.ImagePreviewCollection] = []  # none or one
_painted: dict[int, tuple[object, ...]] = {}  # base, colour and strengths by number


def waveform(effect: bpy.types.Object, strip: bpy.types.NlaStrip, count: int) -> F64:
    """Strength 0 to 1, (count,) evenly from start to end of a clip: activation times intensity."""
    import numpy as np

    frames = np.linspace(strip.frame_start, strip.frame_end, count)
    levels = np.interp(frames, *np.transpose(clips.envelope(strip, count)))
    curve = compat.fcurve_of(effect, "hfx.intensity")
    intensity = effect.hfx.intensity if curve is None else [curve.evaluate(f) for f in frames]
    return np.clip(levels * intensity, 0.0, 1.0)


def icon(
    context: bpy.types.Context, effect: bpy.types.Object, strip: bpy.types.NlaStrip, number: int
) -> int:
    """Paint the waveform of the clip of this number in the panel, dark if muted; return the icon.
    A vibration extends to both sides of the middle, other effects rise from the lower end. A white
    line is the playhead."""
    import numpy as np

    if not _previews:
        _previews.append(bpy.utils.previews.new())
        _painted.clear()
    preview = _previews[0].get(str(number)) or _previews[0].new(str(number))
    colour = np.array(effect_colour(effect.hfx, context.scene.hfx.palette)[:3])
    colour *= 0.35 if effects.is_muted(effect) or strip.mute else 1.0
    lowest = -1.0 if effect.hfx.modality == "vibration" else 0.0
    levels = waveform(effect, strip, SIZE)
    length = max(strip.frame_end - strip.frame_start, 1e-6)
    playhead = int((context.scene.frame_current_final - strip.frame_start) / length * SIZE // 1)
    if _painted.get(number) == (key := (lowest, colour.tobytes(), levels.tobytes(), playhead)):
        return int(preview.icon_id)
    _painted[number] = key
    values = np.linspace(lowest, 1.0, SIZE)[:, None]  # of the rows of pixels, from the lower end
    # At least the row of value 0 is filled: a line.
    is_filled = abs(values) <= np.maximum(levels, 0.02)
    shades = np.where(is_filled[..., None], colour, 0.1)
    shades[:, [playhead] if 0 <= playhead < SIZE else []] = 1.0
    pixels = np.insert(255.0 * shades, 3, 255.0, axis=2).astype(np.uint8).view(np.int32).ravel()
    preview.image_size = SIZE, SIZE
    preview.image_pixels.foreach_set(pixels)
    return int(preview.icon_id)


def unregister() -> None:
    while _previews:
        bpy.utils.previews.remove(_previews.pop())
