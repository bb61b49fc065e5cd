# SPDX-License-Identifier: GPL-3.0-or-later
"""Tokens of a text, dictionary forms of words, and correction of misspelt words."""

from __future__ import annotations

import difflib
import itertools
import re
import unicodedata
from collections.abc import Container, Iterable
from typing import Final

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
    and possessive endings; other signs are dropped.
    """
    plain = unicodedata.normalize("NFKD", text.lower())
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    plain = _POSSESSIVE.sub("", plain.replace("\N{GREEK SMALL LETTER MU}m", "um"))
    return _TOKEN.findall(plain)


def base_form(word: str, known: Container[str]) -> str | None:
    """Form of a word in ``known``: the word, or without an ending (-s, -er, -ing, -y ...) if 3
    letters stay; None without any.
    """
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
    """Known word nearest to a misspelt word; None if none is near, or below 5 letters.

    Below 7 letters only swapped neighbours and wrongly doubled letters are corrected.
    """
    if len(word) < _LEAST_FUZZY:
        return None
    similar = [x for x in known if abs(len(x) - len(word)) <= 1 and x[0] == word[0]]
    swapped = {word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)}
    nearest = [x for x in similar if x in swapped or _undoubled(x) == _undoubled(word)]
    if not nearest and len(word) >= _LEAST_GUESSED:
        nearest = difflib.get_close_matches(word, similar, 1, _ALIKE)
    return nearest[0] if nearest else None


def _undoubled(word: str) -> str:
    return "".join(letter for letter, _ in itertools.groupby(word))
