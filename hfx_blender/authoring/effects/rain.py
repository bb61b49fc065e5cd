# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain as an effect type with meaningful parameters: a point on the skin that jumps about.

Short taps on the skin that looks up, at random times and places, in one clip. The same seed rains
the same.
"""

from __future__ import annotations

import random
from math import ceil, floor

import bpy
import numpy as np

from ...blender.scene_info import fps_of, metres_of
from ...engine.body.model import PerceptualModel, load_model
from ...engine.body.parts import PARTS
from ...errors import InputError
from ..clips import clips
from ..paths import paths
from . import effects

GENERATOR = "hfx_rain"
"""ID property of everything that one shower made: its name."""

MAX_PLACES = 64
"""Places that drops fall on; more drops than that share them."""

_PARTS = ("head", "upper_arm", "forearm", "hand_dorsum")
_DROP_S = 0.06
_RISE_S, _FADE_S = 0.002, 0.04
_PAUSE_S = 0.005  # at least, from the end of a drop to the next one of its effect
_MOST_BUSY = 0.7
"""Share of the time in which an effect may have a drop; more drops are divided among several."""


def make(
    scene: bpy.types.Scene,
    body: bpy.types.Object,
    *,
    name: str = "Rain",
    drops_per_second: float = 8.0,
    drop_size_m: float = 0.02,
    frame: float = 0.0,
    duration_s: float = 4.0,
    strength_m_s2: float = 5.0,
    seed: int = 0,
) -> list[bpy.types.Object]:
    """Make the effect of a shower, or several where drops fall so often that they overlap.

    It replaces one of the same name on the same body.

    Raises
    ------
    InputError
        Too few or too many drops, or none of the parts that rain falls on looks up.
    """
    count = round(drops_per_second * duration_s)
    if not 1 <= count <= 5000:
        raise InputError(
            f"{drops_per_second:g} drops a second for {duration_s:g} s are {count} drops; allowed "
            "are 1 to 5000."
        )
    remove(body, name)
    model = load_model(effects.model_id_for("vibration"))
    chance = random.Random(seed)
    centres = model.vertices[_nearest_order(model, _places(model, min(count, MAX_PLACES), chance))]
    knots = paths.skin().on_skin(centres.astype(np.float64))
    path, shares = paths.skin().traced(knots)
    times = sorted(chance.uniform(0.0, duration_s) for _ in range(count))
    drops = [(time, chance.choice(shares.tolist())) for time in times]
    number = ceil(count / max(floor(_MOST_BUSY * duration_s / (_DROP_S + _PAUSE_S)), 1))
    made = []
    for k in range(number):
        title = name if number == 1 else f"{name} {k + 1:02d}"
        effect = paths.add_spot(scene, "vibration", body, title)
        effect[GENERATOR] = effect.hfx.group = name
        effect.hfx.amplitude, effect.hfx.frequency = strength_m_s2, 160.0
        effect.hfx.radius, effect.hfx.falloff = 0.5 * drop_size_m / metres_of(scene), "none"
        paths.set_path(effect, path, knots)
        effect[paths.KIND], effect[paths.CLOSED] = "traced", 0
        _add_clip(scene, effect, frame, _spaced(drops[k::number], duration_s), duration_s)
        made.append(effect)
    return made


def _spaced(drops: list[tuple[float, float]], duration_s: float) -> list[tuple[float, float]]:
    """Drops (seconds, place), each after the end of the one before, and all within the rain."""
    starts = np.array([time for time, _ in drops])
    slots = np.arange(len(drops)) * (_DROP_S + _PAUSE_S)
    starts = np.maximum.accumulate(starts - slots) + slots
    latest = duration_s - _DROP_S - slots[::-1]
    return list(zip(np.minimum(starts, latest).tolist(), [at for _, at in drops], strict=True))


def _add_clip(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    frame: float,
    drops: list[tuple[float, float]],
    duration_s: float,
) -> None:
    """Put one clip with all taps of an effect on its timeline; their places are in it, too."""
    fps = fps_of(scene)
    levels, places = [(0.0, 0.0)], []
    for start, share in drops:
        start = max(start, 1e-3)  # after the clip's first key
        for past, level in ((0.0, 0.0), (_RISE_S, 1.0), (_DROP_S - _FADE_S, 1.0), (_DROP_S, 0.0)):
            levels.append(((start + past) * fps, level))
        places += [(start * fps, share), ((start + _DROP_S) * fps, share)]
    if levels[-1][0] < duration_s * fps:
        levels.append((duration_s * fps, 0.0))
    clips.add_clip(
        effect,
        frame,
        frame + levels[-1][0],
        name=str(effect[GENERATOR]),
        profile=levels,
        curves={paths.POSITION: places},
    )


def _nearest_order(model: PerceptualModel, places: list[int]) -> list[int]:
    """Places in an order in which each is followed by the nearest one that is left."""
    found, left = places[:1], places[1:]
    while left:
        ways = np.linalg.norm(model.vertices[left] - model.vertices[found[-1]], axis=1)
        found.append(left.pop(int(np.argmin(ways))))
    return found


def remove(body: bpy.types.Object, name: str) -> int:
    """Remove the effects of a shower; how many there were."""
    found = [
        obj
        for obj in bpy.data.objects
        if obj.get(GENERATOR) == name and obj.hfx.role == "EFFECT" and obj.hfx.body == body
    ]
    for effect in found:
        bpy.data.objects.remove(effect)
    return len(found)


def _places(model: PerceptualModel, count: int, chance: random.Random) -> list[int]:
    """Draw vertices for raindrops, each as likely as its share of the visible sky."""
    seen = np.maximum(model.normals[:, 2].astype(np.float64), 0.0) * model.areas_m2
    seen[~np.isin(model.part, [PARTS.index(part) for part in _PARTS])] = 0.0
    if not seen.any():
        raise InputError("Rain needs at least one body part that it can fall on.")
    weights = seen.tolist()
    candidates = min(count, int(np.count_nonzero(seen)))
    found: dict[int, None] = {}
    while len(found) < candidates:
        for vertex in chance.choices(range(len(model)), weights, k=ceil(candidates)):
            found.setdefault(vertex)
            if len(found) == candidates:
                break
    return list(found)
