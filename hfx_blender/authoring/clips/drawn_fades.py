# SPDX-License-Identifier: GPL-3.0-or-later
"""Fades drawn as a curve that moves with its clip.

The curve is that of the strip's influence, which Blender leaves where it is in time when the strip
is dragged, trimmed or scaled. So each effect remembers for which span a curve was drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor

import bpy

from ...blender import compat

_SPANS = "hfx_drawn_fades"
"""ID property of an effect: first and last frame, by the name of a clip with drawn fades."""

_HANDLES = ("handle_left", "co", "handle_right")
_HANDLE_TYPES = ("handle_left_type", "handle_right_type")


def draw(effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> bpy.types.FCurve:
    """Give a clip's strength a curve of its own, to be drawn in the Graph or NLA editor.

    It starts as the fades that the clip has, which it takes the place of. One that was drawn
    already is kept.
    """
    if not strip.use_animated_influence:
        start, end = strip.frame_start, strip.frame_end
        rise, fall = strip.blend_in, strip.blend_out
        strip.use_animated_influence = True
        keys = [(start, 0.0 if rise else 1.0)]
        keys += [(start + rise, 1.0)] if rise else []
        keys += [(end - fall, 1.0)] if fall else []
        keys += [(end, 0.0 if fall else 1.0)]
        compat.set_keys(curve_of(strip), keys, "BEZIER")
        strip.blend_in = strip.blend_out = 0.0
    _remember(effect)
    return curve_of(strip)


def curve_of(strip: bpy.types.NlaStrip) -> bpy.types.FCurve:
    """F-curve of a clip with drawn fades."""
    return strip.fcurves.find("influence")


def copy(source: bpy.types.NlaStrip, effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> None:
    """Give a clip of an effect the drawn fades of another, if it has any."""
    if not source.use_animated_influence:
        return
    strip.use_animated_influence = True
    old, new = curve_of(source), curve_of(strip)
    compat.set_keys(new, [(point.co[0], point.co[1]) for point in old.keyframe_points])
    for there, here in zip(old.keyframe_points, new.keyframe_points, strict=True):
        for name in ("interpolation", "easing", *_HANDLE_TYPES, "handle_left", "handle_right"):
            setattr(here, name, getattr(there, name))
    span = source.frame_start, source.frame_end
    _fit(new, span, (strip.frame_start, strip.frame_end))
    _remember(effect)


def set_keys(
    effect: bpy.types.Object, strip: bpy.types.NlaStrip, keys: Sequence[tuple[float, float]]
) -> None:
    """Set a clip's fades from (frame, strength) keys, linear between them."""
    strip.use_animated_influence = True
    compat.set_keys(curve_of(strip), keys)
    _remember(effect)


def sampled(strip: bpy.types.NlaStrip) -> list[tuple[float, float]]:
    """The drawn fades of a clip as (frame, strength in 0..1) at each frame; none: empty."""
    if not strip.use_animated_influence:
        return []
    start, end = strip.frame_start, strip.frame_end
    frames = [start, *map(float, range(floor(start) + 1, ceil(end))), end]
    curve = curve_of(strip)
    return [(frame, min(max(curve.evaluate(frame), 0.0), 1.0)) for frame in frames]


def is_remembered(effect: bpy.types.Object) -> bool:
    """Test an effect for clips whose drawn fades have to follow them."""
    return _SPANS in effect


def follow(effect: bpy.types.Object) -> bool:
    """Move the drawn fades of an effect along with clips that were changed; returns True if any
    was.
    """
    if not is_remembered(effect) or effect.library is not None:
        return False
    known = effect[_SPANS].to_dict()
    changed = False
    for strip in _drawn(effect):
        span = strip.frame_start, strip.frame_end
        old = known.get(strip.name)
        if old is None or tuple(old) == span or _is_cut(effect, strip):
            continue
        _fit(curve_of(strip), old, span)
        changed = True
    _remember(effect)
    return changed


def _drawn(effect: bpy.types.Object) -> list[bpy.types.NlaStrip]:
    data = effect.animation_data
    is_override = effect.override_library is not None
    return [
        strip
        for track in (data.nla_tracks if data is not None else ())
        if not (is_override and track.is_override_data)
        for strip in track.strips
        if strip.use_animated_influence
    ]


def _remember(effect: bpy.types.Object) -> None:
    spans = {strip.name: [strip.frame_start, strip.frame_end] for strip in _drawn(effect)}
    if is_remembered(effect) and effect[_SPANS].to_dict() == spans:
        return
    if spans:
        effect[_SPANS] = spans
    elif is_remembered(effect):
        del effect[_SPANS]


def _is_cut(effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> bool:
    """Test a clip for having been cut in two: each part then keeps its part of the curve,
    in place.
    """
    return any(
        other != strip
        and other.action == strip.action
        and (other.frame_start == strip.frame_end or other.frame_end == strip.frame_start)
        for other in _drawn(effect)
    )


def _fit(curve: bpy.types.FCurve, old: Sequence[float], new: Sequence[float]) -> None:
    if old[1] <= old[0]:
        return
    scale = (new[1] - new[0]) / (old[1] - old[0])
    for point in curve.keyframe_points:
        for name in _HANDLES:
            frame, value = getattr(point, name)
            setattr(point, name, (new[0] + (frame - old[0]) * scale, value))
    curve.update()
