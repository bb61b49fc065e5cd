# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated device: a log with a JSON line for each set of values and each stop."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from ...engine.arrays import F64
from .log_file import LogFile
from .output import OutputLostError

MAX_BYTES: Final = 64 << 20
"""Size at which the log is emptied and continued, bytes: half an hour of a large device."""


class Simulator:
    """Output to a log file; without a path, values are discarded.

    Parameters
    ----------
    path : Path, optional
        Log with lines ``{"time_s": ..., "values": [...]}`` and ``{"time_s": ..., "stop": true}``;
        times are of the system's monotonic clock. Only logs of simulators are overwritten.

    Raises
    ------
    OutputLostError
        The file is not a simulator's log, is no regular file, or cannot be written.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._size = 0
        self._file = None if path is None else LogFile(path, _is_log)

    def send(self, values: F64) -> None:
        self._write({"time_s": time.monotonic(), "values": values.tolist()})

    def stop(self) -> None:
        with suppress(OutputLostError):
            self._write({"time_s": time.monotonic(), "stop": True})

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def _write(self, content: dict[str, object]) -> None:
        if self._file is None or self._file.is_closed:
            return
        line = json.dumps(content).encode() + b"\n"
        if self._size + len(line) > MAX_BYTES:
            self._file.empty()
            self._size = 0
        self._file.write(line)
        self._size += len(line)


def _is_log(content: bytes) -> bool:
    """Test that all lines of a file are a simulator's; the last line may be cut off."""
    *lines, rest = content.split(b"\n")
    return bool(lines) and all(map(_is_line, lines)) and _START.startswith(rest[: len(_START)])


_START: Final = b'{"time_s": '


def _is_line(line: bytes) -> bool:
    if not line.startswith(_START):
        return False
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return False
    return set(entry) in ({"time_s", "values"}, {"time_s", "stop"})
