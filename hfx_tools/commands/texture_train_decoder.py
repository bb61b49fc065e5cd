# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx texture train-decoder``: train a decoder of touch for a diffusion model."""

from __future__ import annotations

import argparse
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError

from . import texture_source
from .texture_diffusers import DEVICES

if TYPE_CHECKING:
    from ..diffusion.decoder_training import DecoderTraining

_HELD_OUT: Final = 32


def add_parser(actions: Any) -> None:
    parser = actions.add_parser(
        "train-decoder",
        help="train a touch decoder for a diffusion model",
        description="Train a decoder with one channel, the intensity of touch, against the fixed "
        "encoder of a model's VAE, as in the map paper (section 3.3). Ctrl-C saves; the same "
        "command resumes.",
    )
    parser.add_argument("--model", type=Path, required=True, metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="pictures (default: of the library)"
    )
    parser.add_argument(
        "--truth",
        choices=("picture", "relief"),
        default="picture",
        help="map of the picture, as in the paper (default), or of the library's true relief",
    )
    parser.add_argument("--pairs", type=int, default=16_000, metavar="N", help="(16000)")
    parser.add_argument("--resolution", type=int, default=512, metavar="N", help="(512)")
    parser.add_argument("--training-steps", type=int, default=100_000, metavar="N")
    parser.add_argument("--batch", type=int, default=2, metavar="N", help="(2)")
    parser.add_argument("--learning-rate", type=float, default=1e-4, metavar="N", help="(1e-4)")
    parser.add_argument(
        "--perceptual", type=Path, metavar="DIR", help="vision model of transformers, safetensors"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--device", choices=DEVICES, default="auto", help="(auto)")
    add_json(parser, run)


def _is_stopped(training: DecoderTraining, console: Console) -> bool:
    """Train to the end, or to the end of the current step on Ctrl-C; True if stopped."""
    interrupts: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: interrupts.append(number))
    try:
        training.run(console.progress("Training"), lambda: bool(interrupts))
    finally:
        signal.signal(signal.SIGINT, before)
    return bool(interrupts)


def run(options: argparse.Namespace, console: Console) -> int:
    """Train, and report the errors on held-out pairs; returns 0, or 130 after Ctrl-C."""
    from ..diffusion.decoder_pairs import FolderPairs, LibraryPairs
    from ..diffusion.decoder_training import DecoderTraining, Pairs, TrainingSettings
    from ..diffusion.model_folder import ModelFolder

    for name in ("pairs", "training_steps", "batch", "resolution"):
        if getattr(options, name) < 1:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} {getattr(options, name)}: expected 1 or more")
    if options.pictures is not None and options.truth == "relief":
        raise UsageError("--truth relief: only the library has a true relief; remove --pictures")
    model = ModelFolder(options.model, options.device)
    pairs: Pairs
    if options.pictures is None:
        pairs = LibraryPairs(options.resolution, options.pairs, options.truth, options.seed)
        judged: Pairs = pairs
        numbers = range(options.pairs, options.pairs + _HELD_OUT)  # not used in training
    else:
        pairs = judged = FolderPairs(
            options.pictures,
            options.resolution,
            lambda path: texture_source.picture(path, "colours"),
        )
        numbers = range(min(len(pairs), _HELD_OUT))
    settings = TrainingSettings(
        steps=options.training_steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        seed=options.seed,
    )
    options.output.mkdir(parents=True, exist_ok=True)
    training = DecoderTraining(model.vae, pairs, options.output, settings, options.perceptual)
    if training.step:
        console.say(f"resuming after step {training.step}")
    if _is_stopped(training, console):
        console.warn(f"stopped after step {training.step}; the same command resumes")
        return 130
    errors = training.errors(judged, list(numbers))
    pair_kind = "held-out pairs" if options.pictures is None else "pairs of the training"
    console.say(
        f"{pair_kind}: MSE {errors['mse']:.5f}, perceptual distance "
        f"{errors['perceptual_distance']:.5f} ({training.network.name})"
    )
    console.say(f"wrote {options.output}")
    console.result({"folder": str(options.output), "steps": training.step, **errors})
    return 0
