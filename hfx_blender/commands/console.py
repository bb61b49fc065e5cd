# SPDX-License-Identifier: GPL-3.0-or-later
"""Output of the command line: results, messages, and progress of long work."""

import errno
import json
import os
import shutil
import sys
import time
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, TextIO

from ..engine.stepwise import progress_shown
from ..processes import process_end
from ..text import printable, printable_lines


class Console:
    """Output of a command: text for a terminal or file, or a JSON value with ``--json``. Results go
    to standard output, messages and progress to standard error, with control characters escaped. A
    closed pipe is ignored; the first other write error of results is stored in ``fault``."""

    def __init__(
        self, *, as_json: bool = False, out: TextIO | None = None, err: TextIO | None = None
    ) -> None:
        self.as_json = as_json
        self._out = out or sys.stdout
        self._err = err or sys.stderr
        self._live = self._err.isatty() and not as_json
        self._shown = 0
        self.fault: OSError | None = None  # first error of writing results

    def say(self, text: str = "", *, several_lines: bool = False) -> None:
        """Write a line, or several lines, to standard output; nothing with ``--json``."""
        self._clear()
        if not self.as_json:
            self._write(self._out, _shown(text, several_lines) + "\n")

    def warn(self, text: str, *, several_lines: bool = False) -> None:
        """Write a line, or several lines, to standard error."""
        self._clear()
        self._write(self._err, _shown(text, several_lines) + "\n")

    def result(self, value: Any) -> None:
        """Write the machine-readable result; nothing without ``--json``."""
        if self.as_json:
            self._write(self._out, json.dumps(value, indent=1, sort_keys=True) + "\n")

    def progress(self, title: str) -> "Progress":
        """Make a progress bar with the remaining time; visible on a terminal only."""
        return Progress(self, title)

    def reading(self, path: Path) -> AbstractContextManager[None]:
        """Context with a progress bar for a file that is read or converted."""
        return progress_shown(self.progress(path.name))

    def show(self, line: str) -> None:
        """Overwrite the progress line, cut to the width of the terminal."""
        if self._live:
            # A carriage return cannot overwrite a wrapped line.
            line = printable(line)[: shutil.get_terminal_size().columns - 1]
            self._write(self._err, "\r" + line.ljust(self._shown))
            self._shown = len(line)

    def _clear(self) -> None:
        if self._shown:
            self._write(self._err, "\r" + " " * self._shown + "\r")
            self._shown = 0

    def _write(self, stream: TextIO, text: str) -> None:
        try:
            stream.write(text)
            stream.flush()
        except OSError as error:
            if stream is self._out and not is_unread(error):
                self.fault = error
            # Python writes the buffered rest at exit and would fail again: to the null device.
            with suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())
                os.close(nowhere)


def is_unread(error: OSError) -> bool:
    """Test a write error for a closed pipe (``hfx info x | head``)."""
    return error.errno in (errno.EPIPE, errno.EINVAL)  # the latter on Windows


def _shown(text: str, several_lines: bool) -> str:
    return printable_lines(text) if several_lines else printable(text)


class Progress:
    """Progress of a task; call with the finished share, 0..1. Each call raises TerminatedError
    after a signal to end the process."""

    _WIDTH = 24
    _INTERVAL_S = 0.1
    _TITLE = 30

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._title = title if len(title) <= self._TITLE else title[: self._TITLE - 3] + "..."
        self._start = time.monotonic()
        self._next = self._start

    def __call__(self, share: float, text: str = "") -> None:
        # Long work shows its progress often, so a signal is noticed here.
        process_end.check()
        now = time.monotonic()
        if now < self._next and share < 1.0:
            return
        # Terminals are slow: ten lines a second at most.
        self._next = now + self._INTERVAL_S
        filled = int(share * self._WIDTH)
        bar = "#" * filled + "." * (self._WIDTH - filled)
        left = ""
        if share > 0.02:
            minutes, rest = divmod(round((now - self._start) * (1 - share) / share), 60)
            left = f"  {minutes} min {rest:02d} s left" if minutes else f"  {rest} s left"
        self._console.show(f"{self._title} [{bar}] {share:4.0%}{left} {text}".rstrip())
