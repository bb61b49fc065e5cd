# SPDX-License-Identifier: GPL-3.0-or-later
"""Places a point on the skin at a frame, and updates its path and its keyframes.

As with any object of Blender: what rests is moved; what moves is keyed there if Auto Keying is on,
else it stays only until the frame changes, or until it is keyed by hand.
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

    Way = Callable[[F64, F64], F64]
    """Two places (3,) on the skin -> the places (n, 3) from the one to the other."""

    Route = tuple[F64, F64]
    """A path (m, 3), and at which shares of its length the keys (k,) are."""

_SAME_FRAME: Final = 0.01
_SAME_PLACE_M: Final = 1e-5
_NEAR_M: Final = 0.01


def place_of(effect: bpy.types.Object) -> F64 | None:
    """Current place of a point (3,), metres, rest space; None if it has none yet."""
    path = paths.path_of(effect)
    return places_on(path, np.array([effect.hfx.path_position]))[0] if len(path) else None


def check_free(effect: bpy.types.Object, data_path: str, what: str) -> None:
    """Raise InputError if anything but the keyframes of its action controls a property."""
    data = effect.animation_data
    if data is None:
        return
    if any(d.data_path == data_path and not d.mute for d in data.drivers):
        raise InputError(f"The {what} of '{effect.name}' is driven; change or mute its driver.")
    for track in data.nla_tracks:
        for strip in () if track.mute else track.strips:
            if any(c.data_path == data_path for c in compat.strip_fcurves(strip)):
                if not data.use_tweak_mode:
                    raise InputError(
                        f"The {what} of '{effect.name}' is animated by the NLA strip "
                        f"'{strip.name}'; edit it in tweak mode (Tab)."
                    )


def is_auto_keyed(context: bpy.types.Context, effect: bpy.types.Object, data_path: str) -> bool:
    """Test that Auto Keying, as it is set, keys a property of an effect at this frame."""
    tools, edit = context.tool_settings, context.preferences.edit
    if not tools.use_keyframe_insert_auto:
        return False
    curve = compat.fcurve_of(effect, data_path)
    if curve is None:
        only_replaces = tools.auto_keying_mode == "REPLACE_KEYS"
        return not (only_replaces or edit.use_keyframe_insert_available)
    if tools.auto_keying_mode == "REPLACE_KEYS":
        return key_at(curve, action_frame(context.scene, effect)) is not None
    return True


def action_frame(scene: bpy.types.Scene, effect: bpy.types.Object) -> float:
    """The current frame, as the keyframes of the effect's action count it."""
    data = effect.animation_data
    frame = float(scene.frame_current_final)
    return frame if data is None else float(data.nla_tweak_strip_time_to_scene(frame, invert=True))


def key_at(curve: bpy.types.FCurve, frame: float) -> bpy.types.Keyframe | None:
    """An F-curve's key at a frame."""
    return next((k for k in curve.keyframe_points if abs(k.co[0] - frame) < _SAME_FRAME), None)


def put(scene: bpy.types.Scene, effect: bpy.types.Object, place: F64, is_keyed: bool) -> None:
    """Put a point to a place on the skin at the current frame.

    Parameters
    ----------
    place : (3,) float64
        Rest space of the canonical body, metres.
    is_keyed : bool
        Whether its place is keyed. The way from and to the neighbouring keys is the shortest one on
        the skin; everything between other keys stays as it is.

    Raises
    ------
    InputError
        The place is not on the body, the effect is another file's, or its position is driven or
        animated by an NLA strip.
    """
    paths.check_own(effect)
    check_free(effect, paths.POSITION, "position")
    (place,) = paths.skin().on_skin(np.asarray(place, np.float64)[None])
    settle(effect)
    if len(paths.path_of(effect)) == 0:
        paths.set_path(effect, place[None])
    curve = paths.motion_of(effect)
    if curve is None or not len(curve.keyframe_points):
        _put_resting(effect, place)
        if is_keyed:
            effect.keyframe_insert(paths.POSITION)
    elif is_keyed:
        _key(scene, effect, curve, place)
    else:
        _hold(effect, place)
    effect.update_tag()


def put_along(effect: bpy.types.Object, share: float, is_keyed: bool) -> None:
    """Put a point to a share of its own path at the current frame; the path stays as it is.

    Raises
    ------
    InputError
        Its position is driven or animated by an NLA strip.
    """
    check_free(effect, paths.POSITION, "position")
    settle(effect)
    effect.hfx.path_position = share
    if is_keyed:
        effect.keyframe_insert(paths.POSITION)
    effect.update_tag()


