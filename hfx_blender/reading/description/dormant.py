# SPDX-License-Identifier: GPL-3.0-or-later
"""Dormant effects: effects without any possible sample are not read.

Dormant effects keep their index in the scene description and in the track, and are reported.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np

from ...authoring.effects import effects
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.response.motion_estimate import OVERLAP
from ...engine.scene import TimeBase
from ...text import named
from ..curves.animation_time import animation_frames
from ..stepped import stepping
from . import activation
from .scene_description import sample_frames
from .visibility import is_keyed

MUTED = "is muted"
NOT_SOLO = "is silent because others are solo"
CLIPS_OFF = (
    "has clips, all of them muted",
    "has clips, none of them on the NLA track that is solo",
    "has clips, but its NLA is turned off",
)
OFF = "is not on at any exported time"

_INTENSITY = "hfx.intensity"


def frames_read(scene: bpy.types.Scene, time: TimeBase) -> F64:
    """Animation frames (T,) of all samples and of :data:`OVERLAP` more on both sides, read for
    motion."""
    indices = np.arange(-OVERLAP, time.sample_count + OVERLAP)
    return animation_frames(scene, sample_frames(time, indices))


def asleep(
    scene: bpy.types.Scene,
    time: TimeBase,
    states: Iterable[tuple[bpy.types.Object, activation.Activation]],
) -> dict[bpy.types.Object, str]:
    """Dormant effects of (effect, activation) pairs with reasons as in :func:`why_dormant`, in
    order; :data:`NOT_SOLO` is followed by the names of solo effects."""
    frames = frames_read(scene, time)
    states = tuple(states)
    candidates = dict.fromkeys((*effects.effects_of(scene), *(effect for effect, _ in states)))
    solo_names = named([f"'{effect.name}'" for effect in candidates if effect.hfx.is_solo], 3)
    reasons = ((effect, why_dormant(effect, state, frames)) for effect, state in states)
    return {
        effect: f"{why}: {solo_names}" if why == NOT_SOLO else why
        for effect, why in reasons
        if why is not None
    }


def why_dormant(effect: bpy.types.Object, state: activation.Activation, frames: F64) -> str | None:
    """Predicate why an effect cannot be felt at animation ``frames`` (n,), for use after the name;
    None otherwise. Checked in order: muted, not solo, clips off, off at all frames, intensity
    0."""
    if state is activation.SILENCED:
        return MUTED if effect.hfx.is_muted else NOT_SOLO
    if state.source is activation.ActivationSource.OFF:
        return _why_clips_are_off(effect)
    if not state.may_be_on(frames).any():
        return OFF
    if _is_powerless(effect, frames):
        return "has intensity 0"
    return None


def _why_clips_are_off(effect: bpy.types.Object) -> str:
    """Text of :data:`CLIPS_OFF` why all clips of an effect are off: NLA off, another track solo,
    else muted."""
    data = effect.animation_data
    muted, not_solo, off = CLIPS_OFF
    if not data.use_nla:
        return off
    return not_solo if any(track.is_solo for track in data.nla_tracks) else muted


def _is_powerless(effect: bpy.types.Object, frames: F64) -> bool:
    """Test for an intensity that is certainly 0 at all animation ``frames`` (n,). False with a
    frame handler of another add-on, and for an animation that cannot be bounded."""
    if stepping.foreign_handler() is not None:
        return False  # a handler may set any value
    spans = activation.spans_of_value(effect, _INTENSITY)
    if spans is not None:
        return not any(((frames >= a) & (frames <= b)).any() for a, b in spans)
    return not is_keyed(effect, _INTENSITY) and limited(effect.hfx, "intensity") <= 0.0
