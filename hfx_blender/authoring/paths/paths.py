# SPDX-License-Identifier: GPL-3.0-or-later
"""Points on the skin and their paths: creation, storage with the effect, motion.

A path lies on the skin of the canonical body (rest space, metres), and is valid for every avatar.
The position is the property ``path_position``. The F-curve is the motion, with Blender's easing and
looping.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy

from ...blender import compat
from ...blender.scene_info import animation_fps, metres_of
from ...errors import InputError
from .. import clips
from ..effects import effects
from .path_file import KINDS, MAX_POINTS, PathRecipe
from .skin_picking import SKIN_MODEL, Anchors

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ...engine.arrays import F64
    from ...engine.body.skin_path import SkinPaths


PATH = "hfx_path"
KNOTS = "hfx_path_knots"
"""ID properties: the path and its control points, as flat lists of metres."""

OWN = "hfx_path_own"
"""ID property: number of path points without a temporary extension, see :func:`own_path`."""

KIND = "hfx_path_kind"
CLOSED = "hfx_path_closed"

POSITION = "hfx.path_position"

RADIUS_M = 0.03

_skin: SkinPaths | None = None


def skin() -> SkinPaths:
    """Path search on the skin of the canonical body, created at the first call."""
    from ...engine.body.model import load_model
    from ...engine.body.skin_path import SkinPaths

    # Search trees and graphs of the skin are built at the first path only.
    global _skin
    if _skin is None:
        model = load_model(SKIN_MODEL)
        _skin = SkinPaths(model.vertices, model.triangles)
    return _skin


def add_spot(
    scene: bpy.types.Scene, modality: str, body: bpy.types.Object, name: str | None = None
) -> bpy.types.Object:
    """Add a point on the skin of a body: a disc of 3 cm radius, without a position and path.

    Raises InputError for an object that is no body, and for wind.
    """
    if body.hfx.role != "BODY":
        raise InputError(f"'{body.name}' is not a haptic body.")
    if modality == "wind":
        raise InputError("Wind is not felt at a point; choose another modality.")
    effect = effects.add_on_body(scene, modality, body, "SPOT", name or f"{modality.title()} Point")
    effect.hfx.radius = RADIUS_M / metres_of(scene)
    effect.hfx.falloff = "smooth"
    return effect


def move_to_path(effect: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
    """Move an effect's object, which marks the effect, to the start of the path on the posed body.
    No effect without a body, or with a parent."""
    body = effect.hfx.body
    if body is not None and effect.parent is None:
        effect.location = Anchors.of(path_of(effect)[:1]).posed_on(body, depsgraph)[0][0].tolist()


def path_of(effect: bpy.types.Object) -> F64:
    """Stored path of an effect, (n, 3) metres in rest space of the canonical body, (0, 3) without a
    path; InputError if damaged."""
    return _points(effect, PATH)


def own_path(effect: bpy.types.Object) -> F64:
    """Stored path without its temporary extension, (n, 3) metres in rest space; (0, 3) without a
    path. Raises InputError: the stored path is damaged."""
    path = path_of(effect)
    own = effect.get(OWN, 0)
    return path[:own] if isinstance(own, int) and 0 < own < len(path) else path


def knots_of(effect: bpy.types.Object) -> F64:
    """Control points of a path, (k, 3) metres in rest space; all points of the path if none are
    stored. Raises InputError: the stored points are damaged."""
    knots = _points(effect, KNOTS)
    return knots if len(knots) else path_of(effect)


def _points(effect: bpy.types.Object, key: str) -> F64:
    """Points (n, 3) of a custom property of 3 n numbers, (0, 3) without it; else InputError."""
    import numpy as np

    try:
        # A property of another type counts as an invalid path, reported below.
        flat = np.array(effect.get(key, []), np.float64)
    except (TypeError, ValueError):
        flat = np.array([np.nan])
    if flat.ndim != 1 or flat.size % 3 or not np.isfinite(flat).all():
        raise InputError(
            f"Effect '{effect.name}': its path is not a list of places; draw it again."
        )
    return flat.reshape(-1, 3)


def check_editable(effect: bpy.types.Object) -> None:
    """Raise InputError for the path of a linked or overridden effect, as edits are not saved."""
    if effect.library is not None or effect.override_library is not None:
        source = effect.library or effect.override_library.reference.library
        raise InputError(
            f"The path of '{effect.name}' belongs to {bpy.path.basename(source.filepath)}, and "
            "changes are not saved here: make the effect local (Object > Relations > Make "
            "Local), or draw it in that file."
        )


def set_path(effect: bpy.types.Object, path: F64, knots: F64 | None = None) -> None:
    """Store a path (n, 3) on the skin with control points (None: all points); no extension stays.

    Raises InputError: the effect is no point on the skin or belongs to another file, n is not 1 to
    100,000, or a point is not finite.
    """
    import numpy as np

    check_editable(effect)
    if effect.hfx.kind != "SPOT":
        raise InputError(f"'{effect.name}' is not a point on the skin.")
    path = np.asarray(path, np.float64).reshape(-1, 3)
    if not 0 < len(path) <= MAX_POINTS or not np.isfinite(path).all():
        raise InputError(f"Effect '{effect.name}': a path has 1 to {MAX_POINTS} places.")
    effect[PATH] = path.ravel().tolist()
    # A new path has no extension.
    if OWN in effect:
        del effect[OWN]
    effect[KNOTS] = np.asarray(path if knots is None else knots, np.float64).ravel().tolist()
    effect.update_tag()


def draw(
    effect: bpy.types.Object, places: ArrayLike, *, kind: str = "straight", closed: bool = False
) -> float:
    """Give an effect a path through points (n, 3) on the skin; return the length in metres.

    The points are in the rest space of the canonical body; a single point is a resting position.
    ``kind`` is "straight" (shortest paths), "curve" or "traced" (point after point); ``closed``
    returns to the first point. Raises InputError: a point is not on the body.
    """
    knots, path = through(places, kind, closed)
    # The control points allow drawing again with another method.
    set_path(effect, path, knots)
    effect[KIND], effect[CLOSED] = kind, int(closed)
    return length_m(effect)


def through(places: ArrayLike, kind: str, closed: bool = False) -> tuple[F64, F64]:
    """Points projected onto the skin (n, 3), and a path (m, 3) through these, rest space;
    parameters of :func:`draw`, any other kind as "traced". InputError for a point not on the
    body."""
    import numpy as np

    # "curve" and "straight" follow the surface; "traced" joins projected points directly.
    knots = skin().on_skin(places)
    if kind == "curve":
        return knots, skin().curve(knots, closed)
    if kind == "straight":
        return knots, skin().straight(knots, closed)
    return knots, skin().traced(np.concatenate([knots, knots[:1]]) if closed else knots)[0]


def length_m(effect: bpy.types.Object) -> float:
    """Length of an effect's path without the extension, metres in rest space; 0 without a path.
    Raises InputError: the stored path is damaged."""
    from ...engine.areas.spot import lengths_along

    path = own_path(effect)
    return float(lengths_along(path)[-1]) if len(path) else 0.0


def record(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    places: Sequence[Sequence[float]],
    times_s: Sequence[float],
    frame: float,
) -> None:
    """Convert a recorded motion into a path and keyframes of the position.

    The points ``places`` (n, 3) are on the skin, ``times_s`` (n,) ascend and start at ``frame``.
    Raises InputError: a point is not on the body, or the times do not ascend.
    """
    import numpy as np

    times = np.asarray(times_s, np.float64)
    if len(times) != len(places) or (np.diff(times) < 0.0).any() or not np.isfinite(times).all():
        raise InputError("A recording needs a time for each place, in order.")
    knots = skin().on_skin(places)
    # The speed of the hand is in the keyframes, so they are linear.
    path, shares = skin().traced(knots)
    set_path(effect, path, knots)
    effect[KIND], effect[CLOSED] = "traced", 0
    frames = frame + (times - times[0]) * animation_fps(scene)
    set_motion(effect, list(zip(frames.tolist(), shares.tolist(), strict=True)), "LINEAR")


def set_motion(
    effect: bpy.types.Object, keys: Sequence[tuple[float, float]], interpolation: str = "BEZIER"
) -> None:
    """Replace the keyframes of an effect's position by (frame, share of the path) pairs."""
    curve = compat.own_fcurve(effect, POSITION, "Motion")
    compat.set_keys(curve, keys, interpolation)
    effect.update_tag()


