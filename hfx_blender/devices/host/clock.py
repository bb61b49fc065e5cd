# SPDX-License-Identifier: GPL-3.0-or-later
"""The clock of the output process: it goes on while the computer sleeps. Tests bring their own."""

from __future__ import annotations

import sys
import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Interface of a clock that waits."""

    def now(self) -> float:
        """Seconds since some moment; monotonic, and counts while the computer sleeps."""

    def wait(self, condition: threading.Condition, seconds: float) -> None:
        """Wait for the notification of a condition, which is held, up to a time limit."""


class SystemClock:
    """The computer's clock."""

    def now(self) -> float:
        # Elsewhere ``time.monotonic`` counts a sleep; here it does not.
        if sys.platform == "linux":
            return time.clock_gettime(time.CLOCK_BOOTTIME)
        if sys.platform == "darwin":
            return time.clock_gettime(time.CLOCK_MONOTONIC)
        return time.monotonic()

    def wait(self, condition: threading.Condition, seconds: float) -> None:
        condition.wait(seconds)


SYSTEM = SystemClock()
