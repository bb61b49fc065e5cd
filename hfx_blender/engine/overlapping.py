# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlap of work in a thread with the production of its input.

Blender releases the interpreter while stepping a scene, as does compiled code. Items and results
are the same, in the same order, as without the thread.
"""

import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from queue import Empty, Full, Queue, SimpleQueue
from threading import Event, Thread
from typing import Final, Generic, TypeVar

Made = TypeVar("Made")
Done = TypeVar("Done")

_AHEAD: Final = 3  # largest number of items waiting for the thread; limits memory
_TURN_S: Final = 1e-4
"""Switch interval of the interpreter. Python's default of 5 ms is several times the time to step a
frame."""

_LOOK_S: Final = 0.05  # interval of checks for stop and errors while waiting


class _StoppedError(Exception):
    """Raised in the thread to abandon the work."""


class _Worker(Generic[Made, Done]):
    """Thread with queues of items and results."""

    def __init__(self, work: Callable[[Iterator[Made]], Generator[Done, None, None]]) -> None:
        self._work = work
        self._made: Queue[tuple[Made] | None] = Queue(_AHEAD)  # None: end
        self._done: SimpleQueue[Done] = SimpleQueue()
        self._error: BaseException | None = None
        self._is_stopped = False
        # Event instead of Thread.join: a join interrupted by Ctrl-C marks the thread as ended
        # (CPython 3.11).
        self._has_ended = Event()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        """Body of the thread: queue all results of the work, keep an error, and set the end."""
        try:
            for result in self._work(self._items()):
                self._done.put(result)
        except _StoppedError:
            pass
        except BaseException as error:  # raised in the waiting thread
            self._error = error
        finally:
            self._has_ended.set()

    def _items(self) -> Iterator[Made]:
        """Yield items until None; raises ``_StoppedError`` within 0.05 s after :meth:`stop`."""
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
        """Queue an item (None: end), waiting for room; raises an error that the thread has met."""
        # Without the time limit, a thread that ended by an error would block the caller for ever.
        while True:
            self._raise_error()
            try:
                return self._made.put(item, timeout=_LOOK_S)
            except Full:
                continue

    def results_since(self) -> list[Done]:
        """Results queued since the last call, in order; empty without any. Does not wait."""
        results = []
        while not self._done.empty():
            results.append(self._done.get())
        return results

    def wait_for_end(self) -> bool:
        """Wait up to 0.05 s; True if the thread has ended, without an error. Raises the thread's
        error once."""
        if not self._has_ended.wait(_LOOK_S):
            return False
        self._raise_error()
        return True

    def stop(self) -> None:
        """Make the thread end before its next item, and wait for its end."""
        # The event first: a join interrupted by Ctrl-C would leave the thread running.
        self._is_stopped = True
        self._has_ended.wait()
        self._thread.join()

    def _raise_error(self) -> None:
        """Raise the thread's error, if any, once."""
        error, self._error = self._error, None
        try:
            if error is not None:
                raise error
        finally:
            del error  # the traceback would keep this frame, and the worker, alive


def overlapped(
    source: Iterator[Made], work: Callable[[Iterator[Made]], Generator[Done, None, None]]
) -> Generator[list[Done], None, None]:
    """Run the generator ``work`` in a thread on items of ``source``; yield lists of its results.

    ``source`` runs in the calling thread. A list, possibly empty, is yielded after each item, and
    repeatedly at the end until all work is done. Errors of both are raised here. Closing the
    generator ends the thread.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, _TURN_S))
    try:
        worker = _Worker(work)
        try:
            for item in source:
                worker.put((item,))
                yield worker.results_since()
            # Results keep coming after the last item; the consumer gets each list without delay.
            worker.put(None)
            while not worker.wait_for_end():
                yield worker.results_since()
        finally:
            worker.stop()
        yield worker.results_since()
    finally:
        sys.setswitchinterval(before)


def sequentially(
    source: Iterator[Made], work: Callable[[Iterator[Made]], Generator[Done, None, None]]
) -> Generator[list[Done], None, None]:
    """Version of :func:`overlapped` without a thread: runs ``work`` on ``source`` here, and yields
    each result as a list of one."""
    with closing(work(source)) as done:
        for result in done:
            yield [result]
