# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of ``hfx_tools``, missing in the extension's zip."""

import importlib
from collections.abc import Sequence
from types import ModuleType
from typing import Final

from ..errors import UsageError
from ..processes.tools_package import has_tools, tools_module

COMMANDS: Final = (
    *("demo", "export", "sound", "info", "validate", "convert", "play", "feel", "study"),
    *("body", "device", "bridge", "profile", "texture", "bench", "doctor"),
)
"""All commands of pip's ``hfx``, in the order of the help text."""
_IN_EXTENSION: Final = ("export", "doctor")


def module(name: str) -> ModuleType | None:
    """Import the module of a command; None for a command missing in an installed extension."""
    if name in _IN_EXTENSION:
        return importlib.import_module(f".{name}", __package__)
    return tools_module(f"commands.{name}")


def refuse(arguments: Sequence[str]) -> None:
    """Raise UsageError for a command missing in this installation, with the way to get it."""
    is_left_out = arguments and arguments[0] in COMMANDS and arguments[0] not in _IN_EXTENSION
    if is_left_out and not has_tools():
        raise UsageError(
            f"'{arguments[0]}' is not part of the extension: install hfx-blender with pip, then "
            "run it as 'hfx'."
        )
