# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns such as ``*.blend`` among the files of a command: not every shell expands them."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError


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
