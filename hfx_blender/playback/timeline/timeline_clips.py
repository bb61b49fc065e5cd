# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips with envelopes, drawn in Blender's timeline and over the strips of the NLA Editor.

Effects of a group (rain, a sensation) share a row of the timeline.
"""

import logging
from collections.abc import Iterable, Iterator
from itertools import pairwise, zip_longest
from math import inf

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...authoring import clips
from ...authoring.effects import effects, swarms
from ...authoring.volumes import effect_colour
from ...blender import events
from ...blender.translation import translated

_log = logging.getLogger(__name__)

_LEAST_ROW, _MOST_ROW = 4.0, 22.0
"""Height of an effect's row at an interface scale of 1, pixels."""

_WANTED_ROWS = 4

_RULER, _BELOW, _GAP = 24.0, 3.0, 1.0
_POINTS = 96
_NO_CLIPS = "Clips appear here: press Add Clip"
_STRIP = (0.1, 0.1, 0.1, 1.0)  # below the envelope of a strip in the NLA Editor
# Height from which on a row has the effect's name, pixels.
_TEXT_ROW = 11.0

Point = tuple[float, float]

Row = tuple[
    str, float, float, list[tuple[bpy.types.Object, bpy.types.NlaTrack, bpy.types.NlaStrip]]
]
"""Row of an editor: name, lower and upper end in pixels, and clips (effect, track, strip). Without
a name each clip has a name of its own, and covers Blender's drawing of the strip."""


def _rows(listed: list[bpy.types.Object]) -> dict[str, list[bpy.types.Object]]:
    """Effects with clips, by effect or group name."""
    rows: dict[str, list[bpy.types.Object]] = {}
    for effect in listed:
        if clips.strips_of(effect):
            rows.setdefault(effects.group_of(effect) or effect.name, []).append(effect)
    return rows


def wanted_height(context: bpy.types.Context) -> float:
    """Pixels of height for the rows of all clips in a timeline, at most four; 0 without clips."""
    rows = min(len(_rows(swarms.listed_effects(context.scene))), _WANTED_ROWS)
    scale = context.preferences.system.ui_scale
    return scale * (_RULER + _BELOW + rows * _MOST_ROW) if rows else 0.0


def _timeline_rows(context: bpy.types.Context) -> Iterator[Row]:
    """Rows of a timeline below the ruler, for the selected effects, or all without a selection;
    rows without room are left out."""
    scene = context.scene
    listed = swarms.listed_effects(scene)
    rows = _rows([e for e in listed if swarms.is_selected(scene, e)] or listed)
    scale, top = context.preferences.system.ui_scale, context.region.height
    room = top - (_RULER + _BELOW) * scale
    height = min(max(room / max(len(rows), 1), _LEAST_ROW * scale), _MOST_ROW * scale)
    for number, (name, row) in enumerate([*rows.items()][: max(int(room / height), 1)]):
        low = top - _RULER * scale - (number + 1) * height
        strips = [(effect, *clip) for effect in row for clip in clips.strips_of(effect)]
        yield name, low, low + height - _GAP * scale, strips


