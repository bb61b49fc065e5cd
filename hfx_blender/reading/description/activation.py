# SPDX-License-Identifier: GPL-3.0-or-later
"""Activation of effects over time, from the animation data of the property ``activation``.

The stored value alone is not enough: with all strips muted, or with the NLA off, nothing writes the
property, which keeps the last value. So animation data is checked first.
"""

from dataclasses import dataclass
from enum import Enum, auto
from itertools import pairwise
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from ...authoring import clips
from ...blender import compat
from ...blender.stored_values import limited
from ...engine.areas.felt_times import NEUTRAL_WITHIN_C
from ...engine.arrays import F64
from ...engine.kinematics.keyframe_curves import Interpolation
from ...engine.scene import Clip
from ..curves.animation_curves import plain_keys


class ActivationSource(Enum):
    """Source of an effect's activation."""

    ALWAYS_ON = auto()  # no animation
    OFF = auto()  # clips, all of them muted
    ANIMATED = auto()  # the evaluated value counts


@dataclass(frozen=True)
class Activation:
    """Activation of an effect before any frame is evaluated."""

    source: ActivationSource
    # Frames (first, last); certainly off outside.
    spans: tuple[tuple[float, float], ...] = ((-np.inf, np.inf),)
    clips: tuple[Clip, ...] = ()  # all clips of the effect
    playing: tuple[Clip, ...] = ()  # clips that are certainly off outside their ends

    def may_be_on(self, frames: F64) -> npt.NDArray[np.bool_]:
        """Mask (n,) of animation frames (n,) within any of the spans, ends included; False if off.
        A superset: the level may still be 0."""
        on = np.zeros(len(frames), np.bool_)
        if self.source is not ActivationSource.OFF:
            for start, end in self.spans:
                on |= (frames >= start) & (frames <= end)
        return on

    def level(self, hfx: bpy.types.PropertyGroup | Any) -> float:
        """Level 0..1 from evaluated settings: 0 if off, intensity times gain of the group if always
        on, else activation times both, all clamped; NaN stays NaN."""
        if self.source is ActivationSource.OFF:
            return 0.0
        on = 1.0 if self.source is ActivationSource.ALWAYS_ON else limited(hfx, "activation")
        return on * limited(hfx, "intensity") * limited(hfx, "group_gain")


SILENCED = Activation(ActivationSource.OFF)
"""Activation of muted effects and of effects silenced by solo effects."""


def activation_of(effect: bpy.types.Object) -> Activation:
    """Activation of an effect from unmuted F-curves and drivers of ``activation``, else from NLA
    clips. Always on without any; off if there are only clips and none is evaluated (muted, not
    solo, NLA off, without an action). A single F-curve without NLA, and evaluated clips without
    extrapolation, bound the spans; otherwise all frames may be on."""
    data = effect.animation_data
    if data is None:
        return Activation(ActivationSource.ALWAYS_ON)
    pairs = clips.strips_of(effect)
    named = tuple(Clip(strip.name, strip.frame_start, strip.frame_end) for _, strip in pairs)
    curves = [
        curve
        for curve in compat.fcurves(effect)
        if curve.data_path == clips.DATA_PATH and not curve.mute
    ]
    driver = any(d.data_path == clips.DATA_PATH and not d.mute for d in data.drivers)
    # Only a single F-curve without NLA bounds the frames with values above 0.
    if len(curves) == 1 and not driver and not len(data.nla_tracks):
        return Activation(ActivationSource.ANIMATED, _spans_of(curves[0]), named)
    if curves or driver:
        return Activation(ActivationSource.ANIMATED, clips=named)
    if not pairs:
        is_lost = bool(clips.lost_strips(effect))
        return Activation(ActivationSource.OFF if is_lost else ActivationSource.ALWAYS_ON)
    # Strips that Blender evaluates. With a solo track the mute switches of tracks do not count.
    solo = any(track.is_solo for track in data.nla_tracks)
    playing = [
        strip
        for track, strip in pairs
        if data.use_nla and not strip.mute and (track.is_solo if solo else not track.mute)
    ]
    if not playing:
        return Activation(ActivationSource.OFF, clips=named)
    # A held value lasts beyond the strip, so the strip's ends are no bounds.
    if any(strip.extrapolation != "NOTHING" for strip in playing):
        return Activation(ActivationSource.ANIMATED, clips=named)
    spans = tuple((strip.frame_start, strip.frame_end) for strip in playing)
    timed = tuple(Clip(strip.name, *span) for strip, span in zip(playing, spans, strict=True))
    return Activation(ActivationSource.ANIMATED, spans, named, timed)


def spans_of_value(
    effect: bpy.types.Object, path: str, neutral: float | None = None
) -> tuple[tuple[float, float], ...] | None:
    """Animation frame intervals in which ``path`` may be above 0, or may deviate from ``neutral``
    (degrees Celsius) if given. None without a single valid, unmuted F-curve, and with any driver of
    the path or NLA track."""
    data = effect.animation_data
    # Strips may blend with the curve, so the curve alone is no bound.
    if data is None or len(data.nla_tracks):
        return None
    if any(driver.data_path == path for driver in data.drivers):
        return None
    curves = [curve for curve in compat.fcurves(effect) if curve.data_path == path]
    if len(curves) != 1 or curves[0].mute or not curves[0].is_valid:
        return None
    if curves[0].group is not None and curves[0].group.mute:
        return None
    return _spans_of(curves[0], neutral)


def _spans_of(
    curve: bpy.types.FCurve, neutral: float | None = None
) -> tuple[tuple[float, float], ...]:
    """Frame intervals, ascending, in which a curve may be above 0; at most 0 outside. With
    ``neutral``, in which the curve may be :data:`NEUTRAL_WITHIN_C` or more off it. All frames
    without keys, and with easing, extrapolation, F-modifiers or NaN."""

    def is_strong(*values: float) -> bool:
        if neutral is None:
            return max(values) > 0.0
        return max(abs(value - neutral) for value in values) >= NEUTRAL_WITHIN_C

    plain = plain_keys(curve)
    if plain is None:
        return ((-np.inf, np.inf),)
    keys, lefts, rights = plain[0].tolist()
    spans = [(-np.inf, keys[0][0])] if is_strong(keys[0][1]) else []
    for k, (key, following) in enumerate(pairwise(keys)):
        # A Bezier curve stays within the hull of the keys and handles.
        is_curved = plain[1][k] == Interpolation.BEZIER
        handles = (rights[k][1], lefts[k + 1][1]) if is_curved else ()
        if is_strong(key[1], following[1], *handles):
            spans.append((key[0], following[0]))
    if is_strong(keys[-1][1]):
        spans.append((keys[-1][0], np.inf))
    return tuple(spans)
