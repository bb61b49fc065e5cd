# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement of a point on the skin at the current frame, with path and keyframes.

As for any object in Blender: a point without keyframes is moved. A point with keyframes is keyed if
Auto Keying is on; otherwise the move lasts until the frame changes or a keyframe is inserted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import bpy
import numpy as np

from ...blender import compat
from ...engine.areas.spot import lengths_along, places_on
from ...errors import InputError
from . import paths

if TYPE_CHECKING:
    from ...engine.arrays import F64

    Connection = Callable[[F64, F64], F64]
    """Function of two points (3,) on the skin that returns a path (n, 3) between them."""

    Route = tuple[F64, F64]
    """A path (m, 3), and the shares (k,) of its length at the keyframes."""

_SAME_FRAME: Final = 0.01
_SAME_PLACE_M: Final = 1e-5
_NEAR_M: Final = 0.01


def place_of(effect: bpy.types.Object) -> F64 | None:
    """Current position of a point (3,), metres, rest space; None without a path."""
    path = paths.path_of(effect)
    return places_on(path, np.array([effect.hfx.path_position]))[0] if len(path) else None


def check_keyable(effect: bpy.types.Object, data_path: str, label: str) -> None:
    """Raise InputError if an unmuted driver, or a strip of an unmuted NLA track outside of tweak
    mode, controls a property; ``label`` names the property."""
    data = effect.animation_data
    if data is None:
        return
    if any(d.data_path == data_path and not d.mute for d in data.drivers):
        raise InputError(f"The {label} of '{effect.name}' is driven; change or mute its driver.")
    # A strip overrides the property, except in tweak mode, where its action is edited.
    for track in data.nla_tracks:
        for strip in () if track.mute else track.strips:
            if any(c.data_path == data_path for c in compat.strip_fcurves(strip)):
                if not data.use_tweak_mode:
                    raise InputError(
                        f"The {label} of '{effect.name}' is animated by the NLA strip "
                        f"'{strip.name}'; edit it in tweak mode (Tab)."
                    )


def is_auto_keyed(context: bpy.types.Context, effect: bpy.types.Object, data_path: str) -> bool:
    """Test that Auto Keying would key a property at the current frame: Replace needs a keyframe
    there, Only Insert Available an F-curve."""
    tools, edit = context.tool_settings, context.preferences.edit
    if not tools.use_keyframe_insert_auto:
        return False
    curve = compat.fcurve_of(effect, data_path)
    # Replace Only needs an existing keyframe, Only Insert Available an existing F-curve.
    if curve is None:
        only_replaces = tools.auto_keying_mode == "REPLACE_KEYS"
        return not (only_replaces or edit.use_keyframe_insert_available)
    if tools.auto_keying_mode == "REPLACE_KEYS":
        return key_at(curve, action_frame(context.scene, effect)) is not None
    return True


def action_frame(scene: bpy.types.Scene, effect: bpy.types.Object) -> float:
    """Current frame with subframe, in tweak mode converted to the time of the strip's action."""
    # In tweak mode keyframes count from the start of the strip.
    data = effect.animation_data
    frame = float(scene.frame_current_final)
    return frame if data is None else float(data.nla_tweak_strip_time_to_scene(frame, invert=True))


def key_at(curve: bpy.types.FCurve, frame: float) -> bpy.types.Keyframe | None:
    """Keyframe of an F-curve within 0.01 of a frame; None if missing."""
    return next((k for k in curve.keyframe_points if abs(k.co[0] - frame) < _SAME_FRAME), None)


