# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons, known before reading, why effects, clips and bodies are not felt.

Intended silence (a muted effect, a part of the frames) is a note, all other silence a warning.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import ceil, floor
from typing import Final

import bpy
import numpy as np

from ...authoring import clips, responses
from ...blender.scene_info import scene_objects
from ...blender.stored_values import limited
from ...engine.areas.felt_times import NEUTRAL_WITHIN_C
from ...engine.arrays import F64
from ...engine.counters import Unfelt, powerless_reason
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.scene import Clip, TimeBase
from ...text import named
from ..curves.animation_time import animation_frames
from ..stepped import stepping
from ..stepped.reached import is_instancer, reached_from
from . import dormant, visibility
from .activation import Activation, ActivationSource, spans_of_value

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
        """True if the whole clip is outside the frames or between samples, hence not felt at
        all."""
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
) -> tuple[dict[str, Unfelt], tuple[str, ...]]:
    """Reasons by effect name why effects are not felt, and warnings about clips without samples;
    felt effects are missing. A lost clip counts before the reason in ``asleep`` (dormant effects),
    then missing strength. If frames of the scene are not exported, an effect that may be felt at
    the scene's frames is expected to be silent."""
    frames, whole = dormant.frames_read(scene, time), _of_scene(scene, time)
    unfelt_effects: dict[str, Unfelt] = {}
    lost: list[LostClip] = []
    for effect, state in states.items():
        own_lost = [*lost_clips(scene, time, effect, state)]
        lost += own_lost
        clipless = of_lost_clips(own_lost, state)
        why = asleep.get(effect) or why_powerless(effect, frames)
        if clipless is not None:
            unfelt_effects[effect.name] = clipless
        elif why is not None and state.source is ActivationSource.OFF:  # muted, not solo, clips off
            unfelt_effects[effect.name] = Unfelt(why, is_expected=True)
        elif why is not None:
            is_part = is_partial(scene, time) and _may_be_felt_in_scene(scene, effect, state)
            reason = _ELSEWHERE if is_part and why != dormant.OFF else why
            unfelt_effects[effect.name] = Unfelt(reason, is_part)
    return unfelt_effects, warnings_of_clips(lost, whole)


def _of_scene(scene: bpy.types.Scene, time: TimeBase) -> TimeBase:
    """Time base of all frames of the scene, at the rates of ``time``."""
    return replace(time, frame_first=scene.frame_start, frame_last=scene.frame_end)


def is_partial(scene: bpy.types.Scene, time: TimeBase) -> bool:
    """True if any frame of the scene is outside the frames of ``time``."""
    return time.frame_first > scene.frame_start or time.frame_last < scene.frame_end


def _may_be_felt_in_scene(
    scene: bpy.types.Scene, effect: bpy.types.Object, state: Activation
) -> bool:
    """Test for an effect that is not certainly without strength at all frames of the scene.

    Tests only the ends of the scene and of the spans of possible strength, within the scene.
    """
    last = scene.frame_end + 0.999  # the last frame lasts a whole frame
    ends = animation_frames(scene, np.array([scene.frame_start, last]))
    spans = [*state.spans]
    spans += spans_of_value(effect, "hfx.intensity") or ()
    spans += _strength_spans(effect) or ()
    frames = np.clip([*ends, *chain(*spans)], *ends)
    return (dormant.why_dormant(effect, state, frames) or why_powerless(effect, frames)) is None


def lost_clips(
    scene: bpy.types.Scene, time: TimeBase, effect: bpy.types.Object, state: Activation
) -> Iterator[LostClip]:
    """Yield evaluated clips with bounds that are wholly or partly outside the scene's frames, or
    between two samples. If other frames than the scene's are read, clips with samples there or in
    the scene are not reported."""
    whole = _of_scene(scene, time)
    for clip in state.playing:
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
            title = f"clip {same[0].title} ({_times_text(start, stop)} s)"
            warnings.append(f"{title} {verb} {span}{whole}")
        elif same:
            whole = " and are not felt" if verb == "lie" else ""
            names = named([clip.title for clip in same])
            warnings.append(f"{len(same)} clips {verb} {span}{whole}: {names}")
    return tuple(warnings)


def _times_text(start: float, stop: float) -> str:
    """Times of a clip in seconds with the fewest decimals, 2 to 4, that change neither by more than
    1 % of its length, so that short clips show where they are between samples."""
    most = 0.01 * (stop - start)
    decimals = next(
        (n for n in (2, 3) if all(abs(round(at, n) - at) <= most for at in (start, stop))), 4
    )
    return f"{start:.{decimals}f} to {stop:.{decimals}f}"


