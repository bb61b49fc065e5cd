# SPDX-License-Identifier: GPL-3.0-or-later
"""Clock of the output process, which goes on while the computer sleeps; replaceable in tests."""

from __future__ import annotations

import sys
import threading
import time


class Clock:
    """Clock of the computer; tests have a clock with the same methods."""

    def now(self) -> float:
        """Monotonic time in seconds, including sleeps of the computer; the origin is arbitrary."""
        # ``time.monotonic`` stops in a sleep on Linux and macOS, and goes on elsewhere.
        if sys.platform == "linux":
            return time.clock_gettime(time.CLOCK_BOOTTIME)
        if sys.platform == "darwin":
            return time.clock_gettime(time.CLOCK_MONOTONIC)
        return time.monotonic()

    def wait(self, condition: threading.Condition, seconds: float) -> None:
        """Wait for the notification of a condition that is held, for ``seconds`` at most."""
        condition.wait(seconds)


SYSTEM = Clock()
