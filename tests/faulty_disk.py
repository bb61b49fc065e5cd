# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated disk with one failing step of writing: a write, close, flush, or rename."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from hfx_blender.files import atomic

_ERRNOS = (errno.ENOSPC, errno.EFBIG, errno.EIO, errno.EDQUOT)


class Disk:
    """Counter of writing steps with one failing step."""

    def __init__(self, failing: int | None) -> None:
        self.steps = 0
        self._failing = failing

    def step(self, *names: object) -> None:
        self.steps += 1
        if self.steps - 1 == self._failing:
            number = _ERRNOS[self.steps % len(_ERRNOS)]
            named = (str(names[0]), None, str(names[1])) if len(names) == 2 else ()
            raise OSError(number, os.strerror(number), *named)


@contextmanager
def faulty_disk(failing: int | None = None) -> Iterator[Disk]:
    """Count the steps of atomic files in the context, and fail step ``failing``."""
    disk = Disk(failing)

    class Raw(io.FileIO):
        def write(self, content: Any) -> int:
            disk.step()
            return super().write(content)

        def close(self) -> None:
            is_first = not self.closed
            super().close()
            if is_first:
                disk.step()

    def counted(call: Callable[..., Any]) -> Callable[..., Any]:
        def step(*arguments: Any, **more: Any) -> Any:
            disk.step(*arguments)
            return call(*arguments, **more)

        return step

    with pytest.MonkeyPatch.context() as patch:
        for name in ("fsync", "replace"):
            patch.setattr(atomic.os, name, counted(getattr(os, name)))
        atomic.WatchedFile.__bases__ = (Raw,)
        try:
            yield disk
        finally:
            atomic.WatchedFile.__bases__ = (io.FileIO,)
