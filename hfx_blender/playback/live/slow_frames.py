# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames for which Blender needs longer than devices wait, and our part in them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

SLOW_S: Final = 0.2
"""Duration of a frame that devices may not survive, seconds; their limit is a little longer."""


@dataclass(frozen=True)
class SlowFrame:
    """Frame for which Blender's main thread needed long."""

    whole_s: float
    own_s: float  # of it to evaluate what is felt

    def __str__(self) -> str:
        return (
            f"Blender needed {self.whole_s:.1f} s for a frame, {self.own_s:.1f} s of it for touch; "
            "devices stop after 0.25 s without a sign of life."
        )


class SlowFrames:
    """Finds slow frames by the pauses between signs of life.

    Attributes
    ----------
    newest : SlowFrame or None
    """

    def __init__(self) -> None:
        self.newest: SlowFrame | None = None
        self._sign_s, self._own_s = time.monotonic(), 0.0

    def sign(self) -> None:
        """Take a sign of life of Blender's main thread."""
        now = time.monotonic()
        if now - self._sign_s > SLOW_S:
            self.newest = SlowFrame(now - self._sign_s, self._own_s)
        self._sign_s, self._own_s = now, 0.0

    @contextmanager
    def own_work(self) -> Iterator[None]:
        """Context in which what is felt is evaluated."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self._own_s += time.monotonic() - begun
