# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectorised evaluation of a data-block's F-curves and NLA strips.

No scene is stepped. Unsupported animation raises :class:`NotModelledError`.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ...blender import compat
from ...engine.arrays import F32, F64, I32, I64
from ...engine.kinematics.keyframe_curves import Interpolation, KeyedCurves

Channel = tuple[str, int]  # RNA path and array index of an animated property
_LAST_KIND = int(max(Interpolation))
_BEZIER = int(Interpolation.BEZIER)
_MOST_REPEATS = 1000  # Blender's limit on the repetitions of a strip


class NotModelledError(Exception):
    """Motion that needs Blender's own evaluation; the message names the cause."""


@dataclass(eq=False)
class _Curves:
    """F-curves of an action, grouped for sampling."""

    channels: list[Channel] = field(default_factory=list)
    key_frames: set[float] = field(default_factory=set)  # frames of the action
    keyed: list[tuple[KeyedCurves, list[int]]] = field(default_factory=list)  # with column numbers
    other: list[tuple[bpy.types.FCurve, int]] = field(default_factory=list)

    def sample(self, frames: F64, single: bool) -> F64:
        """Values (T, C) at frames (T,) of the action, columns as ``channels``. ``single`` computes
        in Blender's float32 where keys allow; curves in ``other`` are evaluated by Blender
        singly."""
        # The usual case, a baked rig: the columns are in order already.
        if len(self.keyed) == 1 and not self.other:
            return self.keyed[0][0].sample(frames, single=single)
        values = np.zeros((len(frames), len(self.channels)))
        for curves, columns in self.keyed:
            values[:, columns] = curves.sample(frames, single=single)
        for curve, column in self.other:
            values[:, column] = [curve.evaluate(frame) for frame in frames.tolist()]
        return values


def plain_keys(curve: bpy.types.FCurve) -> tuple[F32, I32] | None:
    """Frames and values of K keys, their left and right handles, (3, K, 2), and interpolations
    (K,); None without keys, with F-modifiers, extrapolation, easing, infinite keys or keys out of
    order, as a script may leave them."""
    keys = curve.keyframe_points
    if not len(keys) or len(curve.modifiers) or curve.extrapolation != "CONSTANT":
        return None
    points, kinds = np.empty((3, len(keys), 2), np.float32), np.empty(len(keys), np.int32)
    for name, flat in zip(("co", "handle_left", "handle_right"), points, strict=True):
        keys.foreach_get(name, flat.ravel())
    keys.foreach_get("interpolation", kinds)
    # Blender stores the largest float32 for an infinite key; NaN fails each comparison.
    is_plain = kinds.max() <= _LAST_KIND and np.abs(points).max() < np.finfo(np.float32).max
    is_plain &= bool((np.diff(points[0, :, 0]) > 0.0).all())
    return (points, kinds) if is_plain else None


def limits_of(curve: bpy.types.FCurve) -> tuple[float, float]:
    """Lower and upper bound of a curve's values over all frames; (-inf, inf) for a curve without
    plain keys, see :func:`plain_keys`."""
    plain = plain_keys(curve)
    if plain is None:
        return -math.inf, math.inf
    # A Bezier curve stays within the hull of the keys and handles.
    values = plain[0][..., 1]
    return float(values.min()), float(values.max())


def _grouped(curves: Iterable[bpy.types.FCurve], selects: Callable[[str], bool]) -> _Curves:
    """Group valid, unmuted curves whose RNA path is accepted by ``selects``, by equal frames and
    interpolations. Curves without plain keys go to ``other``; frames of all curves are collected in
    ``key_frames``."""
    grouped = _Curves()
    groups: dict[tuple[bytes, bytes], list[tuple[int, F32]]] = {}
    for curve in curves:
        if not selects(curve.data_path):
            continue
        if curve.mute or (curve.group is not None and curve.group.mute) or not curve.is_valid:
            continue
        column = len(grouped.channels)
        grouped.channels.append((curve.data_path, curve.array_index))
        plain = plain_keys(curve)
        # Rare cases, left to Blender frame by frame: modifiers and extrapolation have many forms.
        if plain is None:
            grouped.key_frames.update(key.co[0] for key in curve.keyframe_points)
            grouped.other.append((curve, column))
            continue
        frames = plain[0][0, :, 0]
        grouped.key_frames.update(frames.tolist())
        # Curves with equal key frames and interpolations share the search for segments, as in baked
        # motion.
        signature = frames.tobytes(), plain[1].tobytes()
        groups.setdefault(signature, []).append((column, plain[0]))
    for (frame_bytes, kind_bytes), members in groups.items():
        kinds = np.frombuffer(kind_bytes, np.int32)
        frames = np.frombuffer(frame_bytes, np.float32).astype(np.float64)
        points = np.stack([points for _, points in members], axis=1).astype(np.float64)
        # Linear and constant segments never use handles.
        handles = points[1:] if _BEZIER in kinds else (None, None)
        curves_of_group = KeyedCurves(frames, kinds, points[0, ..., 1], *handles)
        grouped.keyed.append((curves_of_group, [column for column, _ in members]))
    return grouped


