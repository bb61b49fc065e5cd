# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabularies of colours, materials and qualities; forms and misspellings of words.

Materials are in ``surface_words.csv``; of a word in several rows the first row counts.
"""

from __future__ import annotations

import csv
import difflib
import itertools
import re
import unicodedata
from collections.abc import Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

COLOURS: Final = {
    "grey": (0.50, 0.50, 0.49), "gray": (0.50, 0.50, 0.49), "black": (0.10, 0.10, 0.10),
    "white": (0.90, 0.89, 0.87), "red": (0.66, 0.12, 0.11), "green": (0.20, 0.42, 0.18),
    "blue": (0.16, 0.28, 0.58), "yellow": (0.85, 0.72, 0.20), "orange": (0.82, 0.44, 0.12),
    "purple": (0.40, 0.20, 0.48), "violet": (0.45, 0.25, 0.60), "pink": (0.88, 0.58, 0.64),
    "brown": (0.42, 0.27, 0.16), "beige": (0.76, 0.68, 0.55), "tan": (0.70, 0.57, 0.40),
    "cream": (0.91, 0.86, 0.74), "ivory": (0.92, 0.89, 0.80), "navy": (0.10, 0.13, 0.30),
    "crimson": (0.60, 0.07, 0.16), "scarlet": (0.75, 0.12, 0.08), "maroon": (0.38, 0.08, 0.12),
    "burgundy": (0.40, 0.06, 0.16), "turquoise": (0.22, 0.65, 0.64), "teal": (0.10, 0.42, 0.44),
    "indigo": (0.16, 0.17, 0.40), "charcoal": (0.22, 0.22, 0.23), "khaki": (0.60, 0.55, 0.38),
    "olive": (0.40, 0.40, 0.18), "ochre": (0.74, 0.52, 0.18), "amber": (0.80, 0.52, 0.14),
    "sepia": (0.44, 0.31, 0.20), "magenta": (0.70, 0.16, 0.50), "cyan": (0.20, 0.66, 0.74),
    "lilac": (0.72, 0.62, 0.80), "emerald": (0.10, 0.48, 0.30), "golden": (0.80, 0.62, 0.28),
    "silvery": (0.72, 0.73, 0.74), "coppery": (0.72, 0.43, 0.30), "greyish": (0.52, 0.52, 0.50),
    "sand": (0.76, 0.66, 0.48), "silver": (0.72, 0.73, 0.74), "gold": (0.83, 0.66, 0.32),
    "copper": (0.72, 0.43, 0.30), "bronze": (0.55, 0.40, 0.24), "brass": (0.74, 0.62, 0.35),
    "iron": (0.30, 0.30, 0.31), "steel": (0.62, 0.63, 0.65), "rust": (0.50, 0.25, 0.13),
    "denim": (0.20, 0.28, 0.44), "wool": (0.62, 0.56, 0.48), "jute": (0.62, 0.50, 0.34),
    "wood": (0.56, 0.39, 0.24), "oak": (0.64, 0.48, 0.31), "walnut": (0.36, 0.24, 0.16),
    "mahogany": (0.42, 0.19, 0.12), "pine": (0.79, 0.62, 0.41), "birch": (0.83, 0.72, 0.56),
    "cherry": (0.58, 0.29, 0.18), "driftwood": (0.55, 0.52, 0.48), "cork": (0.68, 0.49, 0.32),
    "slate": (0.33, 0.37, 0.41), "rose": (0.82, 0.50, 0.52), "lavender": (0.68, 0.62, 0.80),
    "mint": (0.62, 0.82, 0.70), "coral": (0.88, 0.46, 0.38), "chocolate": (0.30, 0.18, 0.11),
    "honey": (0.78, 0.55, 0.24), "chestnut": (0.44, 0.23, 0.14), "ebony": (0.14, 0.11, 0.09),
    "snow": (0.94, 0.94, 0.94), "jet": (0.06, 0.06, 0.06), "reddish": (0.56, 0.28, 0.20),
    "bluish": (0.42, 0.48, 0.58), "greenish": (0.42, 0.50, 0.38), "yellowish": (0.78, 0.70, 0.46),
    "brownish": (0.46, 0.35, 0.25), "mossy": (0.34, 0.42, 0.22), "mustard": (0.74, 0.58, 0.16),
}  # fmt: skip
"""sRGB of each colour, 0..1. Material words among the keys are colours before other materials."""


@dataclass(frozen=True)
class MaterialWord:
    """Nearest library material of a word such as "shingle", and the changes of the material."""

    material: str  # key of procedural.MATERIALS
    scale: float  # factor of all lengths
    depth: float  # further factor of heights
    colour: str  # key of COLOURS
    weight: float  # 3 a material, 2 an object or trade name, 1 a finish of several materials

    @property
    def kind(self) -> str:
        """Kind of the material: gravel, metal, fabric or wood."""
        return self.material.partition("-")[0]


WORDS: Final[dict[str, MaterialWord]] = {}
"""Material of each word or phrase; keys are lower case, singular, without hyphens."""

with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _table:
    for _row in csv.DictReader(_table):
        _scale, _depth, _weight = (float(_row[name]) for name in ("scale", "depth", "weight"))
        _entry = MaterialWord(_row["material"], _scale, _depth, _row["colour"], _weight)
        for _word in _row["words"].split(","):
            WORDS.setdefault(_word.strip(), _entry)

LONGEST_PHRASE: Final = max(len(phrase.split()) for phrase in WORDS)


@dataclass(frozen=True)
class Traits:
    """Effect of a quality such as "coarse" on a surface, at degree 1."""

    scale: float = 1.0  # factor of all lengths, heights included
    depth: float = 1.0  # further factor of heights
    wear: float = 0.0  # added to the wear, 0 new to 1 tops worn flat
    roughness: float = 0.0  # added to the roughness, 0..1
    light: float = 1.0  # factor of the colour's linear light


_TABLE: Final = (
    (Traits(scale=1.6), "coarse, big, large, chunky, thick, wide, broad, bulky, heavy, giant,"
     " huge, oversized, loose, loosely, open, enlarged, heavyweight, spaced, enormous, gigantic,"
     " massive, colossal, immense"),
    (Traits(scale=0.6), "fine, small, tiny, narrow, tight, tightly, dense, densely, delicate,"
     " thin, little, miniature, lightweight, micro, finely, compact, minute"),
    (Traits(depth=1.7), "deep, pronounced, rugged, bumpy, raised, embossed, prominent, strong,"
     " uneven, craggy, ridged, grooved, cracked, knobbly, textured, tall, high, lumpy, ridge,"
     " groove, crack, split, furrowed, wavy, wrinkled, gouged, chiselled, carve, engraved,"
     " tactile, bold, sculpted, crevice, furrow, relief, irregular, bump, deeply, strongly,"
     " jagged, corrugated, edgy, undulating, pit, scratched, scored, dented, hammered, chipped,"
     " broken, crumpled, creased, crinkled, porous, peeling, flaking, splintered, knurled,"
     " pebbled, fluffy, dent"),
    (Traits(depth=0.6), "shallow, flat, subtle, faint, slight, even, level, low, gentle, muted,"
     " weak, flattened, ironed, evened, uniform, shallowly, gently, softened"),
    (Traits(depth=1.6, roughness=0.15), "rough, harsh, scratchy, coarsened, raw, unfinished,"
     " untreated, prickly, unpolished, unsanded, roughened, bristly, abrasively, gritty"),
    (Traits(depth=0.6, roughness=-0.15), "smooth, sleek, slippery, smoothly, smoothed, satiny"),
    (Traits(depth=0.5, roughness=-0.3, wear=0.3), "polished, glossy, shiny, varnished, lacquered,"
     " waxed, oiled, buffed, glazed, honed, burnished, gleaming, lustrous, mirror, planed, glassy,"
     " reflective, sheen, gloss, sparkling, glittering, shimmering"),
    (Traits(wear=0.7), "worn, eroded, used, abraded, rubbed, faded, vintage, antique, distressed,"
     " tumbled, sanded, aged, waterworn, old, ancient, washed, stonewashed, rounded, timeworn,"
     " beat, battered, wear, tired, threadbare, weatherbeaten, shabby, trodden, weathered, rustic,"
     " smoothworn, trampled, smoothened, scuffed"),
    (Traits(wear=-0.2), "new, pristine, crisp, unworn, sharp, fresh, freshly"),
    (Traits(roughness=-0.25, light=0.55), "wet, damp, moist, rainy, soaked, dripping, slick,"
     " rain, dew, soggy, drenched, sodden, waterlogged, dank, oily, greasy, muddy, moistened"),
    (Traits(roughness=-0.3, depth=0.7, light=1.3), "icy, frozen, frosty, ice"),
    (Traits(roughness=0.1, light=1.15), "dry, dusty, matte, matt, chalky, sunbaked, parched, dull,"
     " arid, bleached, sunlit, unglazed, satinless"),
    (Traits(light=0.5), "dark, deepcolour, darkened, shadowy, dim, blackened, burnt, charred,"
     " smoked, dirty, sooty, stained, grimy"),
    (Traits(light=1.6), "light, pale, bright, light coloured, whitewashed, pastel, lightened"),
)  # fmt: skip

DEGREES: Final = {
    "very": 2.0, "much": 2.0, "extremely": 2.6, "extra": 1.6, "really": 1.6, "super": 2.0,
    "far": 2.0, "highly": 1.6, "quite": 1.0, "more": 1.0, "slightly": 0.5, "somewhat": 0.6,
    "bit": 0.5, "fairly": 0.9, "rather": 1.0, "less": -1.0, "not": -1.0, "barely": 0.3,
    "incredibly": 2.0, "hardly": -0.5, "so": 1.0, "too": 1.0, "mildly": 0.6, "lightly": 0.6,
    "heavily": 1.6, "most": 1.6, "least": -1.6, "un": -1.0, "non": -1.0, "never": -1.0,
    "freshly": 1.0, "even": 1.0, "especially": 1.6, "moderately": 0.8, "lot": 1.8, "twice": 1.8,
}  # fmt: skip
"""Exponent of the following quality; negative for the opposite quality."""

DIRECTIONS: Final = {
    "horizontal": 0, "horizontally": 0, "lengthwise": 0, "lengthways": 0, "along": 0,
    "vertical": 90, "vertically": 90, "across": 90, "crosswise": 90, "upright": 90,
    "sideways": 90, "diagonal": 45, "diagonally": 45, "slanted": 45, "oblique": 45, "bias": 45,
}  # fmt: skip
"""Rotation of the material, degrees; 0 is grain along x."""

DRAFTS: Final = {
    "plain": "plain", "tabby": "plain", "basket": "basket", "basketweave": "basket",
    "hopsack": "basket", "rib": "rib", "ribbed": "rib", "twill": "twill", "herringbone": "twill",
    "denim": "denim", "satin": "satin", "sateen": "satin", "canvas": "plain", "burlap": "basket",
}  # fmt: skip
"""Weave, a key of :data:`.weave.DRAFTS`, for words after "woven as"."""

NEGATIONS: Final = {"no", "without", "avoid", "lacking", "excluding", "except", "free"}
"""Words before an unwanted material or quality."""

SMALL_WORDS: Final = frozenset(
    "a an the of with in on at to and or but by for from as like its it is are be been that this"
    " these those which than then there into onto over under some any all each both such very"
    " texture textured surface material pattern patterned close up closeup macro lighting lit"
    " photo photograph image"
    " picture view top down seamless tileable tile tiling detailed ultra realistic photorealistic"
    " high resolution render rendering made make making look looks looking feel feels feeling felt"
    " touch touching style finish finished coat coated covered cover covering lined piece pieces"
    " sheet slab block pile heap bed layer bolt strip bunch handful bag bucket pinch patch swatch"
    " sample panel bar rod ball thing object kind type sort colour color coloured colored tone"
    " toned shade hue tint soft diffused diffuse lighting natural nature visible showing just"
    " only my your our his her their i we you want give please something somewhere where when"
    " while after before during above below behind beside between near next side front back"
    " inside outside through around out off up one two three four several many few lots mostly"
    " mainly almost nearly about can could should would will has have had do does was were not"
    " s t full part half whole same other another own good nice beautiful pretty lovely simple"
    " traditional modern classic old fashioned nicely freshly well left right day year hand made"
    " handmade size sized mm cm m inch little grained weave woven direction running runs run laid"
    " lying lay set cut left cold hot warm cool hard solid pure real genuine fake imitation false"
    " quality expensive cheap premium luxury ordinary typical common garden house home room kitchen"
    " outdoor indoor outdoors summer winter autumn spring morning long short single double again"
    " still yet also once scattered spread random regular scale scaled pressed packed under foot"
    " feet bare finger fingers fingertip fingertips skin hand hands stroke stroking underneath"
    " grain grains line lines covers time people man woman someone person who whose".split()
)  # fmt: skip
"""Words without meaning for a material."""

SURFACE_TURNS: Final = {"covered", "coated", "wrapped", "upholstered", "clad", "draped", "lined"}
"""Words before the material of the upper layer: a table covered with linen."""

ASIDES: Final = {
    "like", "than", "under", "beside", "near", "behind", "against", "resembling", "between",
    "among",
}  # fmt: skip
"""Words before a material of a comparison, or of a nearby object."""

QUALITIES: Final = {word.strip(): quality for quality, words in _TABLE for word in words.split(",")}
"""Quality of each word."""


_TOKEN: Final = re.compile(r"[a-z]+|[^\W\d_a-z]+|\d+(?:[.,]\d+)?|[.,;:!?()\n]")
_POSSESSIVE: Final = re.compile(r"(?<=[a-z])['\N{RIGHT SINGLE QUOTATION MARK}]s?\b")
_LEAST_FUZZY: Final = 5  # letters
_LEAST_GUESSED: Final = 7
"""Least length of a word with a wrong letter; a shorter word may be a different word (steep)."""

_ALIKE: Final = 0.85
_ENDINGS: Final = (
    ("ies", "y"), ("ves", "f"), ("es", ""), ("s", ""), ("ier", "y"), ("iest", "y"),
    ("est", "e"), ("est", ""), ("er", "e"), ("er", ""), ("ing", "e"), ("ing", ""), ("ed", "e"),
    ("ed", ""), ("ily", "y"), ("ly", ""), ("ness", ""), ("ish", ""), ("ish", "e"), ("y", ""),
    ("y", "e"), ("en", ""), ("en", "e"), ("iness", "y"), ("like", ""), ("less", ""),
)  # fmt: skip


def tokens(text: str) -> list[str]:
    """Split a text into words, numbers, punctuation and line breaks, in lower case, without accents
    and possessive endings; other signs are dropped."""
    # Decomposed, so that accents are characters of their own, and can be left out.
    plain = unicodedata.normalize("NFKD", text.lower())
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    plain = _POSSESSIVE.sub("", plain.replace("\N{GREEK SMALL LETTER MU}m", "um"))
    return _TOKEN.findall(plain)


def base_form(word: str, known: Container[str]) -> str | None:
    """Form of a word in ``known``: the word, or without an ending (-s, -er, -ing, -y ...) if 3
    letters stay; None without any."""
    if word in known:
        return word
    # A stem has at least three letters: "es" of "yes" is no ending.
    for ending, instead in _ENDINGS:
        if not word.endswith(ending) or len(word) - len(ending) < 3:
            continue
        stem = word[: len(word) - len(ending)]
        if stem + instead in known:
            return stem + instead
        if not instead and stem[-1] == stem[-2] and stem[:-1] in known:  # bigger, thinner
            return stem[:-1]
    return None


def nearest_form(word: str, known: Iterable[str]) -> str | None:
    """Known word nearest to a misspelt word; None if none is near, or below 5 letters. Below 7
    letters only swapped neighbours and wrongly doubled letters are corrected."""
    if len(word) < _LEAST_FUZZY:
        return None
    # A wrong first letter is rare, and would make most short words similar.
    similar = [x for x in known if abs(len(x) - len(word)) <= 1 and x[0] == word[0]]
    swapped = {word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)}
    nearest = [x for x in similar if x in swapped or _undoubled(x) == _undoubled(word)]
    if not nearest and len(word) >= _LEAST_GUESSED:
        nearest = difflib.get_close_matches(word, similar, 1, _ALIKE)
    return nearest[0] if nearest else None


def _undoubled(word: str) -> str:
    """Word with each run of a letter as one letter."""
    return "".join(letter for letter, _ in itertools.groupby(word))