def _draw_rows(context: bpy.types.Context, rows: Iterable[Row]) -> None:
    """Draw envelopes of clips in colours of modalities, pale where muted, with names where there is
    room. A selected strip of the NLA Editor has a white border."""
    from ..preview.drawing import card_state, write

    scale = context.preferences.system.ui_scale
    region, shader = context.region, gpu.shader.from_builtin("SMOOTH_COLOR")
    corners: list[Point] = []
    colours: list[tuple[float, ...]] = []
    names: list[tuple[str, float, float, float, float]] = []

    def add(a: Point, b: Point, c: Point, d: Point, colour: tuple[float, ...]) -> None:
        corners.extend((a, b, c, a, c, d))
        colours.extend([colour] * 6)

    for name, low, high, row_clips in rows:
        is_group = len({effect.name for effect, _, _ in row_clips}) > 1
        for effect, track, strip in row_clips:
            colour = effect_colour(effect.hfx, context.scene.hfx.palette)[:3]
            is_off = strip.mute or track.mute or effects.is_muted(effect)
            # The envelope in pixels, piecewise linear: the NLA's own curve is not public.
            points = [
                (region.view2d.view_to_region(frame, 0.0, clip=False)[0], value)
                for frame, value in clips.envelope(strip, _POINTS)
            ]
            left, right = points[0][0], points[-1][0]
            if right < 0.0 or left > region.width:
                continue
            edge = 0.0 if name else 1.5 * scale
            bottom, tall = low + edge, high - low - 2.0 * edge
            borders = [] if name else [(0.0, (float(strip.select),) * 3 + (1.0,)), (edge, _STRIP)]
            for inset, shade in (*borders, (edge, (*colour, 0.10 if is_off else 0.25))):
                sides = left + inset, right - inset, low + inset, high - inset
                box = tuple((sides[x], sides[y]) for x, y in ((0, 2), (1, 2), (1, 3), (0, 3)))
                add(*box, shade)
            points = [(min(max(x, left + edge), right - edge), value) for x, value in points]
            for (x, value), (to, then) in pairwise(points):
                top, end = bottom + value * tall, bottom + then * tall
                front = (*colour, 0.25 if is_off else 0.85)
                add((x, bottom), (to, bottom), (to, end), (x, top), front)
            if is_group and names and names[-1][0] == name:  # write the group's name once
                _, first, _, last, _ = names.pop()
                left, right = min(left, first), max(right, last)
            title = name or f"{effect.name}: {strip.name}"
            names.append((title, left, low, right, high - low))
    if not corners:
        return
    content = {"pos": corners, "color": colours}
    with card_state():
        batch_for_shader(shader, "TRIS", content).draw(shader)
    blf.size(0, 10.0 * scale)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.8)
    ends: dict[float, float] = {}  # of the names written in a row, by its lower end
    names.sort(key=lambda entry: entry[2::-1])
    for (name, left, low, right, tall), (_, following, row, *_) in zip_longest(
        names, names[1:], fillvalue=("", inf, -inf)
    ):
        x = max(left, 0.0) + 3.0 * scale
        if tall >= _TEXT_ROW * scale and x >= ends.get(low, 0.0):
            # The name of a short clip goes on to the next clip of the row.
            end = max(right, following if row == low else region.width)
            write(name, x, low + 0.3 * tall, end - x)
            ends[low] = min(end, x + blf.dimensions(0, name)[0])
    blf.disable(0, blf.SHADOW)


_view: tuple[float, ...] = ()  # first and last frame of the timeline drawn last
_has_failed = False  # True after an exception; drawing stops then


def _draw() -> None:
    global _view, _has_failed
    context = bpy.context
    is_nla = context.space_data.type == "NLA_EDITOR"
    if _has_failed or not (is_nla or context.space_data.mode == "TIMELINE"):
        return
    try:
        view2d, width = context.region.view2d, context.region.width
        view = tuple(view2d.region_to_view(x, 0.0)[0] for x in (0.0, width))
        if view != _view and context.window_manager.hfx_show_values:
            # The time axis of the values in viewports is that of the timeline.
            _view = view
            events.redraw("VIEW_3D")
        if not is_nla:
            _draw_rows(context, _timeline_rows(context))
            return
        from ..preview.drawing import write  # modules not needed at Blender's start
        from .nla_rows import rows_of_tracks

        rows = rows_of_tracks(context)
        _draw_rows(context, (("", *ends, [(e, t, s) for s in t.strips]) for e, t, *ends in rows))
        if not wanted_height(context) and effects.bodies_of(context.scene):
            blf.size(0, 11.0 * context.preferences.system.ui_scale)
            blf.color(0, 0.7, 0.7, 0.7, 1.0)
            # Right of the playhead at the first frame.
            write(translated(_NO_CLIPS), 0.15 * width, 0.5 * context.region.height, 0.84 * width)
    except Exception:
        _has_failed = True
        _log.exception("clips in the timeline or NLA Editor")


_handlers = events.DrawHandlers(
    (bpy.types.SpaceDopeSheetEditor, _draw, "POST_PIXEL"), (bpy.types.SpaceNLA, _draw, "POST_PIXEL")
)
register, unregister = _handlers.register, _handlers.unregister
