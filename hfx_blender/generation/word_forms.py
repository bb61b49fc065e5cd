# SPDX-License-Identifier: GPL-3.0-or-later
"""Words of a text in their dictionary forms, and words that are nearly right."""

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
"""Letters of a word of which any may be wrong: shorter ones are soon other words (stand, steep)."""

_ALIKE: Final = 0.85
_ENDINGS: Final = (
    ("ies", "y"), ("ves", "f"), ("es", ""), ("s", ""), ("ier", "y"), ("iest", "y"),
    ("est", "e"), ("est", ""), ("er", "e"), ("er", ""), ("ing", "e"), ("ing", ""), ("ed", "e"),
    ("ed", ""), ("ily", "y"), ("ly", ""), ("ness", ""), ("ish", ""), ("ish", "e"), ("y", ""),
    ("y", "e"), ("en", ""), ("en", "e"), ("iness", "y"), ("like", ""), ("less", ""),
)  # fmt: skip


def tokens(text: str) -> list[str]:
    """Words, numbers and punctuation of a text, in lower case and without accents."""
    plain = unicodedata.normalize("NFKD", text.lower())
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    plain = _POSSESSIVE.sub("", plain.replace("\N{GREEK SMALL LETTER MU}m", "um"))
    return _TOKEN.findall(plain)


def base_form(word: str, known: Container[str]) -> str | None:
    """Form of a word that is known: itself, its singular, or the word that it is derived from."""
    if word in known:
        return word
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
    """Known word that a misspelt one is likely to mean.

    Of short words only slips of typing are mended: neighbours swapped, a letter doubled or not.
    """
    if len(word) < _LEAST_FUZZY:
        return None
    alike = [each for each in known if abs(len(each) - len(word)) <= 1 and each[0] == word[0]]
    swapped = {word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)}
    found = [each for each in alike if each in swapped or _undoubled(each) == _undoubled(word)]
    if not found and len(word) >= _LEAST_GUESSED:
        found = difflib.get_close_matches(word, alike, 1, _ALIKE)
    return found[0] if found else None


def _undoubled(word: str) -> str:
    return "".join(letter for letter, _ in itertools.groupby(word))
