# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx bench``: what things cost on this machine, as ratios."""

from __future__ import annotations

import argparse
from typing import Any

from ..console import Console


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("bench", help="measure what things cost")
    parser.add_argument("name", nargs="?", default="export", choices=("export",), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=5, metavar="N", help="pairs of runs")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Measure and print."""
    from ..bench import export_cost

    result = export_cost.measure(max(options.rounds, 1), console.progress("Measuring"))
    console.say(export_cost.as_text(result))
    console.result(result)
    return 0
