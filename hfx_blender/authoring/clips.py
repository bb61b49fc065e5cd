# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips: NLA strips that animate an effect's ``activation`` over a span of the timeline."""

from collections.abc import Container, Iterable, Mapping, Sequence
from math import ceil, floor

import bpy

from ..blender import compat
from ..blender.scene_info import animation_fps, fps_of
from ..errors import InputError
from . import drawn_fades

DATA_PATH = "hfx.activation"

_ROUNDING = 1e-4  # frames, as strips have single precision

_TRACK = "Clips"
_REPEATS = (0.1, 1000.0)
"""Blender's limits of a strip's repetitions, which it applies without a message."""

Key = tuple[float, float]


def add_clip(
    effect: bpy.types.Object,
    frame_start: float,
    frame_end: float,
    *,
    name: str = "Clip",
    fade_in: float = 0.0,
    fade_out: float = 0.0,
    profile: Sequence[Key] = (),
    repeat: float = 1.0,
    curves: Mapping[str, Sequence[Key]] | None = None,
) -> bpy.types.NlaStrip:
    """Add a clip from ``frame_start`` to ``frame_end`` to the timeline of an effect.

    Fades have lengths in frames, and apply to the whole clip with its ``repeat`` repetitions.
    ``profile`` is the activation over a repetition, (frame, activation) from frame 0; empty: always
    1. ``curves`` are keyframes (frame, value) of further properties by data path, which move with
    the clip. Raises InputError: the clip has no length, is shorter than the fades, or has too many
    repetitions.
    """
    length = frame_end - frame_start
    if length <= 0:
        raise InputError(f"Effect '{effect.name}': a clip must end after it starts.")
    if fade_in < 0 or fade_out < 0 or fade_in + fade_out > length:
        raise InputError(f"Effect '{effect.name}': the fades are longer than the clip.")
    if not _REPEATS[0] <= repeat <= _REPEATS[1]:
        raise InputError(
            f"Effect '{effect.name}': {repeat:g} repetitions in one clip; Blender allows "
            f"{_REPEATS[0]:g} to {_REPEATS[1]:g}. Divide it into several clips."
        )
    data = effect.animation_data or effect.animation_data_create()
    active_action = data.action
    action = bpy.data.actions.new(f"{effect.name} {name}")
    data.action = action  # assigned first: new F-curves need the datablock's slot
    keys = profile or ((0.0, 1.0), (length / repeat, 1.0))
    for path, values in {**(curves or {}), DATA_PATH: keys}.items():
        compat.set_keys(compat.new_fcurve(effect, action, path), values)
    track = _free_track(effect, floor(frame_start), frame_end)
    # The function accepts whole frames only; the exact frames are set below.
    strip = track.strips.new(name, floor(frame_start), action)
    # The effect's own action is assigned again: the strip holds the new action.
    data.action = active_action
    strip.name = name  # Blender before 4.4 uses the action's name
    strip.action_frame_start, strip.action_frame_end = keys[0][0], keys[-1][0]
    strip.repeat = repeat
    strip.frame_start, strip.frame_end = frame_start, frame_end
    strip.extrapolation = "NOTHING"  # the default, HOLD, leaves the effect on
    strip.use_auto_blend = False
    strip.blend_in, strip.blend_out = fade_in, fade_out
    return strip


def add_heartbeat(
    effect: bpy.types.Object,
    frame_start: float,
    frame_end: float,
    *,
    beats_per_minute: float = 72.0,
    fade_in: float = 0.0,
    fade_out: float = 0.0,
) -> bpy.types.NlaStrip:
    """Add a clip of a heartbeat: a strong and a weak pulse per beat; times and fades are frames.
    The last beat is cut at ``frame_end``."""
    import numpy as np  # not needed at Blender's start

    beat = 60.0 * animation_fps(bpy.context.scene) / beats_per_minute
    beats = (frame_end - frame_start) / beat
    shape = [(0.0, 0.0), (0.08, 1.0), (0.2, 0.0), (0.3, 0.0), (0.38, 0.6), (0.5, 0.0), (1.0, 0.0)]
    if 0.0 < beats < 1.0:
        # Blender repeats no less than a tenth of an action: the only beat itself is cut.
        last = beats, float(np.interp(beats, *np.transpose(shape)))
        shape = [*(key for key in shape if key[0] < beats), last]
    return add_clip(
        effect,
        frame_start,
        frame_end,
        name="Heartbeat",
        fade_in=fade_in,
        fade_out=fade_out,
        profile=[(share * beat, value) for share, value in shape],
        repeat=max(beats, 1.0),
    )


