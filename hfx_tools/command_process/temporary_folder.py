# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of commands."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from hfx_blender.files.atomic import placing, unfinished
from hfx_blender.files.staging import remove_tree


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Context with a new folder in the system's temporary folder; also removed by signals."""
    with ExitStack() as stack:
        with placing:
            folder = Path(tempfile.mkdtemp(prefix="hfx-"))
            stack.enter_context(unfinished(folder, remove_tree))
        stack.callback(remove_tree, folder)
        yield folder
