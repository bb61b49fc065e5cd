# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scenes as .blend files of the user."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hfx_blender.errors import OutputError
from hfx_blender.processes import blender_session


def build_and_open(build: Callable[[], object], path: Path) -> None:
    """Build a scene, save the file, and open the file.

    Raises
    ------
    OutputError
        Blender cannot save the file.
    """
    import bpy

    build()
    forget_folders()
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)
    except RuntimeError as error:
        raise OutputError(f"{path}: Blender cannot save it ({str(error).strip()}).") from error
    blender_session.open_blend(path)


def forget_folders() -> None:
    """Clear the folders of file browsers: Blender sets the home folder of the user. Called before
    a file is saved for others."""
    import bpy

    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "FILE_BROWSER" and space.params is not None:
                    # Blender saves the whole buffer, with the end of a longer folder before.
                    space.params.directory = b"/" * 1023
                    space.params.directory = b"//"
