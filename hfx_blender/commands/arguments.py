# SPDX-License-Identifier: GPL-3.0-or-later
"""Shared command arguments: file name patterns, and the option ``--largest``."""

from __future__ import annotations

import argparse
import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import limits


def expanded(paths: Sequence[Path]) -> list[Path]:
    """Replace file name patterns by their sorted matches, without duplicates.

    The name of an existing file is no pattern, even with brackets or stars. Raises InputError for a
    pattern without matches.
    """
    files: list[Path] = []
    for path in paths:
        if not glob.has_magic(str(path)) or os.path.lexists(path):
            files.append(path)
            continue
        matches = sorted(glob.glob(str(path)))
        if not matches:
            raise InputError(f"{path}: there is no such file, and none that matches this pattern.")
        files += map(Path, matches)
    return list(dict.fromkeys(files))


def add_largest(parser: Any) -> None:
    """Add ``--largest``, a factor of all limits of :mod:`.limits` while the command runs."""
    parser.add_argument(
        "--largest",
        type=_times,
        default=1.0,
        metavar="N",
        help="multiply the limits on memory, time and pixels of files that are read by N "
        "(default: 1)",
    )


def _times(text: str) -> float:
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor <= limits.MOST_TIMES:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected more than 0, up to {limits.MOST_TIMES:g}"
        )
    return factor