def of_lost_clips(lost: Sequence[LostClip], state: Activation) -> Unfelt | None:
    """Reason for an effect whose clips are all lost as a whole, marked as warned by the clips'
    warning; None if a clip may be felt. ``lost`` are the effect's own."""
    if not lost or len(lost) < len(state.playing) or not all(clip.is_whole for clip in lost):
        return None
    if all(clip.why == "between" for clip in lost):
        return Unfelt("has no clip that reaches a sample", is_warned=True)
    return Unfelt("has no clip within the frames of the scene", is_warned=True)


def why_powerless(effect: bpy.types.Object, frames: F64) -> str | None:
    """Predicate why an effect that is on has certainly no strength at animation ``frames``; None
    otherwise. None also for kinds besides painted, volume and spot, with response filters, with a
    frame handler of another add-on, and for animation that cannot be bounded."""
    hfx = effect.hfx
    if hfx.kind not in ("PAINTED", "VOLUME", "SPOT") or responses.active_filters(hfx):
        return None
    if stepping.foreign_handler() is not None:
        return None  # it may set anything
    neutral = _neutral_c(effect)
    name = MODALITIES[hfx.modality].strength_parameter.prop
    spans = _strength_spans(effect)
    if spans is not None:
        is_nothing = not any(((frames >= a) & (frames <= b)).any() for a, b in spans)
    elif visibility.is_keyed(effect, f"hfx.{name}"):
        is_nothing = False
    elif neutral is not None:
        is_nothing = abs(limited(hfx, name) - neutral) < NEUTRAL_WITHIN_C
    else:
        is_nothing = limited(hfx, name) <= 0.0
    is_contact = hfx.temperature_reference == "CONTACT"
    return powerless_reason(hfx.modality, is_contact) if is_nothing else None


def _neutral_c(effect: bpy.types.Object) -> float | None:
    """Neutral temperature of an effect, degrees Celsius; None for other modalities."""
    if effect.hfx.modality != "temperature":
        return None
    return neutral_temperature_c(effect.hfx.temperature_reference == "CONTACT")


def _strength_spans(effect: bpy.types.Object) -> tuple[tuple[float, float], ...] | None:
    """Animation frame intervals in which the strength parameter of an effect may have strength, or
    a temperature may not be neutral; None if no F-curve alone tells."""
    name = MODALITIES[effect.hfx.modality].strength_parameter.prop
    return spans_of_value(effect, f"hfx.{name}", _neutral_c(effect))


def instanced(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> tuple[str, ...]:
    """Warnings about instanced bodies, surfaces and further effects without samples there, by name.

    Instances of haptic volumes are felt and give no warning, see :mod:`.instances`.
    """
    instancers = [obj for obj in scene_objects(scene) if is_instancer(obj)]
    if not instancers:
        return ()
    candidates = {obj for obj in reached_from(instancers) if _is_lost_as_instance(obj)}
    if not candidates:
        return ()
    own = set(scene_objects(scene))
    makers: dict[bpy.types.Object, str] = {}
    for instance in layer.depsgraph.object_instances:
        if instance.is_instance and instance.object.original in candidates:
            parent = instance.parent
            maker = "" if parent is None else parent.original.name
            makers.setdefault(instance.object.original, maker)
    return tuple(
        text
        for obj, maker in sorted(makers.items(), key=lambda pair: pair[0].name_full)
        for text in _of_instance(obj, maker, obj in own)
    )


def _is_lost_as_instance(obj: bpy.types.Object) -> bool:
    """Test for a body or for an effect other than a volume."""
    role = obj.hfx.role
    return bool(role == "BODY" or (role == "EFFECT" and obj.hfx.kind != "VOLUME"))


def _of_instance(obj: bpy.types.Object, maker: str, is_own: bool) -> Iterable[str]:
    """Yield the warning that an instance of ``obj`` is not felt: for bodies, surfaces, and for
    effects not in the scene itself; nothing for the scene's own painted and skin effects. ``maker``
    is the name of the instancing object ("" if unknown); ``is_own``: ``obj`` is also in the
    scene."""
    shown = f"is shown {'also' if is_own else 'only'} as an instance, by '{maker}'"
    if obj.hfx.role == "BODY":
        yield (
            f"body '{obj.name}' {shown}: it is not posed there and feels nothing; make a library "
            "override of it, or make the instance real"
        )
    elif obj.hfx.kind == "SURFACE" or not is_own:
        yield f"effect '{obj.name}' {shown}: it is not felt there; make the instance real"
