# SPDX-License-Identifier: GPL-3.0-or-later
"""Text of strangers (names of scenes, effects, files) made safe to show on a terminal."""

from __future__ import annotations

import re
from typing import Final

_UNSAFE: Final = re.compile(
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
    return _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)


def printable_lines(text: str) -> str:
    """Escape each line of a text; its line ends stay."""
    return "\n".join(map(printable, text.split("\n")))
