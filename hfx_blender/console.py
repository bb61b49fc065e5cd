# SPDX-License-Identifier: GPL-3.0-or-later
"""What the command line says: results, messages, and progress on long work."""

from __future__ import annotations

import json
import shutil
import sys
import time
from typing import Any, TextIO


class Console:
    """Text for people on a terminal, plain lines elsewhere, one JSON value with ``--json``.

    Progress and messages go to standard error, results to standard output.
    """

    def __init__(
        self, *, as_json: bool = False, out: TextIO | None = None, err: TextIO | None = None
    ) -> None:
        self.as_json = as_json
        self._out = out or sys.stdout
        self._err = err or sys.stderr
        self._live = self._err.isatty() and not as_json
        self._shown = 0

    def say(self, text: str = "") -> None:
        """A line for people; silent with ``--json``."""
        self._clear()
        if not self.as_json:
            self._out.write(text + "\n")
            self._out.flush()

    def warn(self, text: str) -> None:
        """A line about something that is wrong, on standard error."""
        self._clear()
        self._err.write(text + "\n")
        self._err.flush()

    def result(self, value: Any) -> None:
        """The machine-readable result, with ``--json`` only."""
        if self.as_json:
            json.dump(value, self._out, indent=1, sort_keys=True)
            self._out.write("\n")
            self._out.flush()

    def progress(self, title: str) -> Progress:
        """Progress of a piece of work, with the time that is left; seen on a terminal only."""
        return Progress(self, title)

    def show(self, line: str) -> None:
        """Overwrite the progress line."""
        if self._live:
            # A line that wraps could not be overwritten.
            line = line[: shutil.get_terminal_size().columns - 1]
            self._err.write("\r" + line.ljust(self._shown))
            self._err.flush()
            self._shown = len(line)

    def _clear(self) -> None:
        if self._shown:
            self._err.write("\r" + " " * self._shown + "\r")
            self._err.flush()
            self._shown = 0


class Progress:
    """Progress of one piece of work; call it with the share that is done, 0..1."""

    _WIDTH = 24
    _INTERVAL_S = 0.1
    _TITLE = 30

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._title = title if len(title) <= self._TITLE else title[: self._TITLE - 3] + "..."
        self._start = time.monotonic()
        self._next = self._start

    def __call__(self, share: float, text: str = "") -> None:
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
