# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands that an installation by pip has and the extension's zip has not.

The one place that knows the package ``maintenance``, by its name only: in an installed extension
there is no such folder.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence
from types import ModuleType
from typing import Final

from ..errors import UsageError

_PACKAGE: Final = f"{__package__.rpartition('.')[0]}.maintenance"
_COMMANDS: Final = (
    ("demo",),
    ("body",),
    ("bench",),
    ("texture", "board"),
    ("texture", "train-decoder"),
    ("texture", "train-relief"),
)


def module(name: str) -> ModuleType | None:
    """Import a module of ``maintenance.commands``; None in an installed extension."""
    return importlib.import_module(f"{_PACKAGE}.commands.{name}") if _is_there() else None


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
    if left_out and not _is_there():
        raise UsageError(
            f"'{' '.join(left_out[0])}' is not part of the extension: install hfx-blender with "
            "pip, then run it as 'hfx'."
        )


def _is_there() -> bool:
    return importlib.util.find_spec(_PACKAGE) is not None
