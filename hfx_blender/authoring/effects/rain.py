# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain generator: points on the skin with short taps at random times and positions, in one clip.

Drops fall on skin that faces upwards. Equal seeds give equal rain.
"""

import random
from math import ceil, floor

import bpy
import numpy as np

from ...blender.scene_info import animation_fps, metres_of
from ...engine.body.model import PerceptualModel, load_model
from ...engine.body.parts import PARTS
from ...errors import InputError
from .. import clips
from ..paths import paths
from . import effects

GENERATOR = "hfx_rain"  # ID property of the effects of one rain: its name
MAX_PLACES = 64  # largest number of different drop positions
_PARTS = ("head", "upper_arm", "forearm", "hand_dorsum")
_DROP_S = 0.06
_RISE_S, _FADE_S = 0.002, 0.04
_PAUSE_S = 0.005  # shortest pause between two drops of an effect
_MOST_BUSY = 0.7
"""Largest share of time with a drop in one effect; further drops go to further effects."""


def add_rain(
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
    """Add the effect of a rain, or several effects if drops would overlap in time.

    An earlier rain of the same name on the same body is removed.

    Raises InputError: the number of drops is not 1 to 5000, or no body part for rain faces upwards.
    """
    count = round(drops_per_second * duration_s)
    if not 1 <= count <= 5000:
        raise InputError(
            f"{drops_per_second:g} drops a second for {duration_s:g} s are {count} drops; allowed "
            "are 1 to 5000."
        )
    remove(body, name)
    model = load_model(effects.model_id_for("vibration", body))
    generator = random.Random(seed)
    remaining = _draw_vertices(model, min(count, MAX_PLACES), generator)
    # Each position is followed by the nearest remaining one: short jumps keep the path, and so its
    # storage, short.
    ordered = [remaining.pop(0)]
    while remaining:
        distances = np.linalg.norm(model.vertices[remaining] - model.vertices[ordered[-1]], axis=1)
        ordered.append(remaining.pop(int(np.argmin(distances))))
    centres = model.vertices[ordered]
    knots = paths.skin().on_skin(centres.astype(np.float64))
    path, shares = paths.skin().traced(knots)
    # A Poisson process with a given number of events: independent uniform times, sorted.
    times = sorted(generator.uniform(0.0, duration_s) for _ in range(count))
    drops = [(time, generator.choice(shares.tolist())) for time in times]
    # Drops are dealt out in turn, so that each effect has time between its drops.
    number = ceil(count / max(floor(_MOST_BUSY * duration_s / (_DROP_S + _PAUSE_S)), 1))
    created = []
    for k in range(number):
        title = name if number == 1 else f"{name} {k + 1:02d}"
        effect = paths.add_spot(scene, "vibration", body, title)
        effect[GENERATOR] = effect.hfx.group = name
        effect.hfx.amplitude, effect.hfx.frequency = strength_m_s2, 160.0
        effect.hfx.radius, effect.hfx.falloff = 0.5 * drop_size_m / metres_of(scene), "none"
        paths.set_path(effect, path, knots)
        effect[paths.KIND], effect[paths.CLOSED] = "traced", 0
        _add_clip(scene, effect, frame, _without_overlaps(drops[k::number], duration_s), duration_s)
        created.append(effect)
    return created


def _without_overlaps(
    drops: list[tuple[float, float]], duration_s: float
) -> list[tuple[float, float]]:
    """Delay sorted drops (start in seconds, path position) to starts at least 65 ms apart; late
    drops move forward to end within ``duration_s``."""
    starts = np.array([time for time, _ in drops])
    slots = np.arange(len(drops)) * (_DROP_S + _PAUSE_S)
    # Without the slots, drop k may start as soon as drop k - 1 starts: a running maximum.
    starts = np.maximum.accumulate(starts - slots) + slots
    latest = duration_s - _DROP_S - slots[::-1]
    return list(
        zip(np.minimum(starts, latest).tolist(), [position for _, position in drops], strict=True)
    )


def _add_clip(
    scene: bpy.types.Scene,
    effect: bpy.types.Object,
    frame: float,
    drops: list[tuple[float, float]],
    duration_s: float,
) -> None:
    """Add one clip from ``frame`` with all taps of an effect: per drop (start in seconds, path
    position) a pulse of 60 ms in the activation, and two keys of the position."""
    fps = animation_fps(scene)
    levels, positions = [(0.0, 0.0)], []
    for start, share in drops:
        # Two keys of a curve cannot share a time, and the clip has a key at 0.
        start = max(start, 1e-3)
        for delay, level in ((0.0, 0.0), (_RISE_S, 1.0), (_DROP_S - _FADE_S, 1.0), (_DROP_S, 0.0)):
            levels.append(((start + delay) * fps, level))
        positions += [(start * fps, share), ((start + _DROP_S) * fps, share)]
    # Silence up to the end of the rain.
    if levels[-1][0] < duration_s * fps:
        levels.append((duration_s * fps, 0.0))
    clips.add_clip(
        effect,
        frame,
        frame + levels[-1][0],
        name=str(effect[GENERATOR]),
        profile=levels,
        curves={paths.POSITION: positions},
    )


def remove(body: bpy.types.Object, name: str) -> int:
    """Remove the effects of a body's rain by name; return their number."""
    generated = [
        obj
        for obj in bpy.data.objects
        if obj.get(GENERATOR) == name and obj.hfx.role == "EFFECT" and obj.hfx.body == body
    ]
    for effect in generated:
        bpy.data.objects.remove(effect)
    return len(generated)


def _draw_vertices(model: PerceptualModel, count: int, generator: random.Random) -> list[int]:
    """Draw ``count`` different vertex ids of head, arms and backs of hands, weighted by area seen
    from above; fewer if fewer face up, InputError without any."""
    # Upward area: cosine of the normal with the sky, times the area of the vertex.
    sky_area = np.maximum(model.normals[:, 2].astype(np.float64), 0.0) * model.areas_m2
    sky_area[~np.isin(model.part, [PARTS.index(part) for part in _PARTS])] = 0.0
    if not sky_area.any():
        raise InputError("Rain needs at least one body part that it can fall on.")
    weights = sky_area.tolist()
    candidates = min(count, int(np.count_nonzero(sky_area)))
    drawn: dict[int, None] = {}
    while len(drawn) < candidates:
        for vertex in generator.choices(range(len(model)), weights, k=ceil(candidates)):
            drawn.setdefault(vertex)
            if len(drawn) == candidates:
                break
    return list(drawn)
