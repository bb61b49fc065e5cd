# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawn fades: influence curves that follow their clips.

Blender does not move the F-curve of a strip's influence when the strip is moved, trimmed or scaled.
So each effect stores the span for which a curve was drawn.
"""

from collections.abc import Sequence
from math import ceil, floor

import bpy

from ..blender import compat

_SPANS = "hfx_drawn_fades"
"""ID property of an effect: first and last frame of its clips with drawn fades, by name."""

_HANDLES = ("handle_left", "co", "handle_right")
_HANDLE_TYPES = ("handle_left_type", "handle_right_type")


def draw(effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> bpy.types.FCurve:
    """Turn a clip's linear fades into a Bezier curve of its influence and set the fades to 0;
    return the curve. An existing curve stays as drawn."""
    if not strip.use_animated_influence:
        start, end = strip.frame_start, strip.frame_end
        rise, fall = strip.blend_in, strip.blend_out
        strip.use_animated_influence = True
        # The curve starts with the shape of the fades that it replaces.
        keys = [(start, 0.0 if rise else 1.0)]
        keys += [(start + rise, 1.0)] if rise else []
        keys += [(end - fall, 1.0)] if fall else []
        keys += [(end, 0.0 if fall else 1.0)]
        compat.set_keys(curve_of(strip), keys, "BEZIER")
        strip.blend_in = strip.blend_out = 0.0
    _store_spans(effect)
    return curve_of(strip)


def curve_of(strip: bpy.types.NlaStrip) -> bpy.types.FCurve:
    """F-curve of a clip's influence; None without drawn fades."""
    return strip.fcurves.find("influence")


def copy(source: bpy.types.NlaStrip, effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> None:
    """Copy the drawn fades of clip ``source`` to clip ``strip`` of ``effect``: keyframes and
    handles, stretched to the span of ``strip``. Without drawn fades ``strip`` is unchanged."""
    if not source.use_animated_influence:
        return
    strip.use_animated_influence = True
    old, new = curve_of(source), curve_of(strip)
    # Keyframes first: handles are set on existing keyframes.
    compat.set_keys(new, [(point.co[0], point.co[1]) for point in old.keyframe_points])
    for source_key, key in zip(old.keyframe_points, new.keyframe_points, strict=True):
        for name in ("interpolation", "easing", *_HANDLE_TYPES, "handle_left", "handle_right"):
            setattr(key, name, getattr(source_key, name))
    span = source.frame_start, source.frame_end
    _fit(new, span, (strip.frame_start, strip.frame_end))
    _store_spans(effect)


def set_keys(
    effect: bpy.types.Object, strip: bpy.types.NlaStrip, keys: Sequence[tuple[float, float]]
) -> None:
    """Replace a clip's drawn fades by ``keys`` (scene frame, strength), linearly interpolated."""
    strip.use_animated_influence = True
    compat.set_keys(curve_of(strip), keys)
    _store_spans(effect)


def sampled(strip: bpy.types.NlaStrip) -> list[tuple[float, float]]:
    """Drawn fades as (frame, strength 0 to 1) at the strip's start, whole frames and end, in frames
    of the NLA; empty without any."""
    if not strip.use_animated_influence:
        return []
    start, end = strip.frame_start, strip.frame_end
    frames = [start, *map(float, range(floor(start) + 1, ceil(end))), end]
    curve = curve_of(strip)
    return [(frame, min(max(curve.evaluate(frame), 0.0), 1.0)) for frame in frames]


def has_drawn_fades(effect: bpy.types.Object) -> bool:
    """Test for the ID property with the spans of clips with drawn fades; True also if these clips
    were removed."""
    return _SPANS in effect


def follow_clips(effect: bpy.types.Object) -> bool:
    """Stretch the drawn fades of an effect to changed spans of its clips, but not after a split or
    of a linked effect; True if any moved."""
    if not has_drawn_fades(effect) or effect.library is not None:
        return False
    stored_spans = effect[_SPANS].to_dict()
    is_changed = False
    drawn_strips = _drawn_strips(effect)
    for strip in drawn_strips:
        span = strip.frame_start, strip.frame_end
        old = stored_spans.get(strip.name)
        # A new or renamed clip has no stored span.
        if old is None or tuple(old) == span:
            continue
        # A split leaves two clips of one action with a common end. Both halves keep the curve, so
        # that the fades of the whole clip go on over the cut.
        if any(
            half != strip
            and half.action == strip.action
            and (half.frame_start == strip.frame_end or half.frame_end == strip.frame_start)
            for half in drawn_strips
        ):
            continue
        _fit(curve_of(strip), old, span)
        is_changed = True
    _store_spans(effect)
    return is_changed


def _drawn_strips(effect: bpy.types.Object) -> list[bpy.types.NlaStrip]:
    """Strips of an effect with an animated influence, without strips of a linked file."""
    data = effect.animation_data
    # Strips of a linked file are read-only in an override.
    is_override = effect.override_library is not None
    return [
        strip
        for track in (data.nla_tracks if data is not None else ())
        if not (is_override and track.is_override_data)
        for strip in track.strips
        if strip.use_animated_influence
    ]


def _store_spans(effect: bpy.types.Object) -> None:
    """Store the spans of the clips with drawn fades, by name, if changed; without any such clip the
    ID property is removed."""
    spans = {strip.name: [strip.frame_start, strip.frame_end] for strip in _drawn_strips(effect)}
    if has_drawn_fades(effect) and effect[_SPANS].to_dict() == spans:
        return
    if spans:
        effect[_SPANS] = spans
    elif has_drawn_fades(effect):
        del effect[_SPANS]


def _fit(curve: bpy.types.FCurve, old: Sequence[float], new: Sequence[float]) -> None:
    """Map the keys and handles of a curve linearly from span ``old`` (first, last frame) to
    ``new``; nothing for an ``old`` span without length."""
    if old[1] <= old[0]:
        return
    # Blender moves the strip, not the curve: frames are mapped linearly from old to new span.
    scale = (new[1] - new[0]) / (old[1] - old[0])
    for point in curve.keyframe_points:
        for name in _HANDLES:
            frame, value = getattr(point, name)
            setattr(point, name, (new[0] + (frame - old[0]) * scale, value))
    curve.update()
