# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlaps work in a thread with the production of its input.

Blender lets other threads run while it steps a scene, and so does compiled code. What is made
and what is worked out, in which order, does not depend on it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from queue import Empty, Full, Queue, SimpleQueue
from threading import Event, Thread
from typing import Final, Generic, TypeVar

Made = TypeVar("Made")
Done = TypeVar("Done")

_AHEAD: Final = 3
"""Things that wait to be worked on: more would only be held."""

_TURN_S: Final = 1e-4
"""Time that a thread keeps the interpreter while another waits for it, seconds. Python's own 5 ms
are several times the time to step a frame."""

_LOOK_S: Final = 0.05
"""Interval at which a waiting thread checks that the other is still there, seconds."""


class _StoppedError(Exception):
    """Raised where nobody wants the rest of the work."""


class _Worker(Generic[Made, Done]):
    """Worker thread with its input and output queues."""

    def __init__(self, work: Callable[[Iterator[Made]], Generator[Done, None, None]]) -> None:
        self._work = work
        self._made: Queue[tuple[Made] | None] = Queue(_AHEAD)  # None: that was all
        self._done: SimpleQueue[Done] = SimpleQueue()
        self._error: BaseException | None = None
        self._is_stopped = False
        # Not Thread.join: one that Ctrl-C interrupts takes the thread for ended (CPython 3.11).
        self._has_ended = Event()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for each in self._work(self._taken()):
                self._done.put(each)
        except _StoppedError:
            pass
        except BaseException as error:  # told where it is waited for
            self._error = error
        finally:
            self._has_ended.set()

    def _taken(self) -> Iterator[Made]:
        while True:
            try:
                item = self._made.get(timeout=_LOOK_S)
            except Empty:
                item = None
                if not self._is_stopped:
                    continue
            if self._is_stopped:
                raise _StoppedError
            if item is None:
                return
            yield item[0]

    def put(self, item: tuple[Made] | None) -> None:
        """Put an item into the queue, None at the end, as soon as there is room."""
        while True:
            self._raise_error()
            try:
                return self._made.put(item, timeout=_LOOK_S)
            except Full:
                continue

    def results_since(self) -> list[Done]:
        """Results since the last call."""
        found = []
        while not self._done.empty():
            found.append(self._done.get())
        return found

    def wait_for_end(self) -> bool:
        """Wait a little, and test for the end of the work."""
        if not self._has_ended.wait(_LOOK_S):
            return False
        self._raise_error()
        return True

    def stop(self) -> None:
        """Stop the thread before the next item."""
        self._is_stopped = True
        self._has_ended.wait()
        self._thread.join()

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        try:
            if error is not None:
                raise error
        finally:
            del error  # nor may its traceback hold us, and so whoever waits here


def overlapped(
    source: Iterator[Made], work: Callable[[Iterator[Made]], Generator[Done, None, None]]
) -> Generator[list[Done], None, None]:
    """Run a generator ``work`` in a thread on what ``source`` yields; yields lists of its results.

    ``source`` is asked in this thread, ``work`` runs in another one, a little behind. After each
    thing that the source gave there is a list, perhaps an empty one, and at the end one now and
    then until all is done. What either of them raises is raised here. Whoever stops asking has
    ended the thread.
    """
    with _short_turns():
        worker = _Worker(work)
        try:
            for item in source:
                worker.put((item,))
                yield worker.results_since()
            worker.put(None)
            while not worker.wait_for_end():
                yield worker.results_since()
        finally:
            worker.stop()
        yield worker.results_since()


def sequentially(
    source: Iterator[Made], work: Callable[[Iterator[Made]], Generator[Done, None, None]]
) -> Generator[list[Done], None, None]:
    """Sequential version of :func:`overlapped`, in this thread."""
    with closing(work(source)) as done:
        for each in done:
            yield [each]


@contextmanager
def _short_turns() -> Iterator[None]:
    """Context in which threads switch more often, for threads that wait for each other."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, _TURN_S))
    try:
        yield
    finally:
        sys.setswitchinterval(before)
