# SPDX-License-Identifier: GPL-3.0-or-later
"""CSV log in place of hardware: one row for each set of values and each stop."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ..host.encoders import Channels
from ..host.log_file import LogFile
from ..host.output import OutputLostError

MAX_BYTES: Final = 256 << 20
"""Size at which the log ends with an error, bytes, so that it cannot fill the disk."""


class CsvLog:
    """Output to a new CSV file: ``time_s`` since the start, ``event`` (values, stop), channels.

    Raises OutputLostError: the file exists already, or cannot be written.
    """

    def __init__(self, device: DeviceConfig, path: Path) -> None:
        self._channels = Channels(device)
        self._began_s = time.monotonic()
        self._left = MAX_BYTES
        self._path = path
        self._file = LogFile(path)
        units = [f"{actuator}.{control}" for actuator, control in self._channels.names]
        try:
            self._write(",".join(["time_s", "event", *units]))
        except OutputLostError:
            self.close()
            raise

    def send(self, values: F64) -> None:
        """Write a row for values (columns,)."""
        self._row("values", self._channels.values(values))

    def stop(self) -> None:
        """Write a row of neutral values, unless the log has been closed."""
        with suppress(OutputLostError):
            if not self._file.is_closed:
                self._row("stop", self._channels.neutral)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _row(self, event: str, values: F64) -> None:
        now = time.monotonic() - self._began_s
        self._write(",".join([f"{now:.4f}", event, *(f"{value:g}" for value in values)]))

    def _write(self, line: str) -> None:
        content = line.encode("ascii") + b"\n"
        self._left -= len(content)
        if self._left < 0:
            raise OutputLostError(f"{self._path} is full: a log takes {MAX_BYTES >> 20} MiB.")
        self._file.write(content)
