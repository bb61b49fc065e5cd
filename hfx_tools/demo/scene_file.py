# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scenes as files that the user can open, change and export again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hfx_blender.errors import OutputError
from hfx_blender.processes import blender_session


def build_and_open(build: Callable[[], object], path: Path) -> None:
    """Build a scene, save it, and open the file like any other.

    Raises
    ------
    OutputError
        Blender cannot save it.
    """
    import bpy

    build()
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)
    except RuntimeError as error:
        raise OutputError(f"{path}: Blender cannot save it ({str(error).strip()}).") from error
    blender_session.open_blend(path)
