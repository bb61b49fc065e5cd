# SPDX-License-Identifier: GPL-3.0-or-later
"""File of a participant's answers: a row for each trial, on the disk before the next trial."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hfx_blender.errors import InputError, OutputError, UsageError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.files.locks import LOCKED_BYTE, take_lock
from hfx_blender.files.staging import make_folder
from hfx_blender.files.strict_json import read_bytes

from .tables import Row, line_of, table_of


class AnswerFile:
    """Open table of answers, of one process at a time; a context manager.

    A last line that a killed process left incomplete is removed. ``rows`` holds the rows of earlier
    sessions. Raises UsageError for a file in use, InputError for a table with other columns, and
    OutputError for an unwritable file.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.path, self._columns = path, list(columns)
        make_folder(path.parent)
        if not path.exists():
            with atomic_file(path) as file:
                file.write(("\t".join(columns) + "\n").encode())
        flags = os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0)
        try:
            self._file = os.open(path, flags)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror}).") from error
        try:
            take_lock(self._file, LOCKED_BYTE)
        except OSError:
            os.close(self._file)
            raise UsageError(f"{path}: another session of this participant is running") from None
        try:
            self.rows = self._complete_rows()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> AnswerFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; may be called again."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def append(self, row: Mapping[str, Any]) -> None:
        """Add a row and force it to the disk; after an OutputError the file is as before."""
        content = line_of(self._columns, row).encode()
        size = os.fstat(self._file).st_size
        try:
            if os.write(self._file, content) < len(content):
                raise OSError(28, "No space left on device")
            os.fsync(self._file)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._file, size)
            raise OutputError(f"{self.path}: cannot be written ({error.strerror}).") from error
        self.rows += table_of("\t".join(self._columns).encode() + b"\n" + content, str(self.path))

    def _complete_rows(self) -> list[Row]:
        content = read_bytes(self.path)
        end = content.rfind(b"\n") + 1
        if end < len(content):
            os.ftruncate(self._file, end)
        rows = table_of(content[:end], str(self.path), self._columns)
        if content[:end].split(b"\n")[0].decode("utf-8-sig").split("\t") != self._columns:
            raise InputError(
                f"{self.path}: line 1 has other columns; allowed are: {', '.join(self._columns)}."
            )
        for number, row in enumerate(rows, 2):
            is_time = re.fullmatch(r"-?[0-9.]+(e-?[0-9]+)?", row["onset"])
            if not is_time or not row["session"].isdigit():
                column = "session" if is_time else "onset"
                raise InputError(
                    f"{self.path}: line {number}: {column} is '{row[column][:60]}', allowed is a "
                    "number."
                )
        return rows
