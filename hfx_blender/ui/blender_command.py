# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender scene.blend --command hfx export ...``: our command line inside Blender's own."""

from __future__ import annotations

from typing import Any

import bpy

_handle: Any = None


def _run(arguments: list[str]) -> int:
    from .. import cli

    try:
        return cli.run(arguments, prog="blender --command hfx")
    except SystemExit as finished:  # --help
        return finished.code if isinstance(finished.code, int) else 0


def register() -> None:
    global _handle
    _handle = bpy.utils.register_cli_command("hfx", _run)


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handle)
