# SPDX-License-Identifier: GPL-3.0-or-later
"""Outputs to log files in place of hardware: simulator (JSON lines) and CSV.

A log is a new regular file, or an earlier log of a simulator. Pipes and device nodes are not
opened: opening a pipe may block, and opening a device node may have effects.
"""

import json
import os
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ..host.encoders import Channels
from ..host.output import OutputLostError

SIMULATOR_BYTES: Final = 64 << 20
"""Size at which a simulator's log is emptied, bytes: half an hour of a large device."""

CSV_BYTES: Final = 256 << 20
"""Size at which a CSV log ends with an error, bytes, so that it cannot fill the disk."""

MOST_BYTES: Final = 1 << 28
"""Largest existing log that is read and overwritten, bytes; outputs write smaller ones."""

_FLAGS: Final = (
    getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NOCTTY", 0)  # never the controlling terminal
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)
_START: Final = b'{"time_s": '


class Simulator:
    """Output to a log file; without a path, values are discarded.

    The log has lines ``{"time_s": ..., "values": [...]}`` and ``{"time_s": ..., "stop": true}``;
    times are of the system's monotonic clock. Only logs of simulators are overwritten.

    Raises OutputLostError: the file is not a simulator's log, is no regular file, or cannot be
    written.
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
        if self._size + len(line) > SIMULATOR_BYTES:
            self._file.empty()
            self._size = 0
        self._file.write(line)
        self._size += len(line)


def _is_log(content: bytes) -> bool:
    """Test for one or more complete lines, all of a simulator; a last line may be cut off."""
    *lines, rest = content.split(b"\n")
    for line in lines:
        try:
            entry = json.loads(line) if line.startswith(_START) else {}
        except (ValueError, RecursionError):
            return False
        if set(entry) not in ({"time_s", "values"}, {"time_s", "stop"}):
            return False
    return bool(lines) and _START.startswith(rest[: len(_START)])


class CsvLog:
    """Output to a new CSV file: ``time_s`` since the start, ``event`` (values, stop), channels.

    Raises OutputLostError: the file exists already, or cannot be written.
    """

    def __init__(self, device: DeviceConfig, path: Path) -> None:
        self._channels = Channels(device)
        self._began_s = time.monotonic()
        self._left = CSV_BYTES
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
        """Close the file; may be called again."""
        self._file.close()

    def _row(self, event: str, values: F64) -> None:
        now = time.monotonic() - self._began_s
        self._write(",".join([f"{now:.4f}", event, *(f"{value:g}" for value in values)]))

    def _write(self, line: str) -> None:
        content = line.encode("ascii") + b"\n"
        self._left -= len(content)
        if self._left < 0:
            raise OutputLostError(f"{self._path} is full: a log takes {CSV_BYTES >> 20} MiB.")
        self._file.write(content)


class LogFile:
    """Unbuffered writer of a log; :meth:`close` removes a new file after a failed write. Raises
    OutputLostError: the file may not be overwritten, as of :func:`open_log`, or not written."""

    def __init__(self, path: Path, is_ours: Callable[[bytes], bool] | None = None) -> None:
        self._path = path
        self._is_new = not os.path.lexists(path)
        self._fault: OSError | None = None
        self._file = os.fdopen(open_log(path, is_ours), "wb", 0)

    @property
    def is_closed(self) -> bool:
        return self._file.closed

    def write(self, content: bytes) -> None:
        """Write all of ``content``; OutputLostError if this or an earlier write has failed."""
        rest = memoryview(content)
        try:
            while rest and self._fault is None:
                # An unbuffered file may take a part at a time.
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._fault = error
        if self._fault is not None:
            raise OutputLostError(f"{self._path} cannot be written ({self._fault.strerror}).")

    def empty(self) -> None:
        """Truncate the log to 0 bytes."""
        self._file.seek(0)
        self._file.truncate()

    def close(self) -> None:
        """Close the file; may be called again. After a failed write, a file created by this writer
        is removed, unless another file has its path by now. OSErrors are ignored."""
        with suppress(OSError):
            # The path may lead to another file by now, which must stay.
            state = os.fstat(self._file.fileno()) if not self.is_closed else None
            self._file.close()
            if self._fault is not None and self._is_new and state is not None:
                if os.path.samestat(state, os.lstat(self._path)):
                    self._path.unlink()


def open_log(path: Path, is_ours: Callable[[bytes], bool] | None = None) -> int:
    """Create or truncate a log and return a descriptor.

    ``is_ours``: tests the content of an existing file; True permits overwriting. Empty files are
    always overwritten. None: the file must not exist.

    Raises OutputLostError: the file exists and may not be overwritten, is no regular file, or
    cannot be written.
    """
    try:
        if is_ours is None or not os.path.lexists(path):
            # O_EXCL: a file or link created in between is not followed.
            return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _FLAGS, 0o644)
        # Before the opening, which may have effects, and after, as the path may have changed.
        _require_regular(path, os.lstat(path))
        descriptor = os.open(path, os.O_RDWR | _FLAGS)
        try:
            _require_regular(path, os.fstat(descriptor))
            size = os.fstat(descriptor).st_size
            # A copy, as the file object closes its descriptor.
            with os.fdopen(os.dup(descriptor), "rb") as file:
                is_known = size <= MOST_BYTES and (not size or is_ours(file.read(MOST_BYTES)))
            if not is_known:
                raise OutputLostError(
                    f"{path} is no log of this output; it is not overwritten: name another file."
                )
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.ftruncate(descriptor, 0)
        except BaseException:
            with suppress(OSError):
                os.close(descriptor)
            raise
    except FileExistsError:
        raise OutputLostError(f"{path} exists already; a log starts a new file.") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise OutputLostError(f"{path} cannot be written ({reason}).") from None
    return descriptor


def _require_regular(path: Path, state: os.stat_result) -> None:
    """Raise OutputLostError unless ``state`` is of a regular file with one hard link."""
    if stat.S_ISREG(state.st_mode):
        if state.st_nlink > 1:
            raise OutputLostError(
                f"{path} has another name as well (a hard link); a log needs a file of its own."
            )
        return
    kinds = {stat.S_IFLNK: "a link", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe"}
    kind = kinds.get(stat.S_IFMT(state.st_mode), "no regular file")
    raise OutputLostError(f"{path} is {kind}; a log is written to a regular file only.")
