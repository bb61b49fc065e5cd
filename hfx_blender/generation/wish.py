# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpretation of words: the kind of material, and its qualities."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Final

from ..engine.texture.procedural import KINDS
from ..errors import InputError
from .material_words import COLOURS, LONGEST_PHRASE, WORDS, MaterialWord
from .quality_words import (
    ASIDES,
    DEGREES,
    DIRECTIONS,
    DRAFTS,
    NEGATIONS,
    QUALITIES,
    SMALL_WORDS,
    SURFACE_TURNS,
    Quality,
)
from .word_forms import base_form, nearest_form, tokens

_STOPS: Final = frozenset(".,;:!?()\n")
_UNITS_M: Final = {"mm": 1e-3, "cm": 1e-2, "um": 1e-6, "micron": 1e-6, "microns": 1e-6}
_HEIGHTS: Final = {"deep", "depth", "high", "height", "tall"}
_MADE_OF: Final = {("made", "of"), ("made", "from"), ("out", "of")}
_PICTURE_WORDS: Final = re.compile(
    r"close[- ]?up|top.down|(?:natural|studio|ambient|street)[- ]?lights?|high[- ]res\w*"
    r"|fine[- ]detail\w*|soft\w* light\w*"
)
_FINISHED: Final = ("metal", "gravel")
"""Kinds whose finish decides which variant is nearest."""

_GUESSED: Final = 0.6
"""Weight of a word that is only spelt nearly like a material: less than of any that is one."""

_ON_TOP: Final = 6.0
_BESIDE: Final = 1.5  # less, of what a thing has or lies on

_MOST_DEGREE: Final = 6.0
"""However often "very" is said: about four times."""

_LISTED: Final = 200  # letters of unknown words in a message

_SIZES_M: Final = (5e-5, 0.5)
"""Sizes and depths of features that a finger can tell on a surface."""


@dataclass(frozen=True)
class NamedMaterial:
    """A material in the text: its word, its place, and how much it decides the kind."""

    word: str
    place: int
    meaning: MaterialWord
    weight: float
    is_reference: bool = False  # of a comparison: coarser than denim


@dataclass
class Wish:
    """Meaning of a text: materials with weights, and qualities multiplied together."""

    materials: list[NamedMaterial] = field(default_factory=list)
    scale: float = 1.0
    depth: float = 1.0
    wear: float = 0.0
    roughness: float = 0.0
    light: float = 1.0
    colour: str | None = None
    direction_deg: int | None = None
    draft: str | None = None
    period_m: float | None = None
    depth_m: float | None = None
    unwanted: set[str] = field(default_factory=set)  # kinds
    understood: dict[str, str] = field(default_factory=dict)  # word to meaning
    unknown: list[str] = field(default_factory=list)
    _counts: dict[Quality, int] = field(default_factory=dict)

    def add(self, quality: Quality, degree: float) -> None:
        """Multiply with a quality to some degree; a negative degree turns it round.

        Each repetition of it, or of a word that means the same, counts half of the one before.
        """
        times = self._counts.get(quality, 0)
        self._counts[quality] = times + 1
        degree = min(max(degree, -_MOST_DEGREE), _MOST_DEGREE) * 0.5**times
        self.scale *= quality.scale**degree
        self.depth *= quality.depth**degree
        self.light *= quality.light**degree
        self.wear += quality.wear * degree
        self.roughness += quality.roughness * degree

    def choose(self) -> tuple[MaterialWord, NamedMaterial]:
        """Shape and word of the material that is meant.

        Raises
        ------
        InputError
            No word names a material.
        """
        scores = dict.fromkeys(KINDS, 0.0)
        last = dict.fromkeys(KINDS, -1)
        named = [each for each in self.materials if not each.is_reference] or self.materials
        for each in named:
            kind = each.meaning.kind
            if kind not in self.unwanted:
                scores[kind] += max(each.weight, 0.1)
                last[kind] = max(last[kind], each.place)
        kind = max(KINDS, key=lambda name: (scores[name], last[name]))
        if scores[kind] == 0.0:
            raise InputError(
                "No word names a material that the library has anything near to; it knows English "
                f"words for {', '.join(KINDS)}" + _listed(self.unknown)
            )
        mine = [each for each in self.materials if each.meaning.kind == kind]
        tints = [each.word for each in self.materials if each.word in COLOURS and each not in mine]
        self.colour = self.colour or (tints[0] if tints else None)  # silk, gold
        strongest = max(mine, key=lambda each: (each.weight, each.is_reference, each.place))
        finishes = [each.meaning for each in mine if each.meaning.weight == 1]
        shape = finishes[-1] if finishes and kind in _FINISHED else strongest.meaning
        return shape, strongest


