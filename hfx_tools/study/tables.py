# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of tab-separated values as in BIDS: UTF-8, a line of names, "n/a" for no value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import InputError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.files.strict_json import read_bytes

NOTHING: Final = "n/a"

Row = dict[str, str]


def line_of(columns: Sequence[str], row: Mapping[str, Any]) -> str:
    """Line of a table, with its line end; "n/a" for missing values, None and empty texts."""
    return "\t".join(_cell(row.get(column)) for column in columns) + "\n"


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a table; raises OutputError for an unwritable file."""
    with atomic_file(path) as file:
        file.write(("\t".join(columns) + "\n").encode())
        file.writelines(line_of(columns, row).encode() for row in rows)


def read_table(path: Path, columns: Iterable[str] = ()) -> list[Row]:
    """Read a table with at least the named columns; InputError names the file and the line."""
    return table_of(read_bytes(path), str(path), columns)


def table_of(content: bytes, name: str, columns: Iterable[str] = ()) -> list[Row]:
    """Rows of a table's content; ``name`` stands for the file in messages."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: byte {error.start} is not UTF-8.") from None
    names = lines[0].split("\t") if lines else []
    missing = [column for column in columns if column not in names]
    if missing or len(set(names)) < len(names):
        fault = f"no column '{missing[0]}'" if missing else "two columns of one name"
        raise InputError(f"{name}: line 1 has {fault}; its columns are: {', '.join(names)}.")
    rows = []
    for number, line in enumerate(lines[1:], 2):
        cells = line.split("\t")
        if len(cells) != len(names):
            raise InputError(
                f"{name}: line {number} has {len(cells)} values; allowed are {len(names)}."
            )
        rows.append(dict(zip(names, cells, strict=True)))
    return rows


def _cell(value: Any) -> str:
    if value is None or value == "":
        return NOTHING
    if isinstance(value, str):
        return value
    return repr(value) if not isinstance(value, bool) else str(value).lower()
