# SPDX-License-Identifier: GPL-3.0-or-later
"""Start and end of processes with modules of this package: command line, environment."""

import os
import subprocess
import sys
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from ..files import resources
from .startup import absolute

CHILD: Final = Path(__file__).resolve().with_name("child.py")
started: dict[int, weakref.ref[subprocess.Popen[Any]]] = {}
"""Processes of :func:`start` by process id; also ended ones."""
ended: list[bool] = []  # not empty: this process is ending and starts no process


def command(module: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line of a module, by its name within the package: ``devices.host.host``. Modules of
    ``hfx_tools`` have their full name."""
    name = module if module.startswith("hfx_tools.") else f"hfx_blender.{module}"
    return [*python_command(), name, *map(os.fspath, arguments)]


def python_command() -> list[str]:
    """Command line up to the module or ``-c``: Python, -P, child.py, site-packages folders."""
    # Blender adds the folder of an extension's wheels to sys.path; a plain Python lacks it.
    packages = [path for path in sys.path if os.path.basename(path) == "site-packages"]
    # -P: a child never imports from the current folder, which may hold downloaded files.
    options = ["-P", "-s"] if sys.flags.no_user_site else ["-P"]
    return [
        *(sys.executable, *options, str(CHILD)),
        os.pathsep.join(dict.fromkeys(filter(os.path.isabs, packages))),
    ]


def start(
    command: Sequence[str], variables: Mapping[str, str] | None = None, **settings: Any
) -> subprocess.Popen[Any]:
    """Start a process of this package; all processes are started here.

    ``command`` is a result of :func:`command`; ``variables`` are environment variables besides
    those of :func:`environment`; ``settings`` are arguments of :class:`subprocess.Popen`. Raises
    OSError if the process cannot be started, or if this process is ending.
    """
    if ended:
        raise OSError("this process is ending")
    settings.setdefault("creationflags", getattr(subprocess, "CREATE_NO_WINDOW", 0))
    process = subprocess.Popen(command, env={**environment(), **(variables or {})}, **settings)
    # Weak, as an entry must not keep ended processes alive.
    started[process.pid] = weakref.ref(process)
    return process


def environment() -> dict[str, str]:
    """Environment of a child: this process's, and the user's folder of body models; only absolute
    entries of PYTHONPATH; no Python variables if this Python ignores them."""
    # Blender ignores Python's variables, and so do the processes that it starts.
    ignored = "PYTHON" if sys.flags.ignore_environment else ()
    variables = {name: value for name, value in os.environ.items() if not name.startswith(ignored)}
    if "PYTHONPATH" in variables:
        variables["PYTHONPATH"] = os.pathsep.join(absolute(variables["PYTHONPATH"]))
    return {**variables, resources.BODY_MODELS_VARIABLE: str(resources.user_body_models())}


def cores() -> int:
    """Number of processor cores that this process may use, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
