# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender scene.blend --command hfx export ...``: our command line inside Blender's own."""

from __future__ import annotations

from typing import Any

import bpy

from ..processes import blender_session

_handle: Any = None


def _run(arguments: list[str]) -> int:
    from .. import cli
    from ..processes import import_path

    if blender_session.inside_blender():
        import_path.protect()  # the process is this command's, and ends with it
    try:
        return cli.run(arguments, prog="blender --command hfx")
    except SystemExit as finished:  # --help
        return finished.code if isinstance(finished.code, int) else 0


def register() -> None:
    global _handle
    # Blender's Python module has no command line. It would let go of the handle when the process
    # ends, after Python has: 4.5 crashes (BPyCommandHandler's destructor asks for Python's lock).
    if blender_session.inside_blender():
        _handle = bpy.utils.register_cli_command("hfx", _run)


def unregister() -> None:
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
