# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine with and without the compiled library."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import pytest

from hfx_blender.engine.native import library

needs_library = pytest.mark.skipif(not library.is_there(), reason="no library was built")


@contextmanager
def by_reference() -> Iterator[None]:
    """Disable the library in the context; contacts are computed by definition."""
    with mock.patch.object(library, "is_there", lambda: False):
        yield
