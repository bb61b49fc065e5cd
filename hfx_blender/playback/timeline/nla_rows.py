# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of an NLA Editor, found in the pixels that Blender has drawn.

Rows depend on filters and folded objects, and Blender's API tells none. A row with strips differs
from the gap above at strips alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
import numpy.typing as npt

from ...engine.arrays import I32


def rows_of_tracks(
    context: bpy.types.Context,
) -> Iterator[tuple[bpy.types.Object, bpy.types.NlaTrack, float, float]]:
    """Yield (effect, track, lower end, upper end in pixels) for tracks of effects in the current
    NLA Editor; none of an effect in *Tweak Mode*, and none for rows of ambiguous strips."""
    import gpu

    region, system = context.region, context.preferences.system
    # Sizes of Blender's own drawing (ED_anim_api.hh).
    unit = round(18.0 * system.ui_scale) + 2.0 * system.pixel_size
    height, gap = (1.2 if context.space_data.show_strip_curves else 0.8) * unit, 0.1 * unit
    ruler = 23.0 * system.ui_scale
    high = region.view2d.view_to_region(0.0, 0.0, clip=False)[1] - ruler - gap
    picture = gpu.state.active_framebuffer_get()

    def line(y: float) -> I32:
        pixels = picture.read_color(0, int(y), region.width, 1, 4, 0, "UBYTE")
        # Buffers of several dimensions have wrong strides before Blender 5.
        pixels.dimensions = 4 * region.width
        return np.array(pixels, np.int32).reshape(region.width, 4)

    pairs = nla_tracks(context)
    masks = [strip_mask(region, track) for _, track in pairs]
    rows: list[tuple[float, list[int]]] = []
    while pairs and high > height:
        if high + gap < region.height - ruler:
            is_filled = (abs(line(high - 0.5 * height) - line(high + 0.5 * gap)) > 2).any(axis=1)
            numbers = [k for k, mask in enumerate(masks) if fits(is_filled, mask)]
            rows += [(high, numbers)] if numbers else []
        high -= height + gap
    certain = certain_tracks([numbers for _, numbers in rows])
    for (upper, _), number in zip(rows, certain, strict=True):
        if number is not None:
            yield *pairs[number], upper - height, upper


def certain_tracks(rows: list[list[int]]) -> list[int | None]:
    """Number of the track of each row, from the numbers of the fitting tracks, ascending. Rows and
    tracks have the same order. None for a row with several possible tracks, as effects with clips
    at the same times have if some are folded or out of view."""
    lowest: list[int | None] = []
    highest: list[int | None] = []
    below, above = -1, 1 + max((numbers[-1] for numbers in rows), default=0)
    for numbers in rows:
        lowest.append(next((k for k in numbers if k > below), None))
        below = below if lowest[-1] is None else lowest[-1]
    for numbers in reversed(rows):
        highest.append(next((k for k in reversed(numbers) if k < above), None))
        above = above if highest[-1] is None else highest[-1]
    pairs = zip(lowest, reversed(highest), strict=True)
    return [low if low == high else None for low, high in pairs]


def nla_tracks(context: bpy.types.Context) -> list[tuple[bpy.types.Object, bpy.types.NlaTrack]]:
    """Tracks of effects as an NLA Editor sorts the rows, from above."""
    shown = [o for o in context.view_layer.objects if o.hfx.role == "EFFECT" and o.animation_data]
    shown.sort(key=lambda effect: effect.name.casefold())
    animated = ((effect, effect.animation_data) for effect in shown)
    return [(e, t) for e, d in animated if not d.use_tweak_mode for t in reversed(d.nla_tracks)]


def strip_mask(region: bpy.types.Region, track: bpy.types.NlaTrack) -> I32:
    """Pixels (width,) of a track's row: 1 within strips, -1 outside, 0 near the strips' borders."""
    mask = np.full(region.width, -1, np.int32)
    for value, margin in ((0, 3.0), (1, -3.0)):
        for strip in track.strips:
            ends = (strip.frame_start, -margin), (strip.frame_end, margin)
            left, right = (
                max(round(region.view2d.view_to_region(frame, 0.0, clip=False)[0] + aside), 0)
                for frame, aside in ends
            )
            mask[left:right] = value
    return mask


def fits(is_filled: npt.NDArray[np.bool_], mask: I32) -> bool:
    """Test a row's filled pixels (width,) for the strips of :func:`strip_mask`; False without any
    strip in view."""
    inside, outside = is_filled[mask > 0], is_filled[mask < 0]
    # Names are drawn over strips, and scroll bars over the rest.
    return bool(len(inside)) and inside.mean() > 0.8 and outside.sum() < 0.02 * len(mask)
