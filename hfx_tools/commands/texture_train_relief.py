# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture train-relief``: retrain the network of ``hfx texture build --from relief``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError

from .texture_source import check_folder


def add_parser(actions: Any) -> None:
    parser = actions.add_parser(
        "train-relief", help="retrain the network for relief from pictures; needs PyTorch"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("relief_network.npz"), metavar="FILE"
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=Path("relief-data"),
        metavar="DIR",
        help="folder for the pictures, 2.1 GB; existing pictures are used",
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Generate pictures, train and write the weights; returns 0."""
    if options.jobs < 1:
        raise UsageError(f"--jobs {options.jobs}: expected at least 1")
    check_folder(options.output)
    try:
        from ..relief import training
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise UsageError(
            "training needs PyTorch: pip install 'hfx-blender[train]', or 'torch' for your machine"
        ) from error
    weights = training.train(options.data, jobs=options.jobs)
    size = training.store(weights, options.output)
    console.say(f"wrote {options.output}: {size} bytes")
    console.result({"file": str(options.output), "bytes": size})
    return 0
