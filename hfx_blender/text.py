# SPDX-License-Identifier: GPL-3.0-or-later
"""Escapes and shortens text of other programs (names of scenes, effects, files) for display."""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Final

UNSAFE: Final = re.compile(
    "[\x00-\x1f\x7f-\x9f"  # control characters: colours, titles, clearing, line ends
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # change the direction of what follows
    "\u2028\u2029\ufeff\ud800-\udfff]"  # line ends, a mark, halves of characters
)


def printable(text: str) -> str:
    """Escape control, direction and line-end characters of one line as ``\\x1b``; idempotent."""
    return UNSAFE.sub(lambda match: ascii(match[0])[1:-1], text)


def printable_lines(text: str) -> str:
    """Escape each line of a text as :func:`printable`; line ends stay."""
    return "\n".join(map(printable, text.split("\n")))


def name_key(name: str) -> str:
    """Key of a file name, equal for names that a file system may not distinguish.

    Windows and macOS ignore case; macOS ignores the encoding of accents (NFC, NFD).
    """
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


_SHOWN: Final = 6

MOST_NAMES: Final = 12
"""Largest number of names in a warning or line about many effects; the report file has all."""


def named(names: Sequence[str], most: int = _SHOWN) -> str:
    """Join at most ``most`` names with commas, followed by the number of omitted names."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def counted(names: Sequence[str], sentence: str) -> tuple[str, ...]:
    """Sentence with the number and the first names of its subjects; empty tuple without names."""
    return (f"{sentence}: {len(names)} ({named(names)})",) if names else ()


MOST_LINES: Final = 40  # largest number of warnings, and of notes, in a terminal or popup

MOST_KEPT: Final = 1000  # largest number of warnings in a report file and in a track


def shortened(texts: Iterable[str], most: int = MOST_KEPT) -> tuple[str, ...]:
    """Unique texts in order, at most ``most``, then "... and N more" for omitted texts."""
    unique = tuple(dict.fromkeys(texts))
    omitted = len(unique) - most
    return unique if omitted <= 0 else (*unique[:most], f"... and {omitted} more")
