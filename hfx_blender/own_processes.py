# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of this package's own modules, that it starts to work beside it, and their pipes."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO, Final

from . import resources

_PACKAGE: Final = Path(__file__).resolve().parent  # in an extension, it has another name there


def command(module: str) -> list[str]:
    """What starts a module, given by its name within the package, as ``batch.worker``."""
    return [sys.executable, "-m", f"{_PACKAGE.name}.{module}"]


def environment() -> dict[str, str]:
    """In which a process finds this package, the packages beside it, and the user's models."""
    # The wheels of a Blender extension are in a folder that its Python does not know by itself.
    packages = [path for path in sys.path if Path(path).name == "site-packages"]
    paths = [str(_PACKAGE.parent), *packages, os.environ.get("PYTHONPATH", "")]
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path for path in dict.fromkeys(paths) if path),
        resources.BODY_MODELS_VARIABLE: str(resources.user_body_models()),
    }


def cores() -> int:
    """How many processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def read_exactly(stream: IO[bytes], count: int) -> bytes | None:
    """So many bytes of a pipe, which gives what it has; None if it ends before."""
    parts = []
    while count:
        part = stream.read(count)
        if not part:
            return None
        parts.append(part)
        count -= len(part)
    return b"".join(parts)
