# SPDX-License-Identifier: GPL-3.0-or-later
"""Process for the demo's pictures: ``picture_process SCENE TRACK FOLDER``.

In a separate process a crash of Blender's renderer costs the pictures only.
"""

from __future__ import annotations

import sys
from pathlib import Path

from hfx_blender.processes import blender_session

from ..command_process.signal_watch import leave


def main() -> None:
    """Draw the pictures of a scene and its track into a folder; exit code 1 after a fault."""
    code = 0
    try:
        blender_session.start()  # before any import of bpy, to clean up temporary files
        from .avatar_pictures import draw

        draw(*map(Path, sys.argv[1:4]))
    except Exception as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        code = 1
    leave(code)


if __name__ == "__main__":
    main()