def read_words(text: str, negative: str = "") -> Wish:
    """Interpret a wish, and the words of what is not wanted.

    Raises
    ------
    InputError
        A size that no surface has.
    """
    wish = Wish()
    _Reader(wish, text).read()
    if negative.strip():
        unwanted = Wish()
        _Reader(unwanted, negative).read()
        wish.unwanted |= {each.meaning.kind for each in unwanted.materials if each.weight >= 2.0}
        wish.add(
            Quality(
                unwanted.scale, unwanted.depth, unwanted.wear, unwanted.roughness, unwanted.light
            ),
            -0.5,
        )
        wish.unknown += [each for each in unwanted.unknown if each not in wish.unknown]
    return wish


def _listed(unknown: list[str]) -> str:
    text = ", ".join(unknown)
    return f". Not known: {text[:_LISTED]}{' ...' * (len(text) > _LISTED)}." if unknown else "."


class _Reader:
    """One pass over the words of a text."""

    def __init__(self, wish: Wish, text: str) -> None:
        self._wish = wish
        coloured = r"\b([a-z]+)[- ](?:colou?red|toned|tinted|hued)\b"
        self._coloured = set(re.findall(coloured, text.lower()))
        self._words = tokens(_PICTURE_WORDS.sub(" ", text.lower()))
        self._degree = 1.0
        self._is_unwanted = False
        self._is_denied = False  # by "not"
        self._bonus = 0.0
        self._is_aside = False
        self._is_reference = False

    def read(self) -> None:
        """Read all words."""
        place = 0
        while place < len(self._words):
            place += self._step(place)

    def _end_of_clause(self) -> None:
        self._degree, self._bonus = 1.0, 0.0
        self._is_unwanted = self._is_aside = self._is_reference = False

    def _step(self, place: int) -> int:
        """Read what begins at a place; returns the number of words."""
        word = self._words[place]
        if word in _STOPS or word == "but":
            self._end_of_clause()
            return 1
        if word[0].isdigit():
            return self._number(place)
        if word in ("woven", "weave", "knitted") and (used := self._weave(place)):
            return used
        if self._words[place : place + 3 : 2] == ["as", "as"]:
            self._is_aside = True  # as rough as sandpaper: the quality counts, the material not
            return self._step(place + 1) + 1
        if word in NEGATIONS:
            self._is_unwanted, self._is_denied = True, False
            return 1
        if word in SURFACE_TURNS or word in ASIDES:
            self._bonus = _ON_TOP if word in SURFACE_TURNS else 0.0
            self._is_aside = word in ASIDES
            self._is_reference = word == "than"
            return 1
        if tuple(self._words[place : place + 2]) in _MADE_OF:
            self._end_of_clause()
            self._bonus = 1.0
            return 2
        if word in ("with", "on", "in") and self._bonus < _ON_TOP:
            self._bonus = -_BESIDE
            return 1
        return self._phrase(place) or self._single(place, word)

    def _number(self, place: int) -> int:
        """Read a length: the period, or the depth if the next word says so."""
        following = self._words[place + 1 : place + 3]
        if not following or following[0] not in _UNITS_M:
            return 1
        metres = float(self._words[place].replace(",", ".")) * _UNITS_M[following[0]]
        shown = f"{self._words[place]} {following[0]}"
        if not _SIZES_M[0] <= metres <= _SIZES_M[1]:
            raise InputError(
                f"Words: '{shown}' is {metres * 1e3:g} mm; sizes and depths are "
                f"{_SIZES_M[0] * 1e3:g} to {_SIZES_M[1] * 1e3:g} mm."
            )
        if len(following) == 2 and following[1] in _HEIGHTS:
            self._wish.depth_m = metres
            self._wish.understood[shown] = "depth"
            return 3
        self._wish.period_m = metres
        self._wish.understood[shown] = "size of the features"
        return 2

    def _weave(self, place: int) -> int:
        """Read "woven as twill", "woven like a basket", "woven in rib"."""
        rest = [word for word in self._words[place + 1 : place + 5] if word not in ("a", "the")]
        if len(rest) < 2 or rest[0] not in ("as", "like", "in", "into") or rest[1] not in DRAFTS:
            return 0
        self._wish.draft = DRAFTS[rest[1]]
        self._wish.understood[f"woven as {rest[1]}"] = f"weave {self._wish.draft}"
        end = self._words.index(rest[1], place)
        return end - place + 1

    def _phrase(self, place: int) -> int:
        """Read the longest material of several words that begins here; 0 if there is none."""
        for count in range(LONGEST_PHRASE, 1, -1):
            words = self._words[place : place + count]
            if len(words) < count:
                continue
            found = base_form(" ".join(words), WORDS)
            if found is None and words[0] not in QUALITIES:  # "rough cast iron" is no roughcast
                found = base_form("".join(words), WORDS)
            if found is not None:
                self._material(found, WORDS[found], place)
                return count
        return 0

    def _single(self, place: int, word: str) -> int:
        if word in DEGREES and not self._is_quality_alone(place):
            factor = DEGREES[word]
            if word == "not":  # not metal; but of "not shiny metal" only the shine is denied
                self._is_unwanted = self._is_denied = True
            self._degree *= factor
            self._wish.understood[word] = f"degree {factor:g}"
            return 1
        if word in DIRECTIONS:
            self._wish.direction_deg = DIRECTIONS[word]
            self._wish.understood[word] = f"turned by {DIRECTIONS[word]} degrees"
        elif self._is_colour(place, word):
            self._colour(word)
        elif (quality := base_form(word, QUALITIES)) and word not in WORDS:
            self._quality(place, quality)
        elif (material := base_form(word, WORDS)) is not None:
            self._material(material, WORDS[material], place)
        elif word not in SMALL_WORDS and base_form(word, SMALL_WORDS) is None:
            self._unknown(place, word)
        return 1

    def _is_quality_alone(self, place: int) -> bool:
        """Test for a word such as "even" that is a quality, not a degree: no quality follows."""
        word = self._words[place]
        following = self._words[place + 1 : place + 2]
        return word in QUALITIES and not (following and base_form(following[0], QUALITIES))

    def _is_colour(self, place: int, word: str) -> bool:
        if word not in COLOURS:
            return False
        if word not in WORDS or word in self._coloured:
            return True
        following = self._words[place + 1 : place + 2]
        other = base_form(following[0], WORDS) if following else None
        if other is None:
            return bool(following) and following[0] in COLOURS
        own, thing = WORDS[word], WORDS[other]
        # A gate can be of oak, a dress of copper is only coloured so.
        is_made_of_it = thing.weight < own.weight and thing.kind != "fabric"
        return thing.kind != own.kind and thing.weight >= 2 and not is_made_of_it

    def _colour(self, word: str) -> None:
        if not self._is_unwanted:
            self._wish.colour = word
            self._wish.understood[word] = "colour"
        self._degree = 1.0

    def _quality(self, place: int, quality: str) -> None:
        word = self._words[place]
        following = self._words[place + 1 : place + 2]
        meaning = QUALITIES[quality]
        if quality == "deep" and following and following[0] in COLOURS:
            meaning = QUALITIES["deepcolour"]
        degree = self._degree
        if self._is_unwanted and degree > 0.0:
            degree = -degree
        self._wish.add(meaning, degree)
        self._wish.understood[word] = quality if degree > 0.0 else f"not {quality}"
        self._degree = 1.0
        self._is_unwanted &= not self._is_denied

    def _material(self, word: str, meaning: MaterialWord, place: int) -> None:
        if word in self._coloured and word not in COLOURS:
            return
        if self._is_unwanted:
            self._wish.unwanted.add(meaning.kind)
            self._wish.understood[word] = f"no {meaning.kind}"
            self._is_unwanted = False
            return
        is_aside = (self._is_aside and not self._is_reference) or self._is_shade(place)
        weight = 0.0 if is_aside else meaning.weight + self._bonus
        named = NamedMaterial(word, place, meaning, weight, self._is_reference)
        self._wish.materials.append(named)
        self._wish.understood[word] = meaning.kind
        # An adjective of quality, read as a material's finish, is not lost to the surface.
        if word in QUALITIES:
            self._wish.add(QUALITIES[word], self._degree)
        self._degree = 1.0

    def _is_shade(self, place: int) -> bool:
        """Test for a material that only tells which grey it is: "stone grey carpet"."""
        following = self._words[place + 1 : place + 2]
        return bool(following) and following[0] in COLOURS and following[0] not in WORDS

    def _unknown(self, place: int, word: str) -> None:
        for known in (WORDS, QUALITIES):
            near = nearest_form(word, known)
            if near is not None and " " not in near:
                self._wish.understood[word] = f"read as '{near}'"
                if known is WORDS:
                    known_word = WORDS[near]
                    guess = replace(known_word, weight=_GUESSED * known_word.weight)
                    self._material(near, guess, place)
                else:
                    self._wish.add(QUALITIES[near], self._degree)
                return
        if word not in self._wish.unknown:
            self._wish.unknown.append(word)