class _Strip:
    """Copy of an NLA strip's settings, which any thread may read; ``columns`` are columns of the
    values of ``curves`` among all columns of the data-block. Start, end and blends are frames of
    the scene, ``action_frames`` the first and last played frame of the action."""

    def __init__(self, strip: bpy.types.NlaStrip, curves: _Curves, columns: I64 | slice) -> None:
        self.curves, self.columns = curves, columns
        self.name, self.is_muted = strip.name, strip.mute
        self.start, self.end = strip.frame_start, strip.frame_end
        self.action_frames = strip.action_frame_start, strip.action_frame_end
        self.scale, self.repeat = strip.scale, strip.repeat
        self.blend_in, self.blend_out = strip.blend_in, strip.blend_out
        self.extrapolation = strip.extrapolation

    def frames_within(self, frames: F64) -> F64:
        """Frames of the action (T,) at frames of the scene (T,) within the strip; raises
        NotModelledError without a length. Repetitions start again at the first frame; the end of a
        whole number of repetitions holds the last frame."""
        first, last = self.action_frames
        length = (last - first) * self.scale
        if length <= 0.0:
            raise NotModelledError(f"strip '{self.name}' plays no length of its action")
        into = frames - self.start
        # Blender computes the phase in float32, which decides the side of a repetition's edge.
        # Frames within one repetition of the action.
        phase = np.fmod(into.astype(np.float32), np.float32(length)).astype(np.float64)
        own = first + phase / self.scale
        if float(self.repeat).is_integer():
            # After a whole number of repetitions the last frame holds, not the first.
            own = np.where(frames >= self.end, last, own)
        return own

    @property
    def key_frames(self) -> F64:
        """Frames of the scene, unsorted, of keys within the played frames and of both their ends,
        for each of up to 1000 repetitions; the last repetition is not cut."""
        first, last = self.action_frames
        # Motion starts and stops at the ends of a strip, so both count as keys.
        keys = np.array([first, *self.curves.key_frames, last])
        keys = (keys[(keys >= first) & (keys <= last)] - first) * self.scale
        length = (last - first) * self.scale
        starts = self.start + length * np.arange(math.ceil(min(self.repeat, _MOST_REPEATS)))
        return (starts[:, None] + keys).ravel()

    def influence(self, frames: F64) -> F64:
        """Influence (T,) at frames of the scene: 1, with linear blends to 0 at the start and at the
        end. Where the blends overlap, the blend in counts."""
        share = np.ones(len(frames))
        if self.blend_out > 0.0:
            falling = frames >= self.end - self.blend_out
            share = np.where(falling, np.abs(self.end - frames) / self.blend_out, share)
        if self.blend_in > 0.0:
            rising = frames <= self.start + self.blend_in
            share = np.where(rising, np.abs(frames - self.start) / self.blend_in, share)
        return share


