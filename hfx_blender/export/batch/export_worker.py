# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker process: reads units, one JSON line each, does them, and answers in JSON lines.

It ends when its input does, whatever it is doing: a worker whose master has gone is of no use.
Answers are ``{"ready": true}`` or ``{"cannot_start": "..."}`` once, then for each unit
``{"progress": 0.5}`` now and then and ``{"outcome": {...}}`` at its end.
"""

from __future__ import annotations

import faulthandler
import json
import os
import queue
import sys
import threading
import time
from contextlib import redirect_stdout
from typing import Any, TextIO

from ...errors import HfxError
from ...processes import blender_session
from .units import Unit
from .work import run_safely

_INTERVAL_S = 0.2
"""Time between two messages about progress."""


def main() -> None:
    """Work until there is no more input."""
    faulthandler.enable()  # where Blender crashed, for the one who started us
    units: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(units,), daemon=True).start()
    blender_session.leave(blender_session.without_chatter(lambda: _serve(units)))


def _listen(units: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        units.put(line)
    blender_session.leave(0)


def _serve(units: queue.SimpleQueue[str]) -> int:
    answers = sys.stdout
    # Blender also prints what operators report through Python's own stream.
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        try:
            blender_session.start()
        except HfxError as error:
            _answer(answers, {"cannot_start": str(error)})
            return error.exit_code
        _answer(answers, {"ready": True})
        while True:
            unit = Unit.from_json(units.get())
            _answer(answers, {"outcome": run_safely(unit, _Progress(answers))})


class _Progress:
    def __init__(self, answers: TextIO) -> None:
        self._answers = answers
        self._next = 0.0

    def __call__(self, share: float) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _INTERVAL_S
            _answer(self._answers, {"progress": share})


def _answer(answers: TextIO, message: dict[str, Any]) -> None:
    answers.write(json.dumps(message) + "\n")
    answers.flush()


if __name__ == "__main__":
    main()
