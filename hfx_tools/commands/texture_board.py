# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture board``: example of haptic surfaces as a .blend."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError
from hfx_blender.processes import blender_session

from .texture_source import check_folder


def add_parser(actions: Any) -> None:
    parser = actions.add_parser(
        "board", help="the example: 4 x 4 squares of four materials, as a .blend"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("board.blend"), metavar="FILE")
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Build the example and save its file; returns 0."""
    if options.output.suffix.lower() != ".blend":
        raise UsageError(f"{options.output}: expected a name ending in .blend")
    check_folder(options.output)
    blender_session.start()
    from ..demo import board

    squares = board.save(options.output)
    console.say(f"wrote {options.output}: {len(squares)} squares")
    console.result({"file": str(options.output), "squares": squares})
    return 0
