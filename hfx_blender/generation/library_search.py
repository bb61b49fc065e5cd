# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``library``: the nearest procedural material, steered by the words. Offline, at once.

It searches and steers; it paints nothing that the library has not.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Final

import numpy as np

from ..engine.texture import procedural
from ..engine.texture.device_range import NoticeableSteps
from ..engine.texture.mcha import MapSettings, make_map
from .albedo import albedo
from .generated import Generated, name_of
from .material_words import COLOURS, MaterialWord
from .steering import Steering, steered
from .wish import Wish, read_words

NAME: Final = "library"
_LEAST_FACTOR: Final = 0.2
_MOST_FACTOR: Final = 5.0
"""Bounds of what words alone do to size and depth."""


def generate(
    words: str,
    *,
    negative: str = "",
    seed: int = 0,
    texels: int = 512,
    steps: NoticeableSteps | None = None,
) -> Generated:
    """Surface of a wish: same words, seed and size, same arrays.

    Raises
    ------
    InputError
        No word names a material.
    """
    wish = read_words(words, negative)
    shape, strongest = wish.choose()
    material = procedural.material(shape.material)
    steering = _steering(wish, shape, material)
    field, roughness = steered(material, steering, texels, seed)
    if wish.depth_m is not None:
        factor = wish.depth_m / float(np.ptp(field.heights_m))
        field = type(field)(field.heights_m * factor, field.texel_m, field.tiles)
    colour = wish.colour or strongest.meaning.colour
    picture = albedo(shape.kind, field, COLOURS[colour], wish.light, seed, steering.direction_deg)
    notes = _notes(wish, strongest.word, material)
    record = {
        "words": words,
        "negative_words": negative,
        "seed": seed,
        "back_end": NAME,
        "searched_not_painted": True,
        "kind": material.kind,
        "material": material.name,
        "steering": {**asdict(steering), "colour": colour, "light": wish.light},
        "understood": dict(wish.understood),
        "unknown_words": list(wish.unknown),
        "versions": {},
    }
    return Generated(
        name_of(words, str(seed)),
        picture,
        field,
        roughness,
        make_map(field, roughness, MapSettings(steps=steps)),
        record,
        is_metal=material.kind == "metal",
        notes=notes,
    )


def _steering(wish: Wish, shape: MaterialWord, material: procedural.ProceduralMaterial) -> Steering:
    scale = float(np.clip(wish.scale, _LEAST_FACTOR, _MOST_FACTOR)) * shape.scale
    if wish.period_m is not None:
        scale = wish.period_m / material.period_m
    return Steering(
        scale,
        float(np.clip(wish.depth, _LEAST_FACTOR, _MOST_FACTOR)) * shape.depth,
        wish.wear,
        wish.roughness,
        wish.direction_deg or 0,
        wish.draft,
    ).clipped()


def _notes(wish: Wish, word: str, material: procedural.ProceduralMaterial) -> tuple[str, ...]:
    notes = [
        f"the library was searched, nothing was painted: nearest to '{word}' is "
        f"'{material.title}' ({material.kind}), steered by the other words"
    ]
    if wish.unknown:
        notes.append(f"words that are not known: {', '.join(wish.unknown)}")
    corrected = [f"'{word}' {note}" for word, note in wish.understood.items() if "read as" in note]
    if corrected:
        notes.append("; ".join(corrected))
    return tuple(notes)
