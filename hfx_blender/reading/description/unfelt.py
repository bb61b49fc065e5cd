# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons, known before reading, why effects, clips and bodies are not felt.

Intended silence (a muted effect, a part of the frames) is a note, all other silence a warning.
Dormant effects, certainly without any sample, are not read; each keeps its index in the scene
description and in the track, and is reported.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import ceil, floor
from typing import Final

import bpy
import numpy as np

from ...authoring import clips, responses
from ...authoring.effects import effects
from ...blender.scene_info import scene_objects
from ...blender.stored_values import limited
from ...engine.areas.felt_times import NEUTRAL_WITHIN_C
from ...engine.arrays import F64
from ...engine.counters import Unfelt, powerless_reason
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.response.motion_estimate import OVERLAP
from ...engine.scene import Clip, TimeBase
from ...text import named
from ..curves.animation_time import animation_frames, sample_frames
from ..stepped import stepping
from ..stepped.reached import reached_from
from . import visibility
from .activation import SILENCED, Activation, ActivationSource, spans_of_value
from .equal_settings import EqualSettings

MUTED = "is muted"
GROUP_MUTED = "is in a muted group"
NOT_SOLO = "is silent because others are solo"
CLIPS_OFF = (
    "has clips, all of them muted",
    "has clips, none of them on the NLA track that is solo",
    "has clips, but its NLA is turned off",
)
OFF = "is not on at any exported time"
_ROUNDING: Final = 1e-4  # frames: strips are single precision
_ELSEWHERE: Final = "can be felt only outside of the exported frames"


@dataclass(frozen=True)
class LostClip:
    """Clip without samples, or with samples for a part of the frames only."""

    effect: str
    clip: Clip
    why: str  # key of _LOST

    @property
    def is_whole(self) -> bool:
        """True if the whole clip is outside the frames or between samples, hence not felt."""
        return _LOST[self.why][0] == "lie"

    @property
    def title(self) -> str:
        """Clip and effect name, for messages."""
        return f"'{self.clip.name}' of '{self.effect}'"


_LOST: Final = {
    "after": ("lie", "after the last frame of the scene ({end:.2f} s)"),
    "before": ("lie", "before the first frame of the scene"),
    "beyond": ("go", "on after the last frame of the scene ({end:.2f} s), where nothing is felt"),
    "early": ("go", "on before the first frame of the scene, where nothing is felt"),
    "between": ("lie", "between two samples"),
}
"""Verb and place of clips in warnings by reason; clips that "lie" there are not felt at all."""


def reasons(
    scene: bpy.types.Scene,
    time: TimeBase,
    states: Mapping[bpy.types.Object, Activation],
    asleep: Mapping[bpy.types.Object, str],
    equal: EqualSettings,
) -> tuple[dict[bpy.types.Object, Unfelt], tuple[str, ...]]:
    """Reason for each effect that is certainly not felt, and warnings about clips without samples.
    A lost clip counts before the reason in ``asleep`` (dormant effects), then missing strength. If
    frames of the scene are not exported, an effect that may be felt at the scene's frames is
    expected to be silent."""
    frames = frames_read(scene, time)
    whole = replace(time, frame_first=scene.frame_start, frame_last=scene.frame_end)
    unfelt_effects: dict[bpy.types.Object, Unfelt] = {}
    lost: list[LostClip] = []
    powerless = equal.shared(lambda effect: why_powerless(effect, frames))
    for effect, state in states.items():
        own_lost = [*lost_clips(scene, time, effect, state)]
        lost += own_lost
        why = asleep.get(effect) or powerless(effect)
        is_clipless = len(own_lost) >= len(state.playing) and all(c.is_whole for c in own_lost)
        if own_lost and is_clipless:
            # The warning about the clips says so already.
            are_between = all(clip.why == "between" for clip in own_lost)
            clipless = "that reaches a sample" if are_between else "within the frames of the scene"
            unfelt_effects[effect] = Unfelt(f"has no clip {clipless}", is_warned=True)
        elif why is not None and state.source is ActivationSource.OFF:  # muted, not solo, clips off
            unfelt_effects[effect] = Unfelt(why, is_expected=True)
        elif why is not None:
            is_part = is_partial(scene, time) and _may_be_felt_in_scene(scene, effect, state)
            reason = _ELSEWHERE if is_part and why != OFF else why
            unfelt_effects[effect] = Unfelt(reason, is_part)
    return unfelt_effects, warnings_of_clips(lost, whole)


def is_partial(scene: bpy.types.Scene, time: TimeBase) -> bool:
    """True if any frame of the scene is outside the frames of ``time``."""
    return time.frame_first > scene.frame_start or time.frame_last < scene.frame_end