def place_at(scene: bpy.types.Scene, effect: bpy.types.Object, point: F64, is_keyed: bool) -> None:
    """Move a point to a position (3,) on the skin at the current frame; rest space, metres.

    Without keyframes, the point's path is bent. With keyframes, ``is_keyed`` inserts a keyframe
    with shortest paths to the neighbours; otherwise the move lasts until the frame changes. Raises
    InputError: the position is not on the body, the effect belongs to another file, or the position
    is driven or animated by an NLA strip.
    """
    paths.check_editable(effect)
    check_keyable(effect, paths.POSITION, "position")
    (point,) = paths.skin().on_skin(np.asarray(point, np.float64)[None])
    # A temporary move before this one must not become part of the path.
    remove_extension(effect)
    if len(paths.path_of(effect)) == 0:
        paths.set_path(effect, point[None])
    curve = paths.motion_of(effect)
    if curve is None or not len(curve.keyframe_points):
        _move_unkeyed(effect, point)
        if is_keyed:
            effect.keyframe_insert(paths.POSITION)
    elif is_keyed:
        _key_position(scene, effect, curve, point)
    else:
        _extend_to(effect, point)
    effect.update_tag()


def place_along(effect: bpy.types.Object, share: float, is_keyed: bool) -> None:
    """Move a point to a share of the path at the current frame; insert a key if ``is_keyed``.

    The path is unchanged but for a temporary extension, which is removed. Raises InputError: the
    position is driven or animated by an NLA strip.
    """
    check_keyable(effect, paths.POSITION, "position")
    remove_extension(effect)
    effect.hfx.path_position = share
    if is_keyed:
        effect.keyframe_insert(paths.POSITION)
    effect.update_tag()


def key_here(scene: bpy.types.Scene, effect: bpy.types.Object) -> None:
    """Insert a keyframe at the current position of a point.

    Raises InputError: the point has no position, or is driven or animated by an NLA strip.
    """
    place = place_of(effect)
    if place is None:
        raise InputError(f"'{effect.name}' has no place on the skin; place it first.")
    # At a temporary position the path needs a detour; on the path a keyframe suffices.
    if paths.OWN in effect:
        place_at(scene, effect, place, is_keyed=True)
    else:
        place_along(effect, effect.hfx.path_position, is_keyed=True)


def share_nearest(path: F64, place: F64) -> float:
    """Share of a path's length at the point nearest to ``place`` (3,), in one space; 0 without a
    length."""
    if len(path) < 2:
        return 0.0
    # Projection onto each segment, clipped to the ends.
    starts, edges = path[:-1], np.diff(path, axis=0)
    squares = np.maximum(np.einsum("ij,ij->i", edges, edges), 1e-18)
    along = np.clip(np.einsum("ij,ij->i", place - starts, edges) / squares, 0.0, 1.0)
    k = int(np.argmin(np.linalg.norm(starts + along[:, None] * edges - place, axis=1)))
    lengths = lengths_along(path)
    if lengths[-1] <= 0.0:
        return 0.0
    return float((lengths[k] + along[k] * (lengths[k + 1] - lengths[k])) / lengths[-1])


def rerouted(
    path: F64, shares: F64, at: int, place: F64, connect: Connection, *, new: bool
) -> Route:
    """Path through the positions of keyframes in the order of time, with a position changed.

    ``path`` (n, 3) and ``shares`` (k,) of its length, in the order of time, are the old keyframes;
    n and k are not 0. Keyframe ``at`` moves to ``place`` (3,), or if ``new`` a keyframe is inserted
    before index ``at``. ``connect`` gives the legs to and from the new position; further legs stay.
    """
    places = places_on(path, shares)
    before, after = at, at if new else at + 1
    # Legs between unchanged keyframes are cut from the old path; at most two are new.
    legs: list[F64] = [between(path, *shares[k : k + 2]) for k in range(before - 1)]
    if before > 0:
        legs.append(connect(places[before - 1], place))
    if after < len(shares):
        legs.append(connect(place, places[after]))
    legs += [between(path, *shares[k : k + 2]) for k in range(after, len(shares) - 1)]
    if not legs:
        return place[None].copy(), np.zeros(1)
    route = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
    # Legs share their end points, which counts once.
    ends = np.cumsum([0, *(len(leg) - 1 for leg in legs)])
    lengths = lengths_along(route)
    if lengths[-1] <= 0.0:
        return route[:1], np.zeros(len(ends))
    return route, lengths[ends] / lengths[-1]


