# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in steps, between which the caller may show progress or cancel.

Such work is a generator: it yields the share that is done and returns its result. Closing it
early undoes what it has begun, as an error would.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

Progress = Callable[[float], None]
_T = TypeVar("_T")


def finish(steps: Generator[float, None, _T], progress: Progress = lambda share: None) -> _T:
    """Do all steps, and return the result."""
    while True:
        try:
            progress(next(steps))
        except StopIteration as end:
            result: _T = end.value
            return result


def within(
    steps: Generator[float, None, _T], start: float, end: float
) -> Generator[float, None, _T]:
    """Steps as a part of longer work, of which they do the shares from ``start`` to ``end``."""
    while True:
        try:
            share = next(steps)
        except StopIteration as done:
            result: _T = done.value
            return result
        yield start + (end - start) * share
