# SPDX-License-Identifier: GPL-3.0-or-later
"""Process of pip's command ``hfx``: standard streams, signals and exit."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from hfx_blender.cli import run, unprinted
from hfx_blender.commands.console import Console, is_unread

from .signal_watch import end_on_signals, leave


def main() -> None:
    """Run the command of ``sys.argv`` and end the process with the exit code."""
    _open_standard_streams()
    end_on_signals()
    try:
        code = _without_chatter(lambda: run(sys.argv[1:]))
    except SystemExit as finished:  # --help and --version
        code = finished.code if isinstance(finished.code, int) else 0
    except OSError as error:  # argparse prints without the console
        code = 0
        if not is_unread(error):
            code = unprinted(Console(), error)
    leave(code)


def _open_standard_streams() -> None:
    """Open missing standard streams (``hfx ... >&-``) on the null device. Otherwise the first
    opened files would get their descriptors, and prints would go there."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
        mode = "r" if number == 0 else "w"
        setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))


def _without_chatter(work: Callable[[], int]) -> int:
    """Run ``work`` without Blender's output on stdout; prints of Python still reach stdout. Blender
    writes to descriptor 1, past ``sys.stdout``. During the call descriptor 1 is the null device,
    and ``sys.stdout`` writes to a copy of the original descriptor."""
    sys.stdout.flush()
    # Blender writes to descriptor 1 directly, so it is descriptor 1 that is replaced.
    original = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    stream = sys.stdout
    try:
        os.dup2(null, 1)
        with os.fdopen(
            original, "w", encoding=stream.encoding, errors="replace", closefd=False
        ) as copy:
            sys.stdout = copy
            return work()
    finally:
        sys.stdout = stream
        os.dup2(original, 1)
        os.close(original)
        os.close(null)
