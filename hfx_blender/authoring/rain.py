# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain as an effect type with meaningful parameters: it makes the single drops.

Many small painted taps, each somewhere on the skin that looks up, at random times. The same
seed rains the same.
"""

from __future__ import annotations

import random
from math import ceil

import bpy
import numpy as np

from ..engine.body.model import PerceptualModel, load_model
from ..engine.body.parts import PARTS
from ..errors import InputError
from ..scene_units import fps_of
from . import clips, effects

GENERATOR = "hfx_rain"
"""ID property of everything that one shower made: its name."""

MAX_SPOTS = 64
"""Places that drops fall on; more drops than that share them."""

_PARTS = ("head", "upper_arm", "forearm", "hand_dorsum")
_DROP_S = 0.06
_FADE_S = 0.04


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
    """Make the effects of a shower; replaces one of the same name on the same body.

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
    centres = _places(model, min(count, MAX_SPOTS), chance)
    times = sorted(chance.uniform(0.0, max(duration_s - _DROP_S, 0.0)) for _ in range(count))
    fps = fps_of(scene)
    made = []
    for number, centre in enumerate(centres):
        effect = effects.add_painted(scene, "vibration", body, f"{name} {number + 1:02d}")
        effect[GENERATOR] = effect.hfx.group = name
        effect.hfx.amplitude = strength_m_s2
        effect.hfx.frequency = 160.0
        vertices = _drop(model, centre, drop_size_m)
        effects.set_area(effect, vertices.tolist(), [1.0] * len(vertices))
        last = -1.0
        for time in times[number :: len(centres)]:
            time = max(time, last)  # two drops on one spot fall one after the other
            last = time + _DROP_S
            start = frame + time * fps
            clips.add_clip(
                effect, start, start + _DROP_S * fps, name="Drop", fade_out=_FADE_S * fps
            )
        made.append(effect)
    return made


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


def _drop(model: PerceptualModel, centre: int, size_m: float) -> np.ndarray:
    """Vertices of the same part and side within half a drop's size, the centre at least."""
    offset = model.vertices - model.vertices[centre]
    near = np.einsum("vi,vi->v", offset, offset) <= (0.5 * size_m) ** 2
    near &= (model.part == model.part[centre]) & (model.side == model.side[centre])
    near[centre] = True
    return np.flatnonzero(near)
