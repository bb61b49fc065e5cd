# SPDX-License-Identifier: GPL-3.0-or-later
"""Text of strangers (names of scenes, effects, files) made safe to show on a terminal."""

from __future__ import annotations

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
    """Escape characters that would steer a terminal, or end the line, as ``\\x1b``.

    Parameters
    ----------
    text : str
        One line.

    Returns
    -------
    str
        The same when it is applied again.
    """
    return UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)


def printable_lines(text: str) -> str:
    """Escape each line of a text; its line ends stay."""
    return "\n".join(map(printable, text.split("\n")))


def name_key(name: str) -> str:
    """Key that is the same for names that a file system may take for one.

    Case does not count on Windows and macOS, nor on macOS how a letter with an accent is encoded.
    """
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


_SHOWN: Final = 6


def named(names: Sequence[str], most: int = _SHOWN) -> str:
    """The first of some names, at most ``most``, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def counted(names: Sequence[str], sentence: str) -> tuple[str, ...]:
    """A sentence about some effects or actuators, how many and which; none about nobody."""
    return (f"{sentence}: {len(names)} ({named(names)})",) if names else ()


MOST_LINES: Final = 40
"""Warnings, and notes, that are shown; the report's file has more."""


MOST_KEPT: Final = 1000
"""Warnings that a report's file and a track keep."""


def shortened(texts: Iterable[str], most: int = MOST_KEPT) -> tuple[str, ...]:
    """Distinct texts, at most ``most``, and a count of the others."""
    found = tuple(dict.fromkeys(texts))
    left = len(found) - most
    return found if left <= 0 else (*found[:most], f"... and {left} more")
