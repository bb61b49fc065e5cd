# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips in Blender's timeline, each with its envelope, as in editors of sound."""

from __future__ import annotations

import logging
from itertools import pairwise

import bpy

from ..authoring import clips, effects

_log = logging.getLogger(__name__)

_LEAST_ROW, _MOST_ROW = 4.0, 22.0
"""Height of an effect's row at an interface scale of 1, pixels."""

_RULER, _BELOW, _GAP = 24.0, 3.0, 1.0
_POINTS = 96
_TEXT_ROW = 11.0
"""Height from which on a row has the effect's name, pixels."""

_has_failed = False
_handles: list[object] = []


def shown_effects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Effects whose clips are shown: the selected ones, or else all, as far as they have clips."""
    found = effects.effects_of(context.scene)
    selected = [each for each in found if each.select_get()]
    return [each for each in selected or found if clips.strips_of(each)]


def _draw() -> None:
    global _has_failed
    context = bpy.context
    if context.space_data.mode != "TIMELINE" or _has_failed:
        return
    try:
        found = shown_effects(context)
        if found:
            _draw_rows(context, found)
    except Exception:  # it would be raised again at every redraw
        _has_failed = True
        _log.exception("clips in the timeline")


def _draw_rows(context: bpy.types.Context, found: list[bpy.types.Object]) -> None:
    """Draw a row for each effect below the ruler."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    from ..engine.colouring import PALETTES

    scale = context.preferences.system.ui_scale
    palette = PALETTES[context.scene.hfx.palette]
    region, shader = context.region, gpu.shader.from_builtin("SMOOTH_COLOR")
    room = region.height - (_RULER + _BELOW) * scale
    height = min(max(room / len(found), _LEAST_ROW * scale), _MOST_ROW * scale)
    corners: list[tuple[float, float]] = []
    colours: list[tuple[float, ...]] = []
    names = []
    for number, effect in enumerate(found[: max(int(room / height), 1)]):
        low = region.height - _RULER * scale - (number + 1) * height
        high = low + height - _GAP * scale
        colour = palette[effect.hfx.modality]
        for track, strip in clips.strips_of(effect):
            is_off = strip.mute or track.mute or effect.hfx.is_muted
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
            names.append((effect.name, max(left, 0.0) + 3.0 * scale, low, right, high - low))
    gpu.state.blend_set("ALPHA")
    content = {"pos": corners, "color": colours}
    batch_for_shader(shader, "TRIS", content).draw(shader)
    gpu.state.blend_set("NONE")
    for name, x, low, right, tall in names:
        if tall >= _TEXT_ROW * scale:
            _write(name, x, low + 0.3 * tall, right, scale)


def _quad(
    corners: list[tuple[float, float]],
    colours: list[tuple[float, ...]],
    quad: tuple[tuple[float, float], ...],
    colour: tuple[float, ...],
) -> None:
    """Add the two triangles of a quad."""
    a, b, c, d = quad
    corners += (a, b, c, a, c, d)
    colours += [colour] * 6


def _write(text: str, x: float, y: float, right: float, scale: float) -> None:
    """Write an effect's name into its clip if there is room for it."""
    import blf

    blf.size(0, 10.0 * scale)
    if x + blf.dimensions(0, text)[0] < right:
        blf.enable(0, blf.SHADOW)
        blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.8)
        blf.color(0, 1.0, 1.0, 1.0, 1.0)
        blf.position(0, x, y, 0)
        blf.draw(0, text)
        blf.disable(0, blf.SHADOW)


def register() -> None:
    if not bpy.app.background:
        add = bpy.types.SpaceDopeSheetEditor.draw_handler_add
        _handles.append(add(_draw, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    for handle in _handles:
        bpy.types.SpaceDopeSheetEditor.draw_handler_remove(handle, "WINDOW")
    _handles.clear()
