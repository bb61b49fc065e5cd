# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpretation of English words: kind of material and qualities."""

import re
from dataclasses import dataclass, field, fields, replace
from typing import Final

from ..engine.texture.procedural import KINDS
from ..errors import InputError
from .surface_words import (
    ASIDES,
    COLOURS,
    DEGREES,
    DIRECTIONS,
    DRAFTS,
    LONGEST_PHRASE,
    NEGATIONS,
    QUALITIES,
    SMALL_WORDS,
    SURFACE_TURNS,
    WORDS,
    MaterialWord,
    Traits,
    base_form,
    nearest_form,
    tokens,
)

_STOPS: Final = frozenset(".,;:!?()\n")
_UNITS_M: Final = {"mm": 1e-3, "cm": 1e-2, "um": 1e-6, "micron": 1e-6, "microns": 1e-6}
_HEIGHTS: Final = {"deep", "depth", "high", "height", "tall"}
_MADE_OF: Final = {("made", "of"), ("made", "from"), ("out", "of")}
_PICTURE_WORDS: Final = re.compile(
    r"close[- ]?up|top.down|(?:natural|studio|ambient|street)[- ]?lights?|high[- ]res\w*"
    r"|fine[- ]detail\w*|soft\w* light\w*"
)
_FINISHED: Final = ("metal", "gravel")
"""Kinds whose finish, such as "brushed", decides the library material."""

_GUESSED: Final = 0.6
"""Factor of the weight of a misspelt material: below the weight of any exact word."""

_ON_TOP: Final = 6.0  # added weight of an upper layer: covered with linen
_BESIDE: Final = 1.5  # subtracted weight after "with", "on" and "in"

_MOST_DEGREE: Final = 6.0  # largest exponent of a quality, however many times "very" is repeated
_LISTED: Final = 200  # letters of unknown words in a message

_SIZES_M: Final = (5e-5, 0.5)  # allowed sizes and depths of features, metres: the range of touch


@dataclass(frozen=True)
class NamedMaterial:
    """Material in a text."""

    word: str
    place: int  # index among the text's words
    meaning: MaterialWord
    weight: float  # vote for the kind
    is_reference: bool = False  # of a comparison: coarser than denim


@dataclass
class Interpretation:
    """Meaning of a text: materials with weights, and the product of all qualities. None, and
    neutral numbers, where the text says nothing."""

    materials: list[NamedMaterial] = field(default_factory=list)
    scale: float = 1.0  # these five as of Traits
    depth: float = 1.0
    wear: float = 0.0
    roughness: float = 0.0
    light: float = 1.0
    colour: str | None = None  # a key of COLOURS
    direction_deg: int | None = None  # 0, 45 or 90
    draft: str | None = None  # weave
    period_m: float | None = None  # size of the features
    depth_m: float | None = None
    unwanted: set[str] = field(default_factory=set)  # kinds
    understood: dict[str, str] = field(default_factory=dict)  # word to meaning, for the record
    unknown: list[str] = field(default_factory=list)  # unique words
    _counts: dict[Traits, int] = field(default_factory=dict)

    def add(self, quality: Traits, degree: float) -> None:
        """Apply a quality to a power ``degree``, clipped to +-6; negative: the opposite quality.
        Each repetition of equal factors has half the degree of the repetition before."""
        # Synonyms ("coarse big") have equal factors, and are a repetition, too.
        times = self._counts.get(quality, 0)
        self._counts[quality] = times + 1
        # "very very very" must not grow without bound.
        degree = min(max(degree, -_MOST_DEGREE), _MOST_DEGREE) * 0.5**times
        self.scale *= quality.scale**degree
        self.depth *= quality.depth**degree
        self.light *= quality.light**degree
        self.wear += quality.wear * degree
        self.roughness += quality.roughness * degree

    def choose(self) -> tuple[MaterialWord, NamedMaterial]:
        """Choose the material: the word for its shape, and the strongest word of its kind.

        Kinds are compared by the sum of weights, equal sums by the last word; unwanted kinds and
        references of comparisons do not count, unless a text has only references. Sets a colour
        from a material of another kind (silk, gold) if the text has none.

        Raises InputError: no word names a material.
        """
        # Of kinds with equal scores the one of the later word wins, as its noun comes last.
        scores = dict.fromkeys(KINDS, 0.0)
        last = dict.fromkeys(KINDS, -1)
        named = [material for material in self.materials if not material.is_reference]
        for material in named or self.materials:
            kind = material.meaning.kind
            if kind not in self.unwanted:
                # Materials aside, of weight 0, still decide where no further material is named.
                scores[kind] += max(material.weight, 0.1)
                last[kind] = max(last[kind], material.place)
        kind = max(KINDS, key=lambda name: (scores[name], last[name]))
        if scores[kind] == 0.0:
            text, listed = ", ".join(self.unknown), "."
            if text:
                listed = f". Not known: {text[:_LISTED]}{' ...' * (len(text) > _LISTED)}."
            raise InputError(
                "No word names a material that the library has anything near to; it knows English "
                f"words for {', '.join(KINDS)}{listed}"
            )
        of_kind = [x for x in self.materials if x.meaning.kind == kind]
        tints = [x.word for x in self.materials if x.word in COLOURS and x not in of_kind]
        self.colour = self.colour or (tints[0] if tints else None)
        strongest = max(of_kind, key=lambda x: (x.weight, x.is_reference, x.place))
        # Brushed steel: the finish has the shape, the steel has the colour.
        finishes = [x.meaning for x in of_kind if x.meaning.weight == 1]
        shape = finishes[-1] if finishes and kind in _FINISHED else strongest.meaning
        return shape, strongest


