# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``library``: the nearest procedural material, steered by the words; works offline.

Steering changes size, depth, wear, direction, weave and colour of the material.
"""

from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np

from ..engine.arrays import F64, U8
from ..engine.texture import procedural
from ..engine.texture.haptic_map import NoticeableSteps
from ..engine.texture.height_field import HeightField
from ..engine.texture.mcha import MapSettings, make_map
from ..engine.texture.procedural import ProceduralMaterial, Weave, noise, woven
from ..engine.texture.relief.linear_light import linear_to_srgb, srgb_to_linear
from .generated import Generated, name_of
from .interpretation import Interpretation, read_words
from .surface_words import COLOURS

NAME: Final = "library"
_LEAST_FACTOR: Final = 0.2
_MOST_FACTOR: Final = 5.0  # bounds of the factors of size and depth by words
_LEAST: Final = 0.03
_MOST: Final = 30.0  # bounds of the factors of size and depth
_THREADS: Final = 40  # along the side of a tile with a chosen weave
_WORN_FLAT: Final = 0.85  # share of the height above the median that full wear removes
_WARM: Final = (1.0, 0.0, -1.0)


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


@dataclass(frozen=True)
class Steering:
    """Differences from a library material."""

    scale: float = 1.0  # factor of all lengths, heights included: slopes stay
    depth: float = 1.0  # further factor of heights
    wear: float = 0.0  # 0 new, 1 heights above the median worn flat, below 0 raised
    roughness: float = 0.0  # added to the roughness, 0..1
    direction_deg: int = 0  # rotation: 0, 45 or 90
    draft: str | None = None  # key of procedural.DRAFTS, in place of the material's relief

    def clipped(self) -> "Steering":
        """Copy with scale and depth clipped to 0.03..30, wear and roughness to -1..1."""
        return replace(
            self,
            scale=float(np.clip(self.scale, _LEAST, _MOST)),
            depth=float(np.clip(self.depth, _LEAST, _MOST)),
            wear=float(np.clip(self.wear, -1.0, 1.0)),
            roughness=float(np.clip(self.roughness, -1.0, 1.0)),
        )


def steered(
    material: ProceduralMaterial, steering: Steering, texels: int, seed: int
) -> tuple[HeightField, F64]:
    """Heights, and roughness 0..1 (N, N), of a steered material; N = ``texels``. The result tiles.
    Raises InputError: fewer than 16 texels."""
    steering = steering.clipped()
    field, roughness = material.make(texels, seed)
    if steering.draft is not None:
        # Cloth as deep as the relief without its rarest heights, with random fibres of 4 %.
        size = field.size_m[0]
        thread_m = size / _THREADS
        depth = float(np.ptp(np.quantile(field.heights_m, (0.02, 0.98))))
        cloth = woven(Weave(steering.draft, thread_m, max(depth, 1e-6)), size, texels)
        # Each draft has fibres of its own; equal arguments give equal fibres.
        rng = np.random.default_rng([seed, *steering.draft.encode()])
        fibres = 0.04 * depth * noise(rng, texels, size, 8.0 * thread_m, 0.3 * thread_m)
        field = HeightField(cloth.heights_m + fibres, cloth.texel_m)
    # Wear removes tops only: the gaps below the median stay as deep as they were.
    heights = field.heights_m
    middle = float(np.median(heights))
    above = np.maximum(heights - middle, 0.0)
    heights = heights - _WORN_FLAT * steering.wear * above
    heights = heights * (steering.scale * steering.depth)
    texel = field.texel_m[0] * steering.scale
    heights, roughness = (turned(grid, steering.direction_deg) for grid in (heights, roughness))
    # Rows of the turned tile are diagonals, with longer texels.
    if steering.direction_deg == 45:
        texel *= float(np.sqrt(2.0))
    heights = heights - heights.min()
    rough = np.clip(roughness + steering.roughness, 0.0, 1.0)
    return HeightField(heights, (texel, texel)), rough


def turned(values: F64, direction_deg: int) -> F64:
    """Rotate a tile (N, N) by 0, 45 or 90 degrees without interpolation; other angles: unchanged.
    Rows of the result at 45 degrees are diagonals of the tile: the result contains the tile twice,
    and its texels are longer by the square root of 2."""
    if direction_deg == 90:
        return values.T
    if direction_deg != 45:
        return values
    count = len(values)
    # Both diagonals of a tile close after N steps, so the turned tile repeats without
    # interpolation.
    i, j = np.meshgrid(np.arange(count), np.arange(count))
    return np.asarray(values[(j - i) % count, (i + j) % count])


@dataclass(frozen=True)
class _Look:
    """Variation of the colour within a kind of material, as shares of its linear light."""

    gaps: float  # darkening of the lowest texels
    patches: float  # RMS of patches of the size of features
    tint: float  # RMS between warm and cool
    speckle: float  # RMS of single texels
    stretch: float  # factor of the patches' length along x


_LOOKS: Final = {
    "gravel": _Look(0.75, 0.22, 0.05, 0.08, 1.0),
    "metal": _Look(0.3, 0.04, 0.01, 0.02, 1.0),
    "fabric": _Look(0.55, 0.06, 0.01, 0.06, 1.0),
    "wood": _Look(0.45, 0.12, 0.05, 0.05, 12.0),
}


def albedo(
    kind: str,
    field: HeightField,
    srgb: tuple[float, float, float],
    light: float,
    seed: int,
    direction_deg: int = 0,
) -> U8:
    """Colour picture (N, N, 3) of a surface, 8 bit sRGB, bottom row first; darker in gaps, tiling.

    ``kind`` is an entry of :data:`.procedural.KINDS`, ``field`` has heights (N, N), ``srgb`` is the
    colour of the material, 0..1, ``light`` a factor of the linear light, and ``direction_deg`` the
    direction of the grain: 0, 45 or 90.
    """
    # noise() repeats at the edges of the tile, and independent texels have no seam.
    look = _LOOKS[kind]
    # With 17 the sequence differs from that of the relief, so that colours do not repeat heights.
    rng = np.random.default_rng([seed, 17, *kind.encode()])
    texels, size = field.heights_m.shape[0], field.size_m[0]
    patches = noise(rng, texels, size, 0.12 * size, 0.02 * size, stretch=look.stretch)
    warmth = noise(rng, texels, size, 0.4 * size, 0.04 * size, stretch=look.stretch)
    patches, warmth = turned(patches, direction_deg), turned(warmth, direction_deg)
    speckle = rng.standard_normal((texels, texels))
    # Gaps are dark. The rarest heights are left out: a single pit would make all the rest bright.
    low, high = np.quantile(field.heights_m, (0.02, 0.98))
    share = np.ones_like(field.heights_m)
    if high > low:
        share = np.clip((field.heights_m - low) / (high - low), 0.0, 1.0)
    shade = 1.0 - look.gaps * (1.0 - share)
    shade = shade * np.exp(look.patches * patches + look.speckle * speckle) * light
    tinted = 1.0 + look.tint * warmth[..., None] * np.array(_WARM)
    linear = srgb_to_linear(np.array(srgb)) * shade[..., None] * tinted
    return np.rint(255.0 * linear_to_srgb(np.clip(linear, 0.0, 1.0))).astype(np.uint8)
