# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of measurements and of the demo: programs given as source, run to their end."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence

from hfx_blender.processes.start import python_command, start


def run(command: Sequence[str], limit_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run a process of this package to its end, and return its output.

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


def program(source: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line of a program that is given as its source, and may import this package."""
    return [*python_command(), "-c", source, *map(os.fspath, arguments)]