def read_words(text: str, negative: str = "") -> Interpretation:
    """Interpret a text, and a text of unwanted materials and qualities.

    Unwanted materials of weight 2 or more exclude their kind; unwanted qualities count with degree
    -0.5. Raises InputError for a size outside the range of touch.
    """
    meaning = Interpretation()
    _TextReader(meaning, text)
    if negative.strip():
        unwanted = Interpretation()
        _TextReader(unwanted, negative)
        meaning.unwanted |= {x.meaning.kind for x in unwanted.materials if x.weight >= 2.0}
        traits = {item.name: getattr(unwanted, item.name) for item in fields(Traits)}
        meaning.add(Traits(**traits), -0.5)
        meaning.unknown += [word for word in unwanted.unknown if word not in meaning.unknown]
    return meaning


class _TextReader:
    """Single pass over the words of a text, when created; writes to an interpretation. The state
    holds for the next material or quality, or to the end of the clause."""

    def __init__(self, interpretation: Interpretation, text: str) -> None:
        self._result = interpretation
        coloured = r"\b([a-z]+)[- ](?:colou?red|toned|tinted|hued)\b"
        self._coloured = set(re.findall(coloured, text.lower()))
        self._words = tokens(_PICTURE_WORDS.sub(" ", text.lower()))
        self._degree = 1.0  # product of "very", "less" ...
        self._is_unwanted = False
        self._is_denied = False  # unwanted by "not", which ends with the next quality
        self._bonus = 0.0  # added to the weight of materials
        self._is_aside = False  # material of a comparison, or nearby
        self._is_reference = False  # after "than"
        index = 0
        while index < len(self._words):
            index += self._step(index)

    def _end_of_clause(self) -> None:
        """Forget the words that act on the next material or quality."""
        self._degree, self._bonus = 1.0, 0.0
        self._is_unwanted = self._is_aside = self._is_reference = False

    def _step(self, place: int) -> int:
        """Read the longest pattern at word ``place``: stop, number, weave, negation, "made of",
        phrase or single word; return the number of words, at least 1."""
        word = self._words[place]
        if word in _STOPS or word == "but":
            self._end_of_clause()
            return 1
        # Longer patterns come first, so that their words are not read one by one.
        if word[0].isdigit():
            return self._number(place)
        if word in ("woven", "weave", "knitted") and (used := self._weave(place)):
            return used
        if self._words[place : place + 3 : 2] == ["as", "as"]:
            self._is_aside = True  # as rough as sandpaper: only the quality counts
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
        """Read "2 mm deep" as depth, "2 mm" as size of features; return the number of words, 1
        without a unit, which has no effect. InputError outside 0.05..500 mm."""
        following = self._words[place + 1 : place + 3]
        if not following or following[0] not in _UNITS_M:
            return 1
        # Many languages write decimals with a comma.
        metres = float(self._words[place].replace(",", ".")) * _UNITS_M[following[0]]
        shown = f"{self._words[place]} {following[0]}"
        if not _SIZES_M[0] <= metres <= _SIZES_M[1]:
            raise InputError(
                f"Words: '{shown}' is {metres * 1e3:g} mm; sizes and depths are "
                f"{_SIZES_M[0] * 1e3:g} to {_SIZES_M[1] * 1e3:g} mm."
            )
        if len(following) == 2 and following[1] in _HEIGHTS:
            self._result.depth_m = metres
            self._result.understood[shown] = "depth"
            return 3
        self._result.period_m = metres
        self._result.understood[shown] = "size of the features"
        return 2

    def _weave(self, place: int) -> int:
        """Read the draft after "woven", the word at ``place``: a preposition (as, like, in, into)
        and the name of a draft. Return the number of words with that at ``place``; 0 without
        preposition or draft."""
        rest = [word for word in self._words[place + 1 : place + 5] if word not in ("a", "the")]
        if len(rest) < 2 or rest[0] not in ("as", "like", "in", "into") or rest[1] not in DRAFTS:
            return 0
        self._result.draft = DRAFTS[rest[1]]
        self._result.understood[f"woven as {rest[1]}"] = f"weave {self._result.draft}"
        end = self._words.index(rest[1], place)
        return end - place + 1

    def _phrase(self, place: int) -> int:
        """Read the longest known phrase of 2 or more words at ``place`` as a material, also written
        as one word unless the first is a quality; return the number of words, 0 for none."""
        for count in range(LONGEST_PHRASE, 1, -1):
            words = self._words[place : place + count]
            if len(words) < count:
                continue
            material = base_form(" ".join(words), WORDS)
            if material is None and words[0] not in QUALITIES:  # "rough cast iron": no roughcast
                material = base_form("".join(words), WORDS)
            if material is not None:
                self._material(material, WORDS[material], place)
                return count
        return 0

    def _single(self, place: int, word: str) -> int:
        """Read a degree, direction, colour, quality or material, first hit in this order; pass over
        small words, correct or note unknown words. Returns 1."""
        following = self._words[place + 1 : place + 2]
        # "even" is a degree before a quality, and otherwise a quality.
        is_before_quality = bool(following and base_form(following[0], QUALITIES))
        if word in DEGREES and (word not in QUALITIES or is_before_quality):
            factor = DEGREES[word]
            if word == "not":  # "not metal" excludes metal, "not shiny metal" only the shine
                self._is_unwanted = self._is_denied = True
            self._degree *= factor
            self._result.understood[word] = f"degree {factor:g}"
            return 1
        if word in DIRECTIONS:
            self._result.direction_deg = DIRECTIONS[word]
            self._result.understood[word] = f"turned by {DIRECTIONS[word]} degrees"
        elif self._is_colour(place, word):
            if not self._is_unwanted:
                self._result.colour = word
                self._result.understood[word] = "colour"
            self._degree = 1.0
        elif (quality := base_form(word, QUALITIES)) and word not in WORDS:
            self._quality(place, quality)
        elif (material := base_form(word, WORDS)) is not None:
            self._material(material, WORDS[material], place)
        elif word not in SMALL_WORDS and base_form(word, SMALL_WORDS) is None:
            self._unknown(place, word)
        return 1

    def _is_colour(self, place: int, word: str) -> bool:
        """Test for a word of COLOURS that is no material, has "-toned" or "-coloured", or precedes
        another colour, fabric or object not made of it: copper dress."""
        if word not in COLOURS:
            return False
        if word not in WORDS or word in self._coloured:
            return True
        following = self._words[place + 1 : place + 2]
        noun = base_form(following[0], WORDS) if following else None
        if noun is None:
            return bool(following) and following[0] in COLOURS
        own, thing = WORDS[word], WORDS[noun]
        # An oak gate is made of oak, but a copper dress has the colour of copper.
        is_made_of_it = thing.weight < own.weight and thing.kind != "fabric"
        return thing.kind != own.kind and thing.weight >= 2 and not is_made_of_it

    def _quality(self, place: int, quality: str) -> None:
        """Apply a quality, of the word at ``place``, with the degree of the words before, negative
        after a negation; the degree then ends."""
        word = self._words[place]
        following = self._words[place + 1 : place + 2]
        meaning = QUALITIES[quality]
        # A deep colour is dark, not deep.
        if quality == "deep" and following and following[0] in COLOURS:
            meaning = QUALITIES["deepcolour"]
        degree = self._degree
        # "no rough" is smooth, but "no less rough" stays.
        if self._is_unwanted and degree > 0.0:
            degree = -degree
        self._result.add(meaning, degree)
        self._result.understood[word] = quality if degree > 0.0 else f"not {quality}"
        self._degree = 1.0
        self._is_unwanted &= not self._is_denied

    def _material(self, word: str, meaning: MaterialWord, place: int) -> None:
        """Add a material, of weight 0 in a comparison, nearby, or as a shade; after a negation add
        the kind to the unwanted kinds instead. Nothing for "oak-coloured"."""
        if word in self._coloured and word not in COLOURS:
            return
        if self._is_unwanted:
            self._result.unwanted.add(meaning.kind)
            self._result.understood[word] = f"no {meaning.kind}"
            self._is_unwanted = False
            return
        # Stone grey carpet: a material before a plain colour names a shade.
        following = self._words[place + 1 : place + 2]
        is_shade = bool(following) and following[0] in COLOURS and following[0] not in WORDS
        is_aside = (self._is_aside and not self._is_reference) or is_shade
        # Materials aside count only if no more important material is named.
        weight = 0.0 if is_aside else meaning.weight + self._bonus
        named = NamedMaterial(word, place, meaning, weight, self._is_reference)
        self._result.materials.append(named)
        self._result.understood[word] = meaning.kind
        # A finish such as "polished" is a material and a quality.
        if word in QUALITIES:
            self._result.add(QUALITIES[word], self._degree)
        self._degree = 1.0

    def _unknown(self, place: int, word: str) -> None:
        """Read the nearest material, at 0.6 of its weight, or quality of a misspelt word; else
        append the word to ``unknown``, once."""
        # Materials first, as the kind of material matters more than a quality.
        for known in (WORDS, QUALITIES):
            near = nearest_form(word, known)
            if near is None or " " in near:
                continue
            self._result.understood[word] = f"read as '{near}'"
            if known is WORDS:
                guess = replace(WORDS[near], weight=_GUESSED * WORDS[near].weight)
                self._material(near, guess, place)
            else:
                self._result.add(QUALITIES[near], self._degree)
            return
        if word not in self._result.unknown:
            self._result.unknown.append(word)
