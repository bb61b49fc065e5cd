# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in steps, for progress and cancelling.

A generator yields the completed fraction and returns its result. Closing the generator undoes
unfinished work, like an error.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

Progress = Callable[[float], None]
_T = TypeVar("_T")


def finish(steps: Generator[float, None, _T], progress: Progress = lambda share: None) -> _T:
    """Run all steps and return the generator's result; ``progress`` is called with each yielded
    fraction."""
    while True:
        try:
            progress(next(steps))
        except StopIteration as end:
            result: _T = end.value
            return result


def within(
    steps: Generator[float, None, _T], start: float, end: float
) -> Generator[float, None, _T]:
    """Yield the fractions 0..1 of ``steps`` scaled to ``start`` .. ``end``; returns the generator's
    result."""
    while True:
        try:
            share = next(steps)
        except StopIteration as stop:
            result: _T = stop.value
            return result
        yield start + (end - start) * share
