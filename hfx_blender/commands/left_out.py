# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of ``hfx_tools``, missing in the extension's zip.

Only this module imports the package ``hfx_tools``: an installed extension has none.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Final

from ..errors import UsageError

PACKAGE: Final = "hfx_tools"
COMMANDS: Final = (
    *("demo", "export", "sound", "info", "validate", "convert", "play", "feel", "study"),
    *("body", "device", "profile", "texture", "bench", "doctor"),
)
"""All commands of pip's ``hfx``, in the order of the help text."""
_IN_EXTENSION: Final = ("export", "doctor")


def module(name: str) -> ModuleType | None:
    """Import the module of a command; None for a command missing in an installed extension."""
    if name in _IN_EXTENSION:
        return importlib.import_module(f".{name}", __package__)
    return importlib.import_module(f"{PACKAGE}.commands.{name}") if _load_tools() else None


def refuse(arguments: Sequence[str]) -> None:
    """Raise UsageError for a command missing in this installation, with the way to get it."""
    is_left_out = arguments and arguments[0] in COMMANDS and arguments[0] not in _IN_EXTENSION
    if is_left_out and not _load_tools():
        raise UsageError(
            f"'{arguments[0]}' is not part of the extension: install hfx-blender with pip, then "
            "run it as 'hfx'."
        )


def _load_tools() -> bool:
    """Import the package ``hfx_tools``; False where it is missing next to this package."""
    if PACKAGE in sys.modules:
        return True
    # Search only the folder of this package: a package of that name elsewhere, or next to an
    # extension (``bl_ext...hfx_blender``), is another program's.
    spec = PathFinder.find_spec(PACKAGE, [str(Path(__file__).resolve().parents[2])])
    if __package__.count(".") > 1 or spec is None or spec.loader is None:
        return False
    sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[PACKAGE])
    return True
