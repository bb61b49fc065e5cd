# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of an NLA Editor, from the order of the channels and the pixels that Blender has drawn.

Rows depend on folded objects, which Blender's API does not name. A row with strips differs from its
background at strips alone.
"""

import re
from collections.abc import Iterator

import bpy
import numpy as np

from ...engine.arrays import I32

ANY = -1  # content of a row that may have strips of an action

_folded: set[str] = set()
"""Names of objects folded at the last drawing of their rows."""


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
    # Not by view_to_region, whose whole pixels may lie on the border of a strip.
    low, up = (region.view2d.region_to_view(0.0, y)[1] for y in (0.0, region.height))
    top = region.height * low / (low - up) - ruler - gap
    picture = gpu.state.active_framebuffer_get()

    def line(y: float) -> I32:
        pixels = picture.read_color(0, int(y), region.width, 1, 4, 0, "UBYTE")
        # Buffers of several dimensions have wrong strides before Blender 5.
        pixels.dimensions = 4 * region.width
        return np.array(pixels, np.int32).reshape(region.width, 4)

    pairs, blocks = _channels(context)
    masks = [strip_mask(region, track) for _, track in pairs]
    fitting: list[list[int] | None] = []
    high, header = top, None
    while pairs and high > 0.5 * height:
        numbers = None
        if high + gap < region.height - ruler:
            middle, above = line(high - 0.5 * height), line(high + 0.5 * gap)
            header = header if fitting else middle  # the first row is that of an object
            numbers = [k for k, mask in enumerate(masks) if fits(middle, above, mask, header)]
        fitting.append(numbers)
        high -= height + gap
    unseen = {k for k, mask in enumerate(masks) if not (mask > 0).any()}
    filters = context.space_data.dopesheet
    is_filtered = bool(filters.filter_text or filters.filter_collection)
    tracks = None if is_filtered else arranged_tracks(fitting, blocks, _folded, unseen)
    if tracks is None:  # a search, or rows of other owners of animation, as materials
        tracks = certain_tracks([numbers or [] for numbers in fitting])
    for row, number in enumerate(tracks):
        is_effect = number is not None and pairs[number][0].hfx.role == "EFFECT"
        if is_effect and fitting[row] is not None:
            upper = top - row * (height + gap)
            yield *pairs[number], upper - height, upper


def arranged_tracks(
    fitting: list[list[int] | None],
    blocks: list[tuple[str, list[int]]],
    folded: set[str],
    unseen: set[int],
) -> list[int | None] | None:
    """Number of the track of each row, None for a header, from the order of the objects; None
    instead of a list if other rows have strips.

    ``fitting`` has the tracks with the strips drawn in each row, from the top; None for a row out
    of view. A block is an object's name and the tracks below its header. ``folded`` are the names
    of folded objects, updated from the rows in view. Tracks of ``unseen`` have no strip in view.
    """
    tracks: list[int | None] = [None] * len(fitting)
    row = 0

    for name, block in blocks:
        rows = fitting[row + 1 : row + 1 + len(block)]
        in_view = [(n, track) for n, track in zip(rows, block, strict=False) if n is not None]
        if in_view:
            is_open = all(t == ANY or t in n or (not n and t in unseen) for n, t in in_view)
            (folded.discard if is_open else folded.add)(name)
        row += 1
        if name not in folded:
            tracks[row : row + len(rows)] = block[: len(rows)]
            row += len(block)
    has_others = any(n and t is None for n, t in zip(fitting, tracks, strict=True))
    return None if has_others else [None if track == ANY else track for track in tracks]


def certain_tracks(rows: list[list[int]]) -> list[int | None]:
    """Number of the track of each row, from the numbers of the fitting tracks, ascending. Rows and
    tracks have the same order. None for a row with several possible tracks, as effects with clips
    at the same times have if some are folded or out of view."""
    lowest: list[int | None] = []
    highest: list[int | None] = []
    below, above = -1, 1 + max((numbers[-1] for numbers in rows if numbers), default=0)
    for numbers in rows:
        lowest.append(next((k for k in numbers if k > below), None))
        below = below if lowest[-1] is None else lowest[-1]
    for numbers in reversed(rows):
        highest.append(next((k for k in reversed(numbers) if k < above), None))
        above = above if highest[-1] is None else highest[-1]
    pairs = zip(lowest, reversed(highest), strict=True)
    return [low if low == high else None for low, high in pairs]


def _channels(
    context: bpy.types.Context,
) -> tuple[list[tuple[bpy.types.Object, bpy.types.NlaTrack]], list[tuple[str, list[int]]]]:
    """Tracks of all objects with their objects, from above, and blocks of
    :func:`arranged_tracks`, as an NLA Editor sorts the rows."""
    filters = context.space_data.dopesheet
    shown = [
        obj
        for obj in context.view_layer.objects
        if obj.animation_data is not None
        and (obj.select_get() or not filters.show_only_selected)
        and (obj.visible_get() or filters.show_hidden)
    ]
    if filters.use_datablock_sort:
        shown.sort(key=lambda obj: natural_key(obj.name))
    pairs: list[tuple[bpy.types.Object, bpy.types.NlaTrack]] = []
    blocks: list[tuple[str, list[int]]] = []
    for obj in shown:
        data = obj.animation_data
        tracks = [] if data.use_tweak_mode else [*reversed(data.nla_tracks)]
        numbers = range(len(pairs), len(pairs) + len(tracks))
        pairs += [(obj, track) for track in tracks]
        if data.nla_tracks or data.action or filters.show_missing_nla:
            action = [ANY] if data.action or filters.show_missing_nla else []
            blocks.append((obj.name, [*action, *numbers]))
    return pairs, blocks


def natural_key(name: str) -> list[tuple[int, int]]:
    """Key of Blender's order of names (``BLI_strcasecmp_natural``): numbers by value, letters
    without case, a dot before all other characters."""
    parts = re.findall(rb"[0-9]+|[^0-9]", name.encode().lower())
    return [(48, int(p)) if p.isdigit() else (-1 if p == b"." else p[0], 0) for p in parts]


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


def fits(middle: I32, above: I32, mask: I32, header: I32 | None = None) -> bool:
    """Test colours (width, channels) in the middle of a row for the strips of :func:`strip_mask`,
    with those of the gap above, and of a row without strips if one is in view; False without any
    strip in view."""
    inside, outside = mask > 0, mask < 0
    is_changed = (abs(middle - above) > 2).any(axis=1)
    # The borders of strips reach into the gap: strips differ from the rest of their row, too.
    rest = middle[outside & ~is_changed]
    background = np.median(rest, axis=0) if len(rest) else above
    # Frames of the scene are brighter than others: a strip of all of them would fit each row.
    background = background if header is None else header
    is_filled = (abs(middle - background) > 2).any(axis=1)
    # Names are drawn over strips, and scroll bars over the rest.
    is_rest_empty = (is_filled & is_changed & outside).sum() < 0.02 * len(mask)
    return bool(inside.any() and is_filled[inside].mean() > 0.8 and is_rest_empty)
