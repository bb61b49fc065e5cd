# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips with envelopes, drawn in Blender's timeline.

Effects of a group (rain, a sensation) share a row.
"""

from __future__ import annotations

import logging
from itertools import pairwise

import bpy

from ...authoring import clips
from ...authoring.effects import effects, swarms
from ...blender import events

_log = logging.getLogger(__name__)

_LEAST_ROW, _MOST_ROW = 4.0, 22.0
"""Height of an effect's row at an interface scale of 1, pixels."""

_WANTED_ROWS = 4

_RULER, _BELOW, _GAP = 24.0, 3.0, 1.0
_POINTS = 96
# Height from which on a row has the effect's name, pixels.
_TEXT_ROW = 11.0


def shown_rows(context: bpy.types.Context) -> dict[str, list[bpy.types.Object]]:
    """Effects with clips, by effect or group name: the selected effects, or all without a
    selection."""
    scene = context.scene
    listed = swarms.listed_effects(scene)
    return _rows([e for e in listed if swarms.is_selected(scene, e)] or listed)


def _rows(listed: list[bpy.types.Object]) -> dict[str, list[bpy.types.Object]]:
    rows: dict[str, list[bpy.types.Object]] = {}
    for effect in listed:
        if clips.strips_of(effect):
            rows.setdefault(effects.group_of(effect) or effect.name, []).append(effect)
    return rows


def wanted_height(context: bpy.types.Context) -> float:
    """Height of a timeline region for the rows of all clips, at most four, pixels; 0 without
    clips."""
    rows = min(len(_rows(swarms.listed_effects(context.scene))), _WANTED_ROWS)
    scale = context.preferences.system.ui_scale
    return scale * (_RULER + _BELOW + rows * _MOST_ROW) if rows else 0.0


def _draw_rows(context: bpy.types.Context, rows: dict[str, list[bpy.types.Object]]) -> None:
    """Draw envelopes of clips in colours of modalities, pale where muted, a row below the ruler for
    each entry of ``rows``, with its name where there is room; rows without room are left out."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    from ...authoring.volumes import effect_colour
    from ..preview.drawing import card_state

    scale = context.preferences.system.ui_scale
    region, shader = context.region, gpu.shader.from_builtin("SMOOTH_COLOR")
    room = region.height - (_RULER + _BELOW) * scale
    height = min(max(room / len(rows), _LEAST_ROW * scale), _MOST_ROW * scale)
    corners: list[tuple[float, float]] = []
    colours: list[tuple[float, ...]] = []
    names = []
    for number, (name, row) in enumerate([*rows.items()][: max(int(room / height), 1)]):
        low = region.height - _RULER * scale - (number + 1) * height
        high = low + height - _GAP * scale
        for effect, track, strip in ((e, *clip) for e in row for clip in clips.strips_of(e)):
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
            back = (*colour, 0.10 if is_off else 0.25)
            _quad(corners, colours, ((left, low), (right, low), (right, high), (left, high)), back)
            front = (*colour, 0.25 if is_off else 0.85)
            for (x, value), (to, then) in pairwise(points):
                top, end = low + value * (high - low), low + then * (high - low)
                _quad(corners, colours, ((x, low), (to, low), (to, end), (x, top)), front)
            if len(row) > 1 and names and names[-1][0] == name:  # write the group's name once
                _, first, _, last, _ = names.pop()
                left, right = min(left, first), max(right, last)
            names.append((name, left, low, right, high - low))
    content = {"pos": corners, "color": colours}
    with card_state():
        batch_for_shader(shader, "TRIS", content).draw(shader)
    for name, x, low, right, tall in names:
        if tall >= _TEXT_ROW * scale:
            _write(name, max(x, 0.0) + 3.0 * scale, low + 0.3 * tall, right, scale)


def _quad(
    corners: list[tuple[float, float]],
    colours: list[tuple[float, ...]],
    quad: tuple[tuple[float, float], ...],
    colour: tuple[float, ...],
) -> None:
    """Append the two triangles of a quad to ``corners``, and six times ``colour``."""
    a, b, c, d = quad
    corners += (a, b, c, a, c, d)
    colours += [colour] * 6


def _write(text: str, x: float, y: float, right: float, scale: float) -> None:
    """Write an effect's name at (x, y), pixels, if the name ends before ``right``."""
    import blf

    blf.size(0, 10.0 * scale)
    if x + blf.dimensions(0, text)[0] < right:
        blf.enable(0, blf.SHADOW)
        blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.8)
        blf.color(0, 1.0, 1.0, 1.0, 1.0)
        blf.position(0, x, y, 0)
        blf.draw(0, text)
        blf.disable(0, blf.SHADOW)


class TimelineClips:
    """Drawing of clips in all timelines."""

    def __init__(self) -> None:
        self.has_failed = False  # True after an exception; drawing stops then
        self._handle: object = None
        self._view: tuple[float, float] | None = None  # first and last frame

    def begin_drawing(self) -> None:
        """Draw into all timelines from now on."""
        add = bpy.types.SpaceDopeSheetEditor.draw_handler_add
        self._handle = add(self._draw, (), "WINDOW", "POST_PIXEL")

    def end_drawing(self) -> None:
        """Remove the draw handler, if any."""
        if self._handle is not None:
            bpy.types.SpaceDopeSheetEditor.draw_handler_remove(self._handle, "WINDOW")
            self._handle = None

    def _draw(self) -> None:
        context = bpy.context
        if context.space_data.mode != "TIMELINE" or self.has_failed:
            return
        try:
            view2d, width = context.region.view2d, context.region.width
            view = tuple(view2d.region_to_view(x, 0.0)[0] for x in (0.0, width))
            if view != self._view:
                # The time axis of the values in viewports is that of the timeline.
                self._view = view
                events.redraw("VIEW_3D")
            rows = shown_rows(context)
            if rows:
                _draw_rows(context, rows)
        except Exception:
            self.has_failed = True
            _log.exception("clips in the timeline")


_clips = TimelineClips()


def register() -> None:
    if not bpy.app.background:
        _clips.begin_drawing()


def unregister() -> None:
    _clips.end_drawing()
