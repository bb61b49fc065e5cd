# SPDX-License-Identifier: GPL-3.0-or-later
"""Waveforms of clips in the sidebar: previews, as Blender's icons, with time from left to right."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import bpy
import bpy.utils.previews

from ...authoring import clips
from ...authoring.effects import effects
from ...blender import compat
from ...blender.scene_info import animation_fps

if TYPE_CHECKING:
    from ...engine.arrays import F64

SIZE = 96  # of a preview, pixels
_TIMES = 8  # evaluated times in a column of pixels
_BACK = (0.1, 0.1, 0.1)

_previews: bpy.utils.previews.ImagePreviewCollection | None = None
_shown: dict[str, bytes] = {}
"""Pixels by name of the preview."""


def waveform(
    scene: bpy.types.Scene, effect: bpy.types.Object, strip: bpy.types.NlaStrip | None, count: int
) -> tuple[F64, F64]:
    """Lowest and highest strength, (count,) each, -1 to 1 of the full strength, in equal parts of a
    clip, or of the scene for None: activation times intensity. A vibration oscillates around 0 at
    its present frequency, other effects start from 0."""
    import numpy as np

    start, end = float(scene.frame_start), scene.frame_end + 1.0
    if strip is not None:
        start, end = strip.frame_start, strip.frame_end
    frames = np.linspace(start, end, count * _TIMES + 1)
    # Neighbouring columns share a time, so that the drawn wave has no gaps.
    columns = np.arange(count)[:, None] * _TIMES + np.arange(_TIMES + 1)
    levels = np.ones(len(frames))
    if strip is not None:
        levels = np.interp(frames, *np.transpose(clips.envelope(strip, count)))
    for path in (clips.DATA_PATH,) * (strip is None) + ("hfx.intensity",):
        curve = compat.fcurve_of(effect, path)
        if curve is not None:
            levels *= [curve.evaluate(frame) for frame in frames.tolist()]
        elif path == "hfx.intensity":
            levels *= effect.hfx.intensity
    levels = np.clip(levels, 0.0, 1.0)[columns]
    highest = levels.max(axis=1)
    if effect.hfx.modality != "vibration":
        return np.zeros(count), highest
    seconds = (frames - start)[columns] / animation_fps(scene)
    if effect.hfx.frequency * (seconds[-1, -1] / count) > 1.0:
        return -highest, highest  # a column of pixels has a period or more
    waves = levels * np.sin(2.0 * pi * effect.hfx.frequency * seconds)
    return waves.min(axis=1), waves.max(axis=1)


def icon(
    context: bpy.types.Context,
    effect: bpy.types.Object,
    strip: bpy.types.NlaStrip | None,
    number: int = 0,
) -> int:
    """Icon of a waveform in the colour of the modality, pale while muted, for the clip of this
    number in the panel. The preview is painted again if the waveform has changed."""
    import numpy as np

    from ...engine.colouring import PALETTES

    global _previews
    if _previews is None:
        _previews = bpy.utils.previews.new()
    lowest, highest = waveform(context.scene, effect, strip, SIZE)
    is_off = effects.is_muted(effect) or (strip is not None and strip.mute)
    colour = np.array(PALETTES[context.scene.hfx.palette][effect.hfx.modality])
    colour += (np.array(_BACK) - colour) * (0.65 if is_off else 0.0)
    # Rows of pixels are values from the lower end: -1 to 1 for vibrations, else 0 to 1.
    bottom = -1.0 if effect.hfx.modality == "vibration" else 0.0
    values = np.linspace(bottom, 1.0, SIZE)[:, None]
    half = 0.5 * (values[1] - values[0])  # at least a row is filled: a line at 0
    is_filled = (values >= lowest - half) & (values <= highest + half)
    shades = np.where(is_filled[..., None], colour, _BACK)
    pixels = np.insert(255.0 * shades, 3, 255.0, axis=2).astype(np.uint8)
    name = str(number)
    preview = _previews.get(name) or _previews.new(name)
    if _shown.get(name) != pixels.tobytes():
        _shown[name] = pixels.tobytes()
        preview.image_size = SIZE, SIZE
        preview.image_pixels.foreach_set(pixels.view(np.int32).ravel())
    return int(preview.icon_id)


def unregister() -> None:
    global _previews
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
        _previews = None
        _shown.clear()