def motion_of(effect: bpy.types.Object) -> bpy.types.FCurve | None:
    """F-curve of an effect's position; None if missing."""
    return compat.fcurve_of(effect, POSITION)


def reverse(effect: bpy.types.Object) -> None:
    """Reverse path and control points. Keyframes are unchanged: the motion runs backwards.

    A temporary extension becomes part of the path, so callers remove an extension first.
    """
    set_path(effect, path_of(effect)[::-1], knots_of(effect)[::-1])


def mirror(effect: bpy.types.Object) -> None:
    """Mirror path and control points at the body's middle, x -> -x; see :func:`reverse`."""
    import numpy as np

    mirrored = np.array([-1.0, 1.0, 1.0])
    set_path(effect, path_of(effect) * mirrored, knots_of(effect) * mirrored)


def recipe_of(scene: bpy.types.Scene, effect: bpy.types.Object, name: str) -> PathRecipe:
    """Control points and motion of an effect, for a path file; InputError without a path.

    A path of unknown kind is "traced". Points are rounded to micrometres.
    """
    import numpy as np

    knots = knots_of(effect)
    if not len(knots):
        raise InputError(f"'{effect.name}' has no path yet.")
    kind = str(effect.get(KIND, "traced"))
    return PathRecipe(
        name=name,
        points_m=tuple((x, y, z) for x, y, z in np.round(knots, 6).tolist()),
        kind=kind if kind in KINDS else "traced",
        is_closed=bool(effect.get(CLOSED, 0)),
        motion=motion_keys(scene, effect),
    )


