# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``library``: the nearest procedural material, steered by the words; works offline."""

from __future__ import annotations

from dataclasses import asdict
from typing import Final

import numpy as np

from ..engine.texture import procedural
from ..engine.texture.haptic_map import NoticeableSteps
from ..engine.texture.mcha import MapSettings, make_map
from .generated import Generated, name_of
from .interpretation import Interpretation, read_words
from .steering import Steering, albedo, steered
from .surface_words import COLOURS

NAME: Final = "library"
_LEAST_FACTOR: Final = 0.2
_MOST_FACTOR: Final = 5.0
"""Bounds of the factors of size and depth by words."""


def generate(
    words: str,
    *,
    negative: str = "",
    seed: int = 0,
    texels: int = 512,
    steps: NoticeableSteps | None = None,
) -> Generated:
    """Generate a surface from words and unwanted words; equal arguments give equal arrays.

    ``texels``: number along each side, at least 16. ``steps``: quantization of the haptic map;
    None: no quantization. Raises InputError if no word names a material, or a size is outside the
    range of touch.
    """
    meaning = read_words(words, negative)
    # Shape and colour may come from different words: brushed steel has the finish of brushed and
    # the colour of steel.
    shape, strongest = meaning.choose()
    material = procedural.material(shape.material)
    # A stated size replaces all words about size.
    scale = float(np.clip(meaning.scale, _LEAST_FACTOR, _MOST_FACTOR)) * shape.scale
    steering = Steering(
        scale if meaning.period_m is None else meaning.period_m / material.period_m,
        float(np.clip(meaning.depth, _LEAST_FACTOR, _MOST_FACTOR)) * shape.depth,
        meaning.wear,
        meaning.roughness,
        meaning.direction_deg or 0,
        meaning.draft,
    ).clipped()
    field, roughness = steered(material, steering, texels, seed)
    if meaning.depth_m is not None:
        # A stated depth replaces the material's own.
        factor = meaning.depth_m / float(np.ptp(field.heights_m))
        field = type(field)(field.heights_m * factor, field.texel_m, field.tiles)
    # The colour of the words, or the usual colour of the material.
    colour = meaning.colour or strongest.meaning.colour
    picture = albedo(
        shape.kind, field, COLOURS[colour], meaning.light, seed, steering.direction_deg
    )
    notes = _notes(meaning, strongest.word, material)
    record = {
        "words": words,
        "negative_words": negative,
        "seed": seed,
        "back_end": NAME,
        "searched_not_painted": True,
        "kind": material.kind,
        "material": material.name,
        "steering": {**asdict(steering), "colour": colour, "light": meaning.light},
        "understood": dict(meaning.understood),
        "unknown_words": list(meaning.unknown),
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


def _notes(
    meaning: Interpretation, word: str, material: procedural.ProceduralMaterial
) -> tuple[str, ...]:
    """Sentences about the nearest material of ``word``, and unknown and corrected words."""
    notes = [
        f"the library was searched, nothing was painted: nearest to '{word}' is "
        f"'{material.title}' ({material.kind}), steered by the other words"
    ]
    if meaning.unknown:
        notes.append(f"words that are not known: {', '.join(meaning.unknown)}")
    corrected = [
        f"'{word}' {note}" for word, note in meaning.understood.items() if "read as" in note
    ]
    if corrected:
        notes.append("; ".join(corrected))
    return tuple(notes)
