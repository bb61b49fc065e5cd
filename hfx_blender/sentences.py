# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of sentences that tell how many things something concerns, and which."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

_SHOWN: Final = 6


def named(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def counted(names: Sequence[str], sentence: str) -> tuple[str, ...]:
    """A sentence about some effects or actuators, how many and which; none about nobody."""
    return (f"{sentence}: {len(names)} ({named(names)})",) if names else ()