def motion_keys(
    scene: bpy.types.Scene, effect: bpy.types.Object, first: float | None = None
) -> tuple[tuple[float, float], ...]:
    """Keyframes of an effect's position as (seconds, share of the path), relative to a frame.

    ``first`` None: the first keyframe. Linear keyframes are exact, further curves are sampled.
    Without an action, keyframes of the effect's clips are used.
    """
    from ...engine.areas.spot import lengths_along

    curve = motion_of(effect)
    if curve is None or not len(curve.keyframe_points):
        strips = sorted((s for _, s in clips.strips_of(effect)), key=lambda s: s.frame_start)
        keys = [key for strip in strips for key in clips.keys_in(strip, POSITION)]
    else:
        keys = clips.linear_keys(curve)
    # Times count from the given frame, else from the first keyframe; earlier keyframes are at 0.
    start = keys[0][0] if first is None and keys else first or 0.0
    stretch = 1.0
    if OWN in effect and len(path_of(effect)):
        # Shares of a temporarily extended path are converted to shares of the path itself.
        stretch = float(lengths_along(path_of(effect))[-1]) / max(length_m(effect), 1e-12)
    shares = ((frame, share * stretch) for frame, share in keys)
    return clips.timed_shares(shares, start, animation_fps(scene))


def apply(
    scene: bpy.types.Scene, effect: bpy.types.Object, recipe: PathRecipe, frame: float
) -> float:
    """Draw a recipe's path; return the length in metres. A motion in the recipe replaces the
    keyframes, and starts at ``frame``; without a motion, keyframes stay."""
    length = draw(effect, recipe.points_m, kind=recipe.kind, closed=recipe.is_closed)
    if recipe.motion:
        fps = animation_fps(scene)
        set_motion(effect, [(frame + t * fps, share) for t, share in recipe.motion], "LINEAR")
    return length
