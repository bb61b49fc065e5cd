# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine with the compiled library, with the phases of contact in numpy, and without it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import pytest

from hfx_blender.engine.contact import accumulator, compiled_contacts
from hfx_blender.engine.native import library

needs_library = pytest.mark.skipif(not library.is_there(), reason="no library was built")


@contextmanager
def in_numpy() -> Iterator[None]:
    """Context in which volumes that have a formula go the way of meshes and of details."""
    with (
        mock.patch.object(compiled_contacts, "is_possible", lambda query: False),
        mock.patch.object(accumulator, "is_known", lambda shapes: False),
    ):
        yield


@contextmanager
def by_reference() -> Iterator[None]:
    """Context without the library: contacts are computed by their definition."""
    with mock.patch.object(library, "is_there", lambda: False):
        yield
