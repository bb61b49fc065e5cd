# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine with the compiled library and without it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from unittest import mock

import pytest

from hfx_blender.engine.contact import compiled_target
from hfx_blender.engine.native import (
    clusters,
    skin,
    skin_binding,
    skin_filling,
    skin_outline,
    turning,
    volume_boxes,
)
from hfx_blender.engine.native.library import library

needs_library = pytest.mark.skipif(library() is None, reason="no library was built")

_PARTS = (
    clusters,
    skin,
    skin_binding,
    skin_filling,
    skin_outline,
    compiled_target,
    turning,
    volume_boxes,
)


@contextmanager
def in_numpy() -> Iterator[None]:
    """Context without the library, for volumes that have a formula."""
    with ExitStack() as without:
        for part in _PARTS:
            without.enter_context(mock.patch.object(part, "_calls", lambda: None))
        yield