def key_here(scene: bpy.types.Scene, effect: bpy.types.Object) -> None:
    """Key the place where a point is now.

    Raises
    ------
    InputError
        It is nowhere yet, or its position is driven or animated by an NLA strip.
    """
    place = place_of(effect)
    if place is None:
        raise InputError(f"'{effect.name}' has no place on the skin; place it first.")
    if paths.OWN in effect:
        put(scene, effect, place, is_keyed=True)
    else:
        put_along(effect, effect.hfx.path_position, is_keyed=True)


def share_nearest(path: F64, place: F64) -> float:
    """Share of a path's length at which it is nearest to a place (3,)."""
    if len(path) < 2:
        return 0.0
    starts, ways = path[:-1], np.diff(path, axis=0)
    squares = np.maximum(np.einsum("ij,ij->i", ways, ways), 1e-18)
    within = np.clip(np.einsum("ij,ij->i", place - starts, ways) / squares, 0.0, 1.0)
    k = int(np.argmin(np.linalg.norm(starts + within[:, None] * ways - place, axis=1)))
    lengths = lengths_along(path)
    if lengths[-1] <= 0.0:
        return 0.0
    return float((lengths[k] + within[k] * (lengths[k + 1] - lengths[k])) / lengths[-1])


def rerouted(path: F64, shares: F64, at: int, place: F64, way: Way, *, new: bool) -> Route:
    """A path through the places of keys in the order of time, one of them at another place.

    Parameters
    ----------
    path : (n, 3) float64
        n > 0.
    shares : (k,) float64
        Of the keys, k > 0, in the order of time; where they are on the path.
    at : int
        The key that is put elsewhere.
    place : (3,) float64
    way : Way
        Leads to the place and on from it. Between other keys the path goes as it went.
    new : bool
        Whether it is a key of its own before key ``at``, or that key itself.
    """
    places = places_on(path, shares)
    before, after = at, at if new else at + 1
    legs: list[F64] = [between(path, *shares[k : k + 2]) for k in range(before - 1)]
    if before > 0:
        legs.append(way(places[before - 1], place))
    if after < len(shares):
        legs.append(way(place, places[after]))
    legs += [between(path, *shares[k : k + 2]) for k in range(after, len(shares) - 1)]
    if not legs:
        return place[None].copy(), np.zeros(1)
    found = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
    ends = np.cumsum([0, *(len(leg) - 1 for leg in legs)])
    lengths = lengths_along(found)
    if lengths[-1] <= 0.0:
        return found[:1], np.zeros(len(ends))
    return found, lengths[ends] / lengths[-1]


def between(path: F64, first: float, last: float) -> F64:
    """The part of a path from one share of its length to another, which may be before it, (n, 3).

    n > 1.
    """
    lengths = lengths_along(path)
    low, high = sorted((np.clip(first, 0.0, 1.0), np.clip(last, 0.0, 1.0)))
    ends = places_on(path, np.array([low, high]))
    inside = (lengths > low * lengths[-1] + 1e-9) & (lengths < high * lengths[-1] - 1e-9)
    part: F64 = np.concatenate([ends[:1], path[inside], ends[1:]])
    return part if first <= last else part[::-1]


def settle(effect: bpy.types.Object) -> None:
    """Remove the extension to a temporary place; the keys keep their places.

    The point itself is then at the path's end, until it is put elsewhere.
    """
    own = paths.own_path(effect)
    path = paths.path_of(effect)
    if paths.OWN in effect:
        del effect[paths.OWN]
    if len(own) == len(path):
        return
    effect[paths.PATH] = own.ravel().tolist()
    longer = lengths_along(path)[-1] / max(lengths_along(own)[-1], 1e-12)
    curve = paths.motion_of(effect)
    if curve is not None:
        values = [min(key.co[1] * longer, 1.0) for key in curve.keyframe_points]
        _set_values(curve, values, [longer] * len(values), [longer] * len(values))