def _may_be_felt_in_scene(
    scene: bpy.types.Scene, effect: bpy.types.Object, state: Activation
) -> bool:
    """Test for an effect that is not certainly without strength at all frames of the scene. Tests
    only the ends of the scene and of the spans of possible strength, within the scene."""
    # The last frame lasts a whole frame. Conditions change at ends of spans only, so testing these
    # and the ends of the scene suffices.
    last = scene.frame_end + 0.999
    ends = animation_frames(scene, np.array([scene.frame_start, last]))
    spans = [*state.spans]
    spans += spans_of_value(effect, "hfx.intensity") or ()
    strength = f"hfx.{_strength_of(effect)}"
    spans += spans_of_value(effect, strength, _neutral_c(effect)) or ()
    frames = np.clip([*ends, *chain(*spans)], *ends)
    return (why_dormant(effect, state, frames) or why_powerless(effect, frames)) is None


def lost_clips(
    scene: bpy.types.Scene, time: TimeBase, effect: bpy.types.Object, state: Activation
) -> Iterator[LostClip]:
    """Yield evaluated clips with bounds that are wholly or partly outside the scene's frames, or
    between two samples. If other frames than the scene's are read, clips with samples there or in
    the scene are not reported."""
    for clip in state.playing:
        whole = replace(time, frame_first=scene.frame_start, frame_last=scene.frame_end)
        start, end = clips.played_span(scene, clip.frame_start, clip.frame_end)
        why = _why_lost(time, start, end)
        if time != whole:
            if why in ("before", "after"):
                why = _why_lost(whole, start, end)
            why = None if why in ("beyond", "early") else why
        if why is not None:
            yield LostClip(effect.name, Clip(clip.name, start, end), why)


def _why_lost(time: TimeBase, start: float, end: float) -> str | None:
    """Key of :data:`_LOST` for a clip from played frame ``start`` to ``end``; None if the whole
    clip has samples. "between" counts before "beyond" and "early"."""
    # A clip shorter than the step of samples may lie between two of them. Its first sample at or
    # after the start would then be after its end.
    first, stop = time.frame_first, time.frame_last + 1
    step = float(time.fps / time.rate_hz)
    why = clips.outside(start, end, first, stop, step)
    sample = ceil((start - first - _ROUNDING) / step)
    if why not in ("before", "after") and sample > floor((end - first + _ROUNDING) / step):
        return "between"
    return why


def warnings_of_clips(lost: Sequence[LostClip], time: TimeBase) -> tuple[str, ...]:
    """One warning for each reason of :data:`_LOST`, in this order: a single clip with its times in
    seconds, several with number and names."""
    end = float((time.frame_last + 1 - time.scene_start) / time.fps)
    warnings = []
    for why, (verb, span) in _LOST.items():
        same = [clip for clip in lost if clip.why == why]
        span = span.format(end=end)
        if len(same) == 1:
            clip = same[0].clip
            start, stop = (
                (at - time.scene_start) / float(time.fps)
                for at in (clip.frame_start, clip.frame_end)
            )
            whole = " and is not felt" if verb == "lie" else ""
            verb = {"lie": "lies", "go": "goes"}[verb]
            # The fewest decimals that change neither time by more than 1 % of the length, so that
            # short clips show where they are between samples.
            most = 0.01 * (stop - start)
            ends = start, stop
            rounds = (n for n in (2, 3) if all(abs(round(at, n) - at) <= most for at in ends))
            n = next(rounds, 4)
            title = f"clip {same[0].title} ({start:.{n}f} to {stop:.{n}f} s)"
            warnings.append(f"{title} {verb} {span}{whole}")
        elif same:
            whole = " and are not felt" if verb == "lie" else ""
            names = named([clip.title for clip in same])
            warnings.append(f"{len(same)} clips {verb} {span}{whole}: {names}")
    return tuple(warnings)


def is_never_strong(
    effect: bpy.types.Object, name: str, frames: F64, neutral: float | None = None
) -> bool:
    """Test for a property ``hfx.name`` that is certainly at most 0 at all animation ``frames``
    (n,); with ``neutral``, certainly nearer to it than :data:`NEUTRAL_WITHIN_C`. False with a frame
    handler of another add-on, and for an animation that cannot be bounded."""
    if stepping.foreign_handler() is not None:
        return False  # a handler may set any value
    path = f"hfx.{name}"
    spans = spans_of_value(effect, path, neutral)
    if spans is not None:
        return not any(((frames >= a) & (frames <= b)).any() for a, b in spans)
    # The value of now counts for all frames only without animation.
    value = limited(effect.hfx, name)
    is_weak = value <= 0.0 if neutral is None else abs(value - neutral) < NEUTRAL_WITHIN_C
    return is_weak and not visibility.is_keyed(effect, path)


def frames_read(scene: bpy.types.Scene, time: TimeBase) -> F64:
    """Animation frames (T,) of all samples and of :data:`OVERLAP` more on both sides, read for
    motion."""
    indices = np.arange(-OVERLAP, time.sample_count + OVERLAP)
    return animation_frames(scene, sample_frames(time, indices))


