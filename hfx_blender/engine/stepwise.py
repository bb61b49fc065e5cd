# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in steps, for progress and cancelling.

A generator yields the completed fraction and returns its result. Closing the generator undoes
unfinished work, like an error.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, TypeVar

Progress = Callable[[float], None]
_T = TypeVar("_T")

_PROGRESS: Final[ContextVar[Progress | None]] = ContextVar("progress", default=None)


@contextmanager
def progress_shown(progress: Progress) -> Iterator[None]:
    """Context in which :func:`tell` calls ``progress``, in this thread."""
    token = _PROGRESS.set(progress)
    try:
        yield
    finally:
        _PROGRESS.reset(token)


def tell(share: float) -> None:
    """Report the finished fraction of a long loop, such as reading a large file; does nothing
    outside of :func:`progress_shown`."""
    if (progress := _PROGRESS.get()) is not None:
        progress(share)


def finish(steps: Generator[float, None, _T], progress: Progress = tell) -> _T:
    """Run all steps and return the generator's result; ``progress`` gets each yielded fraction."""
    while True:
        try:
            progress(next(steps))
        except StopIteration as end:
            result: _T = end.value
            return result


def within(
    steps: Generator[float, None, _T], start: float, end: float
) -> Generator[float, None, _T]:
    """Yield fractions 0..1 of ``steps`` scaled to ``start`` .. ``end``; returns their result."""
    while True:
        try:
            share = next(steps)
        except StopIteration as stop:
            result: _T = stop.value
            return result
        yield start + (end - start) * share