def _hold(effect: bpy.types.Object, place: F64) -> None:
    """Hold a keyed point elsewhere until the frame changes: at the end of an added stretch
    of path.
    """
    path = paths.path_of(effect)
    if np.linalg.norm(place - path[-1]) < _SAME_PLACE_M:
        effect.hfx.path_position = 1.0
        return
    length = lengths_along(path)[-1]
    longer = np.concatenate([path, place[None]])
    effect[paths.OWN] = len(path)
    effect[paths.PATH] = longer.ravel().tolist()
    scale = float(length / lengths_along(longer)[-1])
    curve = paths.motion_of(effect)
    assert curve is not None
    values = [key.co[1] * scale for key in curve.keyframe_points]
    _set_values(curve, values, [scale] * len(values), [scale] * len(values))
    bpy.context.view_layer.update()  # the changed F-curve's values come first
    effect.hfx.path_position = 1.0


def _put_resting(effect: bpy.types.Object, place: F64) -> None:
    """Move a point without keys: if it has a path, that is pulled along and leads through there."""
    path, knots = paths.path_of(effect), paths.knots_of(effect)
    if len(knots) < 2:
        paths.set_path(effect, place[None])
        return
    kind = str(effect.get(paths.KIND, "traced"))
    closed = bool(effect.get(paths.CLOSED, 0))
    lengths = lengths_along(path)
    here_m = effect.hfx.path_position * lengths[-1]
    along_m = np.array([share_nearest(path, knot) for knot in knots]) * lengths[-1]
    before_m = after_m = _NEAR_M
    if kind == "traced":  # its places are close together: as many give way as it is pulled far
        here = places_on(path, np.array([effect.hfx.path_position]))[0]
        pulled_m = float(np.linalg.norm(place - here))
        before_m = max(_NEAR_M, min(pulled_m, 0.5 * here_m))
        after_m = max(_NEAR_M, min(pulled_m, 0.5 * (lengths[-1] - here_m)))
    before, after = knots[along_m < here_m - before_m], knots[along_m > here_m + after_m]
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


def _key(
    scene: bpy.types.Scene, effect: bpy.types.Object, curve: bpy.types.FCurve, place: F64
) -> None:
    """Put a key at the current frame to a place, or add one there."""
    path = paths.path_of(effect)
    frame = action_frame(scene, effect)
    frames = np.array([key.co[0] for key in curve.keyframe_points])
    shares = np.clip([key.co[1] for key in curve.keyframe_points], 0.0, 1.0)
    at = int(np.searchsorted(frames, frame - _SAME_FRAME))
    new = key_at(curve, frame) is None
    made, values = rerouted(path, shares, at, place, _shortest, new=new)
    if len(made) > paths.MAX_POINTS:
        raise InputError(
            f"'{effect.name}': the path through all its {len(frames)} keyframes would have more "
            f"than {paths.MAX_POINTS} places; remove some keyframes first."
        )
    paths.set_path(effect, made)
    effect[paths.KIND], effect[paths.CLOSED] = "traced", 0
    scale = float(lengths_along(path)[-1] / max(lengths_along(made)[-1], 1e-12))
    _unroll(curve, np.delete(values, at) if new else values, shares, scale)
    effect.hfx.path_position = float(values[at])
    effect.keyframe_insert(paths.POSITION)


def _shortest(first: F64, last: F64) -> F64:
    found = paths.skin().straight(np.stack([first, last]))
    return found if len(found) > 1 else np.stack([first, last])


def _unroll(curve: bpy.types.FCurve, values: F64, old: F64, scale: float) -> None:
    """Recompute keys that ascend with time, where the old values went back and forth."""
    signs = np.sign(np.diff(old))
    into = np.concatenate([[1.0], signs])
    out_of = np.concatenate([signs, [1.0]])
    for key, before, after in zip(curve.keyframe_points, into, out_of, strict=True):
        if before * after < 0.0:  # a turning point: it still rests there for a moment
            key.handle_left_type = key.handle_right_type = "ALIGNED"
            key.handle_left[1] = key.handle_right[1] = key.co[1]
    _set_values(curve, values.tolist(), (into * scale).tolist(), (out_of * scale).tolist())


def _set_values(
    curve: bpy.types.FCurve, values: list[float], into: list[float], out_of: list[float]
) -> None:
    """Give keys other values; the offsets of their handles are scaled, left and right."""
    points = zip(curve.keyframe_points, values, into, out_of, strict=True)
    for key, value, left, right in points:
        offsets = (key.handle_left[1] - key.co[1], key.handle_right[1] - key.co[1])
        key.co[1] = value
        key.handle_left[1] = value + left * offsets[0]
        key.handle_right[1] = value + right * offsets[1]
    curve.update()