def asleep(
    scene: bpy.types.Scene,
    time: TimeBase,
    states: Mapping[bpy.types.Object, Activation],
    equal: EqualSettings,
) -> dict[bpy.types.Object, str]:
    """Find the dormant effects of a scene: the reason of :func:`why_dormant` for each, in the order
    of ``states``, which holds the activation of each effect to test. :data:`NOT_SOLO` is followed
    by the names of solo effects. Effects of a group in ``equal`` are tested once."""
    frames = frames_read(scene, time)
    dormant = equal.shared(lambda effect: why_dormant(effect, states[effect], frames))
    silent = {effect: why for effect in states if (why := dormant(effect)) is not None}
    if NOT_SOLO in silent.values():
        candidates = dict.fromkeys((*effects.effects_of(scene), *states))
        solo = named([f"'{effect.name}'" for effect in candidates if effect.hfx.is_solo], 3)
        silent = {e: f"{why}: {solo}" if why == NOT_SOLO else why for e, why in silent.items()}
    return silent


def why_dormant(effect: bpy.types.Object, state: Activation, frames: F64) -> str | None:
    """Predicate why an effect cannot be felt at animation ``frames`` (n,), for use after the name;
    None otherwise. Checked in order: muted, not solo, clips off, off at all frames, intensity 0,
    gain of the group 0."""
    if state is SILENCED:
        own = MUTED if effect.hfx.is_muted else NOT_SOLO
        return GROUP_MUTED if effect.hfx.is_group_muted else own
    if state.source is ActivationSource.OFF:
        data = effect.animation_data
        muted, not_solo, off = CLIPS_OFF
        if not data.use_nla:
            return off
        return not_solo if any(track.is_solo for track in data.nla_tracks) else muted
    if not state.may_be_on(frames).any():
        return OFF
    if is_never_strong(effect, "intensity", frames):
        return "has intensity 0"
    return "is in a group of gain 0" if is_never_strong(effect, "group_gain", frames) else None


def why_powerless(effect: bpy.types.Object, frames: F64) -> str | None:
    """Predicate why an effect that is on has certainly no strength at animation ``frames``; None
    otherwise. None also for kinds besides painted, volume and spot, with response filters, with a
    frame handler of another add-on, and for animation that cannot be bounded."""
    hfx = effect.hfx
    if hfx.kind not in ("PAINTED", "VOLUME", "SPOT") or responses.active_filters(hfx):
        return None
    is_nothing = is_never_strong(effect, _strength_of(effect), frames, _neutral_c(effect))
    is_contact = hfx.temperature_reference == "CONTACT"
    return powerless_reason(hfx.modality, is_contact) if is_nothing else None


def _strength_of(effect: bpy.types.Object) -> str:
    """Name of the property with the strength of an effect, by its modality."""
    return MODALITIES[effect.hfx.modality].strength_parameter.prop


def _neutral_c(effect: bpy.types.Object) -> float | None:
    """Neutral temperature of an effect, degrees Celsius; None for other modalities."""
    if effect.hfx.modality != "temperature":
        return None
    return neutral_temperature_c(effect.hfx.temperature_reference == "CONTACT")


def instanced(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer, instancers: Sequence[bpy.types.Object]
) -> tuple[str, ...]:
    """Warnings about bodies, surfaces and further effects that ``instancers`` show, without samples
    there, by name. Instances of haptic volumes are felt and give no warning, see
    :mod:`.instances`."""
    # The loop over instances is slow in large scenes, so the cheap tests come first.
    if not instancers:
        return ()
    # Bodies, and effects other than volumes, cannot be read where an instance shows them.
    candidates = {
        obj
        for obj in reached_from(instancers)
        if obj.hfx.role == "BODY" or (obj.hfx.role == "EFFECT" and obj.hfx.kind != "VOLUME")
    }
    if not candidates:
        return ()
    own = set(scene_objects(scene))
    makers: dict[bpy.types.Object, str] = {}
    for instance in layer.depsgraph.object_instances:
        if instance.is_instance and instance.object.original in candidates:
            parent = instance.parent
            maker = "" if parent is None else parent.original.name
            makers.setdefault(instance.object.original, maker)
    warnings = []
    for obj, maker in sorted(makers.items(), key=lambda pair: pair[0].name_full):
        shown = f"is shown {'also' if obj in own else 'only'} as an instance, by '{maker}'"
        if obj.hfx.role == "BODY":
            warnings.append(
                f"body '{obj.name}' {shown}: it is not posed there and feels nothing; make a "
                "library override of it, or make the instance real"
            )
        # The scene's own painted and skin effects are felt on their body, wherever shown.
        elif obj.hfx.kind == "SURFACE" or obj not in own:
            text = f"effect '{obj.name}' {shown}: it is not felt there; make the instance real"
            warnings.append(text)
    return tuple(warnings)
