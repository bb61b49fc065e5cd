# SPDX-License-Identifier: GPL-3.0-or-later
"""Clock of the output process, which goes on while the computer sleeps, replaceable in tests; and
short time slices."""

import ctypes
import os
import platform
import struct
import sys
import threading
import time
from typing import Final

_SLICE_NS: Final = 100_000
_SCHED_SETATTR: Final = {"x86_64": 314, "aarch64": 274}  # number of the system call


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


def shorten_slices() -> bool:
    """Request time slices of 0.1 ms for this thread, and for threads and processes that it starts
    later: on a busy computer a woken thread then runs before threads with longer slices. Linux
    6.12 and later; needs no permission. False if the system refuses, or has no such request."""
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform != "linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    # struct sched_attr of sched_setattr(2): size, policy, flags, nice, priority, runtime; the rest
    # is of other policies.
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attributes = struct.pack("=IIQiIQ24x", 56, os.SCHED_OTHER, 0, nice, 0, _SLICE_NS)
    return bool(ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0)