def between(path: F64, first: float, last: float) -> F64:
    """Part of a path between two shares of its length, (n, 3), n > 1; reversed if first > last."""
    lengths = lengths_along(path)
    low, high = sorted((np.clip(first, 0.0, 1.0), np.clip(last, 0.0, 1.0)))
    ends = places_on(path, np.array([low, high]))
    # Points within rounding of the cut would make zero-length segments.
    inside = (lengths > low * lengths[-1] + 1e-9) & (lengths < high * lengths[-1] - 1e-9)
    part: F64 = np.concatenate([ends[:1], path[inside], ends[1:]])
    return part if first <= last else part[::-1]


def remove_extension(effect: bpy.types.Object) -> None:
    """Remove the path's temporary extension; keyframes keep their positions.

    ``path_position`` is unchanged, so the point itself moves to the end of the path.
    """
    own_path = paths.own_path(effect)
    path = paths.path_of(effect)
    if paths.OWN in effect:
        del effect[paths.OWN]
    if len(own_path) == len(path):
        return
    effect[paths.PATH] = own_path.ravel().tolist()
    # Keyframes store shares of the length, which is shorter now.
    stretch = lengths_along(path)[-1] / max(lengths_along(own_path)[-1], 1e-12)
    curve = paths.motion_of(effect)
    if curve is not None:
        values = [min(key.co[1] * stretch, 1.0) for key in curve.keyframe_points]
        _set_values(curve, values, [stretch] * len(values), [stretch] * len(values))


def _extend_to(effect: bpy.types.Object, place: F64) -> None:
    """Append ``place`` to the path as a temporary extension, and move the point there; keyframes
    are rescaled to their old positions. No extension if the path ends there."""
    path = paths.path_of(effect)
    if np.linalg.norm(place - path[-1]) < _SAME_PLACE_M:
        effect.hfx.path_position = 1.0
        return
    length = lengths_along(path)[-1]
    extended = np.concatenate([path, place[None]])
    effect[paths.OWN] = len(path)
    effect[paths.PATH] = extended.ravel().tolist()
    # Keyframes must keep their positions although the path is longer now.
    scale = float(length / lengths_along(extended)[-1])
    curve = paths.motion_of(effect)
    assert curve is not None
    values = [key.co[1] * scale for key in curve.keyframe_points]
    _set_values(curve, values, [scale] * len(values), [scale] * len(values))
    bpy.context.view_layer.update()  # evaluates the F-curve, before the next line overrides it
    effect.hfx.path_position = 1.0


def _move_unkeyed(effect: bpy.types.Object, place: F64) -> None:
    """Move a point without keyframes to ``place``, and draw its path again through it: control
    points within 1 cm, of traced paths within the length of the move, are dropped."""
    path, knots = paths.path_of(effect), paths.knots_of(effect)
    if len(knots) < 2:
        paths.set_path(effect, place[None])
        return
    kind = str(effect.get(paths.KIND, "traced"))
    closed = bool(effect.get(paths.CLOSED, 0))
    # Control points before and after the point stay, those near the point give way to the new
    # position.
    lengths = lengths_along(path)
    current_m = effect.hfx.path_position * lengths[-1]
    knots_m = np.array([share_nearest(path, knot) for knot in knots]) * lengths[-1]
    before_m = after_m = _NEAR_M
    if kind == "traced":  # dense control points: points within the distance of the move are dropped
        current = places_on(path, np.array([effect.hfx.path_position]))[0]
        pulled_m = float(np.linalg.norm(place - current))
        before_m = max(_NEAR_M, min(pulled_m, 0.5 * current_m))
        after_m = max(_NEAR_M, min(pulled_m, 0.5 * (lengths[-1] - current_m)))
    before, after = knots[knots_m < current_m - before_m], knots[knots_m > current_m + after_m]
    middle = place[None]
    if kind == "traced":
        middle = np.concatenate(
            [
                _shortest(before[-1], place)[1:] if len(before) else middle,
                _shortest(place, after[0])[1:-1] if len(after) else middle[:0],
            ]
        )
    knots = np.concatenate([before, middle, after])
    paths.draw(effect, knots, kind=kind, closed=closed)
    effect.hfx.path_position = share_nearest(paths.path_of(effect), place)


