# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine with the compiled library and without it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import pytest

from hfx_blender.engine.native import reach, skin
from hfx_blender.engine.native.library import library

needs_library = pytest.mark.skipif(library() is None, reason="no library was built")


@contextmanager
def in_numpy() -> Iterator[None]:
    """Without the library, for what is felt of volumes that have a formula."""
    with (
        mock.patch.object(reach, "_calls", lambda: None),
        mock.patch.object(skin, "_calls", lambda: None),
    ):
        yield
