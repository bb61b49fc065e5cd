# SPDX-License-Identifier: GPL-3.0-or-later
"""Option ``--largest``: factor of the limits on files."""

from __future__ import annotations

import argparse
from typing import Any

from ..files import limits


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
