# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments that several commands have: patterns of file names, the option ``--largest``."""

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

    A file whose name has brackets or stars in it is no pattern.

    Raises
    ------
    InputError
        Nothing matches a pattern.
    """
    found: list[Path] = []
    for path in paths:
        if not glob.has_magic(str(path)) or os.path.lexists(path):
            found.append(path)
            continue
        matches = sorted(glob.glob(str(path)))
        if not matches:
            raise InputError(f"{path}: there is no such file, and none that matches this pattern.")
        found += map(Path, matches)
    return list(dict.fromkeys(found))


def add_largest(parser: Any) -> None:
    """Add the option; the command line puts it into effect while the command runs."""
    parser.add_argument(
        "--largest",
        type=_times,
        default=1.0,
        metavar="N",
        help="read files that ask for N times as much memory, time or pixels as is allowed "
        "otherwise (default: 1)",
    )


def _times(text: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 0.0 < found <= limits.MOST_TIMES:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected more than 0, up to {limits.MOST_TIMES:g}"
        )
    return found
