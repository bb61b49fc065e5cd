# SPDX-License-Identifier: GPL-3.0-or-later
"""Thread pool for compiled code that runs while Python goes on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Done = TypeVar("Done")


class Threads:
    """Thread pool that measures its working time.

    Parameters
    ----------
    count : int
        At most; they are started when there is work.
    """

    def __init__(self, count: int) -> None:
        self._executor = ThreadPoolExecutor(count, "hfx")
        self._lock = threading.Lock()
        self._busy_s = 0.0

    @property
    def busy_s(self) -> float:
        """Processor seconds that work of theirs has taken."""
        return self._busy_s

    def submit(self, work: Callable[[], Done]) -> Future[Done]:
        """Submit a call to one of the threads."""
        return self._executor.submit(self._timed, work)

    def _timed(self, work: Callable[[], Done]) -> Done:
        start_s = time.thread_time()
        try:
            return work()
        finally:
            with self._lock:
                self._busy_s += time.thread_time() - start_s
