# SPDX-License-Identifier: GPL-3.0-or-later
"""Output of the command line: results, messages, and progress of long work."""

from __future__ import annotations

import errno
import json
import os
import shutil
import sys
import time
from contextlib import suppress
from typing import Any, TextIO

from ..processes import process_end
from ..text import printable, printable_lines


class Console:
    """Text for people on a terminal, plain lines elsewhere, one JSON value with ``--json``.

    Progress and messages go to standard error, results to standard output. What steers a
    terminal is escaped. Where nobody reads, the work goes on; what could not be written because
    of a fault, such as a full disk, :attr:`fault` tells.
    """

    def __init__(
        self, *, as_json: bool = False, out: TextIO | None = None, err: TextIO | None = None
    ) -> None:
        self.as_json = as_json
        self._out = out or sys.stdout
        self._err = err or sys.stderr
        self._live = self._err.isatty() and not as_json
        self._shown = 0
        self.fault: OSError | None = None  # why results could not be written

    def say(self, text: str = "", *, several_lines: bool = False) -> None:
        """Write a line for people, or several; silent with ``--json``."""
        self._clear()
        if not self.as_json:
            self._write(self._out, _shown(text, several_lines) + "\n")

    def warn(self, text: str, *, several_lines: bool = False) -> None:
        """Write a line about something that is wrong, on standard error."""
        self._clear()
        self._write(self._err, _shown(text, several_lines) + "\n")

    def result(self, value: Any) -> None:
        """The machine-readable result, with ``--json`` only."""
        if self.as_json:
            self._write(self._out, json.dumps(value, indent=1, sort_keys=True) + "\n")

    def progress(self, title: str) -> Progress:
        """Progress of a piece of work, with the time that is left; seen on a terminal only."""
        return Progress(self, title)

    def show(self, line: str) -> None:
        """Overwrite the progress line."""
        if self._live:
            # A line that wraps could not be overwritten.
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
            _write_nowhere(stream)


def is_unread(error: OSError) -> bool:
    """Test a write error for a reader that has gone (``hfx info x | head``)."""
    return error.errno in (errno.EPIPE, errno.EINVAL)  # the latter on Windows


def _shown(text: str, several_lines: bool) -> str:
    return printable_lines(text) if several_lines else printable(text)


def _write_nowhere(stream: TextIO) -> None:
    """Redirect a stream to the null device, with everything that it still holds."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


class Progress:
    """Progress of one piece of work; call it with the share that is done, 0..1.

    There a signal to end the process ends the work, by a TerminatedError.
    """

    _WIDTH = 24
    _INTERVAL_S = 0.1
    _TITLE = 30

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._title = title if len(title) <= self._TITLE else title[: self._TITLE - 3] + "..."
        self._start = time.monotonic()
        self._next = self._start

    def __call__(self, share: float, text: str = "") -> None:
        process_end.check()
        now = time.monotonic()
        if now < self._next and share < 1.0:
            return
        self._next = now + self._INTERVAL_S
        filled = int(share * self._WIDTH)
        bar = "#" * filled + "." * (self._WIDTH - filled)
        left = ""
        if share > 0.02:
            left = f"  {_duration((now - self._start) * (1 - share) / share)} left"
        self._console.show(f"{self._title} [{bar}] {share:4.0%}{left} {text}".rstrip())


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
