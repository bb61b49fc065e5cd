# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of measurements and of the demo: programs given as source, run to the end."""

from __future__ import annotations

import math
import os
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from hfx_blender.processes.process_end import check
from hfx_blender.processes.start import python_command, start

_CHECK_S: Final = 0.1
"""Interval of checks for a termination signal during waiting, seconds."""

_END_LIMIT_S: Final = 2.0
"""Seconds for a terminated process to remove temporary files, before it is killed."""


def run(command: Sequence[str], limit_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run a process of this package to its end, and return exit code and output.

    Raises
    ------
    OSError
        The process cannot be started.
    subprocess.TimeoutExpired
        The process took longer than ``limit_s`` and has been ended.
    TerminatedError
        A signal to end this process arrived; the started process has been ended, too.
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with start(command, text=True, **pipes) as process:
        try:
            out, err = _communicate(process, math.inf if limit_s is None else limit_s)
        except BaseException:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_LIMIT_S)
            process.kill()
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _communicate(process: subprocess.Popen[Any], limit_s: float) -> tuple[str, str]:
    until_s = time.monotonic() + limit_s
    while True:
        try:
            output = process.communicate(timeout=min(_CHECK_S, until_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            if time.monotonic() >= until_s:
                raise
            check()
            continue
        check()  # the signal may have gone to both processes
        return output


def program(source: str, *arguments: str | os.PathLike[str]) -> list[str]:
    """Command line for a program given as source, with this package importable."""
    return [*python_command(), "-c", source, *map(os.fspath, arguments)]
