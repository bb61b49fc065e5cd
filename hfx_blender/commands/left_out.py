# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that an installation by pip has and the extension's zip has not.

The one place that knows the package ``hfx_tools``, by its name only: an installed extension has
no such package.
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
_COMMANDS: Final = (
    ("demo",),
    ("body",),
    ("bench",),
    ("texture", "board"),
    ("texture", "train-decoder"),
    ("texture", "train-relief"),
)


def module(name: str) -> ModuleType | None:
    """Import a module of ``hfx_tools.commands``; None in an installed extension."""
    return importlib.import_module(f"{PACKAGE}.commands.{name}") if _load_tools() else None


def refuse(arguments: Sequence[str]) -> None:
    """Say where a command is that is left out.

    Raises
    ------
    UsageError
        The arguments begin with one, and it is not there.
    """
    left_out = [names for names in _COMMANDS if tuple(arguments[: len(names)]) == names]
    if "--back-end=diffusers" in "=".join(arguments):
        left_out.append(("--back-end", "diffusers"))
    if left_out and not _load_tools():
        raise UsageError(
            f"'{' '.join(left_out[0])}' is not part of the extension: install hfx-blender with "
            "pip, then run it as 'hfx'."
        )


def _load_tools() -> bool:
    """Import the package ``hfx_tools``; return whether it lies beside this package."""
    if PACKAGE in sys.modules:
        return True
    # Beside this package only: elsewhere a package of that name is a stranger's. Beside an
    # extension, whose name is longer, it is one, too.
    beside = [str(Path(__file__).resolve().parents[2])]
    spec = PathFinder.find_spec(PACKAGE, beside)
    if __package__.count(".") > 1 or spec is None or spec.loader is None:
        return False
    sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[PACKAGE])
    return True
