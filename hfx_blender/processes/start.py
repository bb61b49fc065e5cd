# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of this package's own modules, that it starts to work beside it, and their pipes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ..files import resources
from .startup import absolute

_START: Final = Path(__file__).resolve().with_name("child.py")
_started: dict[int, weakref.ref[subprocess.Popen[Any]]] = {}
_LOOK_S: Final = 0.01
ended: list[bool] = []  # not empty: this process ends, and starts no other


def command(module: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line of a module, by its name within the package: ``generation.generation_process``.

    A module of ``hfx_tools`` is given by its full name.
    """
    name = module if module.startswith("hfx_tools.") else f"hfx_blender.{module}"
    return [*python_command(), name, *map(os.fspath, arguments)]


def python_command() -> list[str]:
    """Command line of Python up to the module or program that it shall run."""
    # The wheels of a Blender extension are in a folder that its Python does not know by itself.
    packages = [path for path in sys.path if os.path.basename(path) == "site-packages"]
    # -P: a child never imports from the current folder, where a stranger's files may lie.
    options = ["-P", "-s"] if sys.flags.no_user_site else ["-P"]
    return [
        *(sys.executable, *options, str(_START)),
        os.pathsep.join(dict.fromkeys(filter(os.path.isabs, packages))),
    ]


def start(
    command: Sequence[str], variables: Mapping[str, str] | None = None, **settings: Any
) -> subprocess.Popen[Any]:
    """Start a process of this package: the only place where processes are started.

    Parameters
    ----------
    command : sequence of str
        As :func:`command` gives it.
    variables : mapping, optional
        Of its environment, besides those of :func:`environment`.
    settings
        Of :class:`subprocess.Popen`.

    Raises
    ------
    OSError
        It cannot be started, or this process is ending.
    """
    if ended:
        raise OSError("this process is ending")
    settings.setdefault("creationflags", getattr(subprocess, "CREATE_NO_WINDOW", 0))
    process = subprocess.Popen(command, env={**environment(), **(variables or {})}, **settings)
    _started[process.pid] = weakref.ref(process)
    return process


def end_all(limit_s: float) -> None:
    """End all processes that were started here; those that do not end within a time are killed.

    No other is started afterwards: this process ends.
    """
    ended.append(True)
    known = [reference() for reference in list(_started.values())]
    running = [process for process in known if process is not None and process.poll() is None]
    if os.name == "nt":  # there it would be a kill; they end with their input
        running = [process for process in running if process.stdin is None]
    for process in running:
        with suppress(OSError):
            process.terminate()
    until = time.monotonic() + limit_s
    while time.monotonic() < until and any(process.poll() is None for process in running):
        time.sleep(_LOOK_S)
    for process in running:
        with suppress(OSError):
            process.kill()


def is_child() -> bool:
    """Test that this process was started by :func:`start`."""
    return str(_START) in sys.orig_argv


def environment() -> dict[str, str]:
    """Environment of a process of this package: with the user's model folders and import paths,
    without entries of PYTHONPATH relative to the current folder."""
    # A Blender heeds none of Python's variables. Nor does what it starts.
    ignored = "PYTHON" if sys.flags.ignore_environment else ()
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ignored)}
    if "PYTHONPATH" in kept:
        kept["PYTHONPATH"] = os.pathsep.join(absolute(kept["PYTHONPATH"]))
    return {**kept, resources.BODY_MODELS_VARIABLE: str(resources.user_body_models())}


def cores() -> int:
    """Number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