def envelope(strip: bpy.types.NlaStrip, count: int) -> list[Key]:
    """Activation over a clip as (frame, value), with repetitions, fades and drawn fades. There are
    ``count`` evenly spaced frames from start to end of the clip, and the keyframes."""
    start, length = strip.frame_start, strip.frame_end - strip.frame_start
    # Keyframes are added, as a sharp pulse may lie between two frames.
    times = {length * step / max(count - 1, 1) for step in range(count)}
    times |= {frame - start for frame, _ in keys_in(strip, DATA_PATH)}
    return [(start + offset, activation_at(strip, offset)) for offset in sorted(times)]


def activation_at(strip: bpy.types.NlaStrip, offset: float) -> float:
    """Activation 0..1 of a clip ``offset`` frames after its start, within its length, with
    repetitions, fades and drawn fades."""
    curve = curve_in(strip, DATA_PATH)
    value = 1.0 if curve is None else curve.evaluate(_action_frame(strip, offset))
    influence = strip.fcurves.find("influence") if strip.use_animated_influence else None
    # Drawn fades replace linear fades.
    if influence is not None:
        value *= influence.evaluate(strip.frame_start + offset)
    else:
        length = strip.frame_end - strip.frame_start
        value *= _fade(offset, strip.blend_in) * _fade(length - offset, strip.blend_out)
    return min(max(value, 0.0), 1.0)


def timed_shares(keys: Iterable[Key], first: float, fps: float) -> tuple[Key, ...]:
    """Keys (frame, value) as (seconds from frame ``first``, value), at least 0 s and 0 to 1."""
    return tuple(
        (max((frame - first) / fps, 0.0), min(max(value, 0.0), 1.0)) for frame, value in keys
    )


def curve_in(strip: bpy.types.NlaStrip, data_path: str) -> bpy.types.FCurve | None:
    """F-curve of a property in a clip; None if missing."""
    return next((c for c in compat.strip_fcurves(strip) if c.data_path == data_path), None)


def linear_keys(curve: bpy.types.FCurve) -> list[Key]:
    """Points (frame, evaluated value) of an F-curve for linear interpolation, by frame. Points are
    the keyframes, and each whole frame between first and last if a keyframe is not LINEAR. Curves
    with linear keyframes are not sampled between keyframes, even with modifiers. Empty without
    keyframes."""
    frames = [key.co[0] for key in curve.keyframe_points]
    if any(key.interpolation != "LINEAR" for key in curve.keyframe_points):
        frames = sorted({*frames, *map(float, range(int(frames[0]) + 1, int(frames[-1]) + 1))})
    return [(frame, curve.evaluate(frame)) for frame in frames]


def keys_in(strip: bpy.types.NlaStrip, data_path: str) -> list[Key]:
    """Keyframes (scene frame, value) of a property in all repetitions of a clip. Empty for a
    property without an F-curve, and for a reversed clip."""
    curve = curve_in(strip, data_path)
    if curve is None or strip.use_reverse:
        return []
    length = strip.action_frame_end - strip.action_frame_start
    offsets = [
        (key.co[0] - strip.action_frame_start + repetition * length, key.co[1])
        for repetition in range(ceil(strip.repeat - 1e-6))
        for key in curve.keyframe_points
        if strip.action_frame_start <= key.co[0] <= strip.action_frame_end
    ]
    # A strip stretches its action by scale, and may end within a repetition.
    timed = [(strip.frame_start + strip.scale * offset, value) for offset, value in offsets]
    return [key for key in timed if key[0] <= strip.frame_end]


def _action_frame(strip: bpy.types.NlaStrip, offset: float) -> float:
    """Frame in a strip's action at ``offset`` frames after the strip's start, by scale, repetitions
    and reversal; the strip's end is the end of the last repetition."""
    length = max(strip.action_frame_end - strip.action_frame_start, 1e-6)
    played = offset / max(strip.scale, 1e-6)
    # The last repetition may be cut; the end belongs to that repetition.
    repetition = min(int(played / length + 1e-6), max(ceil(strip.repeat - 1e-6) - 1, 0))
    offset_in_action = min(played - repetition * length, length)
    if strip.use_reverse:
        return strip.action_frame_end - offset_in_action
    return strip.action_frame_start + offset_in_action


