# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of commands."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hfx_blender.files.atomic import unfinished
from hfx_blender.files.staging import remove_tree


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Context with a new folder in the system's temporary folder; also removed by signals."""
    with tempfile.TemporaryDirectory(prefix="hfx-", ignore_cleanup_errors=True) as name:
        with unfinished(Path(name), remove_tree):
            yield Path(name)