class AnimatedValues:
    """Animated values of a data-block from the action and NLA tracks. ``default(path, index)`` is
    the value without a playing strip, ``selects(path)`` chooses RNA paths; with ``with_drivers``
    drivers are ignored, for the caller to leave to Blender. Raises NotModelledError for drivers,
    blended actions, tweak mode, or strips other than plain clips."""

    def __init__(
        self,
        owner: bpy.types.ID,
        default: Callable[[str, int], float],
        selects: Callable[[str], bool],
        *,
        with_drivers: bool = False,
    ) -> None:
        self._selects = selects
        self.columns: dict[Channel, int] = {}
        self._below: list[float] = []  # values without a playing strip
        self._tracks: list[list[_Strip]] = []
        self._action: tuple[_Curves, I64 | slice] | None = None
        data = owner.animation_data
        if data is None:
            return
        if not with_drivers and any(not driver.mute for driver in data.drivers):
            raise NotModelledError(f"'{owner.name}' has drivers")
        if data.use_tweak_mode:
            raise NotModelledError(f"a strip of '{owner.name}' is being edited")
        action = _grouped(compat.fcurves(owner), selects)
        if data.use_nla:
            self._read_tracks(owner.name, data, default)
        if self.columns and action.channels:
            # With NLA strips below, only a replacing action with full influence hides them
            # completely.
            plain = data.action_blend_type == "REPLACE" and data.action_extrapolation == "HOLD"
            if not plain or data.action_influence < 1.0:
                raise NotModelledError(f"the action of '{owner.name}' is blended")
        columns = self._columns_of(action, default)
        if not (data.use_nla and any(track.is_solo for track in data.nla_tracks)):
            self._action = action, columns

    def _columns_of(self, curves: _Curves, default: Callable[[str, int], float]) -> I64 | slice:
        """Columns of curves in ``self.columns``; new channels are appended with ``default(path,
        index)`` as their value. A slice if consecutive, else an array."""
        for channel in curves.channels:
            if channel not in self.columns:
                self.columns[channel] = len(self._below)
                self._below.append(default(*channel))
        columns = [self.columns[channel] for channel in curves.channels]
        first = columns[0] if columns else 0
        if columns == [*range(first, first + len(columns))]:
            return slice(first, first + len(columns))
        return np.array(columns, np.int64)

    def _read_tracks(
        self, name: str, data: bpy.types.AnimData, default: Callable[[str, int], float]
    ) -> None:
        """Append the strips of evaluated tracks to ``_tracks``, from bottom to top: of solo tracks,
        else of unmuted tracks. Raises NotModelledError for a strip that is no plain clip. Without
        solo too, channels of unmuted tracks get columns."""
        solo = any(track.is_solo for track in data.nla_tracks)
        for track in data.nla_tracks:
            # With a solo track the mute switches of tracks do not count.
            if track.mute and not track.is_solo:
                continue
            strips = []
            for strip in track.strips:
                _refuse_other_strips(name, strip)
                curves = _grouped(compat.strip_fcurves(strip), self._selects)
                # Strips silenced by another track's solo still give their channels the default
                # value.
                columns = self._columns_of(curves, default)
                strips.append(_Strip(strip, curves, columns))
            if track.is_solo or not solo:
                self._tracks.append(strips)

    @property
    def key_frames(self) -> F64:
        """Ascending unique frames of the scene at keys of the strips and of the action, and at the
        strips' ends; empty without animation."""
        parts = [strip.key_frames for strips in self._tracks for strip in strips]
        if self._action is not None:
            parts.append(np.array([*self._action[0].key_frames]))
        return np.unique(np.concatenate([np.zeros(0), *parts]))

    def sample(self, frames: F64, *, single: bool = False) -> F64:
        """Values (T, C) at frames of the scene, columns as in ``columns``. Tracks are evaluated
        from bottom to top, then the action. ``single`` uses Blender's float32 arithmetic; see
        :meth:`KeyedCurves.sample`."""
        # Below all strips Blender's NLA starts from the default, not from the stored value.
        values = np.tile(np.array(self._below, np.float64), (len(frames), 1))
        # A strip with influence below 1 blends with the tracks below; the assigned action replaces
        # all strips, as Blender's NLA does with Replace and an influence of 1.
        for strips in self._tracks:
            for strip, rows, at in _playing(strips, frames):
                sampled = strip.curves.sample(strip.frames_within(at), single)
                share = strip.influence(at)[:, None]
                columns = strip.columns
                index: Any = rows, columns
                if not isinstance(columns, slice):
                    index = np.ix_(rows, columns)
                if (share < 1.0).any():
                    sampled = values[index] * (1.0 - share) + sampled * share
                values[index] = sampled
        if self._action is not None:
            curves, columns = self._action
            values[:, columns] = curves.sample(frames, single)
        return values


def _refuse_other_strips(name: str, strip: bpy.types.NlaStrip) -> None:
    """Raise NotModelledError for strips other than plain clips. A plain clip replaces values, runs
    forwards at a positive scale, and has no F-modifiers and no animated influence or time."""
    plain = (
        strip.type == "CLIP"
        and strip.blend_type == "REPLACE"
        and not strip.use_animated_influence
        and not strip.use_animated_time
        and not strip.use_reverse
        and not len(strip.modifiers)
        and strip.scale > 0.0
    )
    if not plain:
        raise NotModelledError(f"strip '{strip.name}' of '{name}' is more than a plain clip")


def _playing(strips: list[_Strip], frames: F64) -> Iterable[tuple[_Strip, np.ndarray, F64]]:
    """Yield (strip, row indices, frames of these rows) of each unmuted strip of a track, frames
    clamped to the strip's ends. At each frame the first covering strip plays, also a muted one.
    After its end a strip with "HOLD" or "HOLD_FORWARD" holds until the next strip's start; before
    its start only the first strip with "HOLD"."""
    free = np.ones(len(frames), np.bool_)
    for k, strip in enumerate(strips):
        until = strips[k + 1].start if k + 1 < len(strips) else np.inf
        kind = strip.extrapolation
        covered = (frames >= strip.start) & (frames <= strip.end)
        if kind != "NOTHING":
            covered |= (frames > strip.end) & (frames < until)
        if kind == "HOLD" and k == 0:
            covered |= frames < strip.start
        rows = np.flatnonzero(covered & free)
        # The first strip of a track that covers a frame plays; later strips do not.
        free[rows] = False
        if len(rows) and not strip.is_muted:
            yield strip, rows, np.clip(frames[rows], strip.start, strip.end)
