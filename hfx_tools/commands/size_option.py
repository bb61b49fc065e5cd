# SPDX-License-Identifier: GPL-3.0-or-later
"""Option ``--largest`` of commands that read files."""

from __future__ import annotations

from typing import Any

from hfx_blender.commands.arguments import checked
from hfx_blender.files import limits


def add_largest(parser: Any) -> None:
    """Add ``--largest``, a factor of all limits of :mod:`.limits` while the command runs."""
    parser.add_argument(
        "--largest",
        type=checked(
            float,
            lambda factor: 0.0 < factor <= limits.MOST_TIMES,
            f"more than 0, up to {limits.MOST_TIMES:g}",
        ),
        default=1.0,
        metavar="N",
        help="multiply the limits on memory, time and pixels of files that are read by N "
        "(default: 1)",
    )