def _fade(offset: float, fade: float) -> float:
    """Factor of a linear fade of ``fade`` frames, ``offset`` frames after its start; 1 for 0."""
    return min(offset / fade, 1.0) if fade > 0.0 else 1.0


def copy_clips(source: bpy.types.Object, target: bpy.types.Object) -> int:
    """Copy the clips of an effect to another effect at the same times; return their number. Raises
    InputError for a meta strip, before any clip is copied."""
    copied = strips_of(source)
    # Profiles first: a meta strip must raise before anything is copied.
    profiles = [profile_of(source, strip) for _, strip in copied]
    for (_, strip), keys in zip(copied, profiles, strict=True):
        clip = add_clip(
            target,
            strip.frame_start,
            strip.frame_end,
            name=strip.name,
            fade_in=strip.blend_in,
            fade_out=strip.blend_out,
            profile=keys,
            repeat=strip.repeat,
        )
        clip.mute = strip.mute
        drawn_fades.copy(strip, target, clip)
    return len(copied)


def profile_of(effect: bpy.types.Object, strip: bpy.types.NlaStrip) -> list[Key]:
    """Keyframes (frame of the action, activation) of a clip; empty without an F-curve. Raises
    InputError: the clip is a meta strip."""
    if strip.action is None:
        raise InputError(
            f"Clip '{strip.name}' of '{effect.name}' is a group of clips; take it apart first "
            "(NLA editor, Remove Meta-Strips)."
        )
    curve = curve_in(strip, DATA_PATH)
    return [] if curve is None else [(key.co[0], key.co[1]) for key in curve.keyframe_points]


def played_span(scene: bpy.types.Scene, start: float, end: float) -> Key:
    """Convert a span of strip frames to played frames: both times ``frame_map_new / old``."""
    # Time remapping stretches playback, not the strips.
    length = scene.render.frame_map_new / scene.render.frame_map_old
    return start * length, end * length


def outside(
    start: float, end: float, first: float, stop: float, tolerance: float = 0.0
) -> str | None:
    """Part of a span of frames outside of the frames from ``first`` up to, not including, ``stop``.
    "before" or "after" for the whole span; "early" for the beginning; "beyond" for an end that
    exceeds ``stop`` by more than ``tolerance``; None for no part."""
    if end <= first - _ROUNDING:
        return "before"
    if start >= stop - _ROUNDING:
        return "after"
    if start < first - _ROUNDING:
        return "early"
    return "beyond" if end > stop + tolerance + _ROUNDING else None


def outside_scene(scene: bpy.types.Scene, strip: bpy.types.NlaStrip) -> str | None:
    """Part of a clip's played frames outside of a scene's, as of :func:`outside`; an end beyond by
    less than a sample is allowed. None also for a clip that is muted or extrapolated."""
    if strip.mute or strip.extrapolation != "NOTHING":
        return None
    start, end = played_span(scene, strip.frame_start, strip.frame_end)
    # An end beyond the scene by less than a sample is not cut.
    sample = fps_of(scene) / max(scene.hfx.rate, 1.0)
    # The scene ends a frame after the start of the last frame.
    return outside(start, end, scene.frame_start, scene.frame_end + 1, sample)


def extend_scene(scene: bpy.types.Scene, effects: Iterable[bpy.types.Object]) -> list[str]:
    """Extend a scene's frame range to include the clips of effects. Returns the clips still
    outside, as no scene starts before frame 0; a clip that ends before frame 0 changes nothing."""
    pairs = [(effect, strip) for effect in effects for _, strip in strips_of(effect)]
    # Only clips outside change the range: a scene is never shortened.
    for _, strip in pairs:
        start, end = played_span(scene, strip.frame_start, strip.frame_end)
        if outside_scene(scene, strip) is not None and end > _ROUNDING:
            scene.frame_start = min(scene.frame_start, max(floor(start), 0))
            scene.frame_end = max(scene.frame_end, ceil(end))
    return [
        f"'{strip.name}' of '{effect.name}'"
        for effect, strip in pairs
        if outside_scene(scene, strip) is not None
    ]


