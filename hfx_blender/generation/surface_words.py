# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabularies of colours, materials and qualities; forms and misspellings of words.

Materials are in ``surface_words.csv``; of a word in several rows the first row counts. Other words
are in ``surface_words.json``.
"""

import csv
import difflib
import itertools
import json
import re
import unicodedata
from collections.abc import Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_FILE: Final = Path(__file__)
_VOCABULARY: Final = json.loads(_FILE.with_suffix(".json").read_text(encoding="utf-8"))

COLOURS: Final[dict[str, tuple[float, float, float]]] = {
    name: tuple(colour) for name, colour in _VOCABULARY["colours"].items()
}
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

with _FILE.with_suffix(".csv").open(encoding="utf-8", newline="") as _table:
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


DEGREES: Final[dict[str, float]] = _VOCABULARY["degrees"]
"""Exponent of the following quality; negative for the opposite quality."""

DIRECTIONS: Final[dict[str, int]] = _VOCABULARY["directions"]
"""Rotation of the material, degrees; 0 is grain along x."""

DRAFTS: Final[dict[str, str]] = _VOCABULARY["drafts"]
"""Weave, a key of :data:`.weave.DRAFTS`, for words after "woven as"."""

NEGATIONS: Final = {"no", "without", "avoid", "lacking", "excluding", "except", "free"}
"""Words before an unwanted material or quality."""

SMALL_WORDS: Final = frozenset(_VOCABULARY["small_words"])  # words without meaning for a material
SURFACE_TURNS: Final = {"covered", "coated", "wrapped", "upholstered", "clad", "draped", "lined"}
"""Words before the material of the upper layer: a table covered with linen."""

ASIDES: Final = frozenset(_VOCABULARY["asides"])
"""Words before a material of a comparison, or of a nearby object."""

QUALITIES: Final = {
    word: Traits(**entry["traits"]) for entry in _VOCABULARY["qualities"] for word in entry["words"]
}
"""Quality of each word."""

_TOKEN: Final = re.compile(r"[a-z]+|[^\W\d_a-z]+|\d+(?:[.,]\d+)?|[.,;:!?()\n]")
_POSSESSIVE: Final = re.compile(r"(?<=[a-z])['\N{RIGHT SINGLE QUOTATION MARK}]s?\b")
_LEAST_FUZZY: Final = 5  # letters
_LEAST_GUESSED: Final = 7
"""Least length of a word with a wrong letter; a shorter word may be a different word (steep)."""

_ALIKE: Final = 0.85
_ENDINGS: Final = tuple(map(tuple, _VOCABULARY["endings"]))


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