def _key_position(
    scene: bpy.types.Scene, effect: bpy.types.Object, curve: bpy.types.FCurve, place: F64
) -> None:
    """Key the point at ``place`` at the current frame, with a path rerouted by shortest ways to the
    neighbouring keyframes, whose values change; the path is then traced and open. InputError for
    more than MAX_POINTS points."""
    path = paths.path_of(effect)
    frame = action_frame(scene, effect)
    frames = np.array([key.co[0] for key in curve.keyframe_points])
    shares = np.clip([key.co[1] for key in curve.keyframe_points], 0.0, 1.0)
    # Index of the keyframe at the frame, or of the first keyframe after it. Blender keeps the
    # keyframes of an F-curve sorted by time.
    at = int(np.searchsorted(frames, frame - _SAME_FRAME))
    new = key_at(curve, frame) is None
    route, values = rerouted(path, shares, at, place, _shortest, new=new)
    if len(route) > paths.MAX_POINTS:
        raise InputError(
            f"'{effect.name}': the path through all its {len(frames)} keyframes would have more "
            f"than {paths.MAX_POINTS} places; remove some keyframes first."
        )
    paths.set_path(effect, route)
    effect[paths.KIND], effect[paths.CLOSED] = "traced", 0
    scale = float(lengths_along(path)[-1] / max(lengths_along(route)[-1], 1e-12))
    _set_ascending_values(curve, np.delete(values, at) if new else values, shares, scale)
    effect.hfx.path_position = float(values[at])
    effect.keyframe_insert(paths.POSITION)


def _shortest(first: F64, last: F64) -> F64:
    """Shortest path (n, 3) on the skin between two points, n > 1 also for equal points."""
    path = paths.skin().straight(np.stack([first, last]))
    return path if len(path) > 1 else np.stack([first, last])


def _set_ascending_values(curve: bpy.types.FCurve, values: F64, old: F64, scale: float) -> None:
    """Set ascending keyframe values (k,) in place of ``old`` (k,), which may rise and fall. Handles
    are scaled by ``scale``, negative where ``old`` fell, and level at its turning points."""
    signs = np.sign(np.diff(old))
    left_scales = np.concatenate([[1.0], signs])
    right_scales = np.concatenate([signs, [1.0]])
    for key, before, after in zip(curve.keyframe_points, left_scales, right_scales, strict=True):
        if before * after < 0.0:  # a turning point has level handles, and keeps a short rest
            key.handle_left_type = key.handle_right_type = "ALIGNED"
            key.handle_left[1] = key.handle_right[1] = key.co[1]
    _set_values(
        curve, values.tolist(), (left_scales * scale).tolist(), (right_scales * scale).tolist()
    )


def _set_values(
    curve: bpy.types.FCurve,
    values: list[float],
    left_scales: list[float],
    right_scales: list[float],
) -> None:
    """Set keyframe values; value offsets of left and right handles are multiplied by the scales."""
    points = zip(curve.keyframe_points, values, left_scales, right_scales, strict=True)
    for key, value, left, right in points:
        offsets = (key.handle_left[1] - key.co[1], key.handle_right[1] - key.co[1])
        key.co[1] = value
        key.handle_left[1] = value + left * offsets[0]
        key.handle_right[1] = value + right * offsets[1]
    curve.update()