def shift_times(effects: Iterable[bpy.types.Object], frames: float) -> None:
    """Move clips and keyframes of effects by ``frames``; clips of a linked file stay."""
    for effect in effects:
        pairs = strips_of(effect)
        # The clips in front move first, so that no clip collides with a neighbour.
        for track, strip in pairs[::-1] if frames > 0.0 else pairs:
            if not _is_of_library(effect, track):
                strip.frame_start_ui += frames
        for curve in compat.fcurves(effect):
            for key in curve.keyframe_points:
                key.co_ui.x += frames  # moves the handles too


def deselect_all(but: Container[bpy.types.Object] = ()) -> None:
    """Deselect the NLA strips of all data-blocks, except of the objects ``but``, as the NLA Editor
    moves every selected strip."""
    for owner in compat.data_blocks():
        data = getattr(owner, "animation_data", None)
        is_kept = data is None or owner.library is not None or owner in but
        for track in () if is_kept else data.nla_tracks:
            for strip in track.strips:
                strip.select = False


def remove_clip(effect: bpy.types.Object, name: str) -> None:
    """Remove a clip, and the track if empty then. Raises InputError: the effect has no clip of that
    name, or the clip belongs to a linked file."""
    for track, strip in strips_of(effect):
        if strip.name == name:
            if _is_of_library(effect, track):
                raise InputError(
                    f"Clip '{name}' belongs to the linked file; mute its track instead."
                )
            track.strips.remove(strip)
            if not track.strips:
                effect.animation_data.nla_tracks.remove(track)
            return
    names = ", ".join(f"'{strip.name}'" for _, strip in strips_of(effect)) or "none"
    raise InputError(f"Effect '{effect.name}' has no clip '{name}'; it has: {names}.")


def _free_track(effect: bpy.types.Object, start: float, end: float) -> bpy.types.NlaTrack:
    """Track of an effect with no strip, muted or not, in a span of frames: the lowest of name
    "Clips", then the lowest; else a new track "Clips" on top. Strips may touch the span.
    Tracks of a linked file are passed over. The effect must have animation data."""
    data = effect.animation_data
    # Blender adds a track of another name, below, for a duplicated strip.
    for track in sorted(data.nla_tracks, key=lambda track: not track.name.startswith(_TRACK)):
        # Blender saves no additions to a linked track.
        if not _is_of_library(effect, track) and has_room(track, start, end):
            return track
    track = data.nla_tracks.new()
    track.name = _TRACK
    return track


def has_room(track: bpy.types.NlaTrack, start: float, end: float) -> bool:
    """Test a track for no strip, muted or not, in a span of frames; strips may touch the span."""
    return all(strip.frame_end <= start or strip.frame_start >= end for strip in track.strips)


def _is_of_library(effect: bpy.types.Object, track: bpy.types.NlaTrack) -> bool:
    return effect.override_library is not None and track.is_override_data


def strips_of(effect: bpy.types.Object) -> list[tuple[bpy.types.NlaTrack, bpy.types.NlaStrip]]:
    """Clips of an effect as (track, strip), tracks from bottom to top, strips in the order of time;
    empty without animation data. Clips are strips with an F-curve of the activation, muted or not,
    and meta strips containing such a strip; strips inside of meta strips are not listed."""
    data = effect.animation_data
    if data is None:
        return []
    return [
        (track, strip)
        for track in data.nla_tracks
        for strip in track.strips
        if _animates_activation(strip)
    ]


def lost_strips(effect: bpy.types.Object) -> list[str]:
    """Names of the strips of an effect without any F-curve, as after their action or slot was
    deleted; Blender plays nothing of them."""
    tracks = () if effect.animation_data is None else effect.animation_data.nla_tracks
    strips = (strip for track in tracks for strip in compat.with_grouped(track.strips))
    return [s.name for s in strips if s.type == "CLIP" and not compat.strip_fcurves(s)]


def _animates_activation(strip: bpy.types.NlaStrip) -> bool:
    # A meta strip has no F-curves of its own.
    if strip.type == "META":
        return any(_animates_activation(inner) for inner in strip.strips)
    return any(curve.data_path == DATA_PATH for curve in compat.strip_fcurves(strip))
