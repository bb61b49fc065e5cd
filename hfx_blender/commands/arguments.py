# SPDX-License-Identifier: GPL-3.0-or-later
"""Shared command arguments: file name patterns, checked values and ``--json``."""

import argparse
import glob
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError
from .console import Console

T = TypeVar("T")
N = TypeVar("N", int, float)


def expanded(paths: Sequence[Path]) -> list[Path]:
    """Replace file name patterns by their sorted matches, without duplicates. The name of an
    existing file is no pattern, even with brackets or stars. Raises InputError for a pattern
    without matches."""
    files: list[Path] = []
    for path in paths:
        # Windows' shells do not expand patterns.
        if not glob.has_magic(str(path)) or os.path.lexists(path):
            files.append(path)
            continue
        matches = sorted(glob.glob(str(path)))
        if not matches:
            raise InputError(f"{path}: there is no such file, and none that matches this pattern.")
        files += map(Path, matches)
    return list(dict.fromkeys(files))


def add_json(parser: Any, run: Callable[[argparse.Namespace, Console], int]) -> None:
    """Add ``--json`` as the last option, and set the function that executes the command."""
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def checked(
    parse: Callable[[str], T], is_allowed: Callable[[T], bool], expected: str
) -> Callable[[str], T]:
    """Make a parser of an option's value; other values are an error with the ``expected`` ones."""

    def parse_checked(text: str) -> T:
        # A ZeroDivisionError comes from fractions such as 1/0.
        try:
            value = parse(text)
            if is_allowed(value):
                return value
        except (ValueError, ZeroDivisionError):
            pass
        raise argparse.ArgumentTypeError(f"expected {expected}, found '{text}'")

    return parse_checked


def pair_of(number: Callable[[str], N], separator: str) -> Callable[[str], tuple[N, N]]:
    """Make a parser of two numbers with a separator between; ValueError for other text."""

    def parse_pair(text: str) -> tuple[N, N]:
        first, second = map(number, text.split(separator))
        return first, second

    return parse_pair
