# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabulary of qualities: comparatives, finishes, directions, weaves, and small words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


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
