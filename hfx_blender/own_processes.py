# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of this package's own modules, that it starts to work beside it, and their pipes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final

from . import import_path, resources

_PACKAGE: Final = Path(__file__).resolve().parent  # in an extension, it has another name there


def command(module: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line of a module, given by its name within the package, as ``batch.worker``."""
    return [*_PYTHON, "-m", f"{_PACKAGE.name}.{module}", *map(os.fspath, arguments)]


def program(source: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line of a program that is given as its source."""
    return [*_PYTHON, "-c", source, *map(os.fspath, arguments)]


_PYTHON: Final = (sys.executable, "-P")
"""-P: a child never imports from the current folder, where a stranger's files may lie."""


def start(
    command: Sequence[str], variables: Mapping[str, str] | None = None, **settings: Any
) -> subprocess.Popen[Any]:
    """Start a process of this package: every one of them is started here.

    Parameters
    ----------
    command : sequence of str
        Of :func:`command` or :func:`program`.
    variables : mapping, optional
        Of its environment, besides those of :func:`environment`.
    settings
        Of :class:`subprocess.Popen`.

    Raises
    ------
    OSError
        It cannot be started.
    """
    settings.setdefault("creationflags", getattr(subprocess, "CREATE_NO_WINDOW", 0))
    return subprocess.Popen(command, env={**environment(), **(variables or {})}, **settings)


def run(command: Sequence[str], limit_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run a process of this package to its end, and take what it prints.

    Raises
    ------
    OSError
        It cannot be started.
    subprocess.TimeoutExpired
        It took longer than ``limit_s``; it has been ended.
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with start(command, text=True, **pipes) as process:
        try:
            out, err = process.communicate(timeout=limit_s)
        except BaseException:
            process.kill()
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def environment() -> dict[str, str]:
    """Environment in which a process finds this package, the packages beside it, and the user's
    models; what PYTHONPATH names relative to the current folder is left out."""
    # The wheels of a Blender extension are in a folder that its Python does not know by itself.
    known = import_path.trusted(sys.path)
    packages = [path for path in known if Path(path).name == "site-packages"]
    inherited = import_path.absolute(os.environ.get("PYTHONPATH", ""))
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(dict.fromkeys([str(_PACKAGE.parent), *packages, *inherited])),
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
