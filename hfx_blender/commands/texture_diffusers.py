# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffusion models of the user's own for ``hfx texture``: ``generate`` and ``train-decoder``."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..console import Console
from ..errors import UsageError
from . import texture_folder

if TYPE_CHECKING:
    from ..generation.decoder_training import DecoderTraining
    from ..generation.generated import Generated

_DEVICES: Final = ("auto", "cpu", "cuda", "mps")
_PRESETS: Final = ("wood", "gravel", "metal", "textile")
_HELD_OUT: Final = 32


def add_arguments(parser: Any) -> None:
    """Add the options of generation by a model."""
    group = parser.add_argument_group("a diffusion model of your own")
    group.add_argument("--model", type=Path, metavar="DIR", help="folder of diffusers, safetensors")
    group.add_argument("--decoder", type=Path, metavar="DIR", help="of hfx texture train-decoder")
    group.add_argument("--preset", choices=_PRESETS, help="words of the map paper's materials")
    group.add_argument("--inference-steps", type=int, default=30, metavar="N", help="(30)")
    group.add_argument("--guidance", type=float, default=7.5, metavar="N", help="(7.5)")
    group.add_argument("--device", choices=_DEVICES, default="auto", help="(auto)")
    group.add_argument("--no-tiling", action="store_true", help="the picture may have a seam")


def maker(options: argparse.Namespace, console: Console) -> Callable[[int], Generated]:
    """Function that makes the surface of a seed with the model of the options.

    Raises
    ------
    HfxError
        The model, the decoder or the packages are missing or cannot be used.
    """
    from ..generation import diffusion, touch_decoder
    from ..generation.model_folder import ModelFolder

    if options.model is None:
        raise UsageError("--back-end diffusers needs --model DIR, a folder of diffusers")
    if not 1 <= options.inference_steps <= 1000:
        raise UsageError(f"--inference-steps {options.inference_steps}: expected 1 to 1000")
    words, negative = options.words, options.negative
    if options.preset is not None:
        preset = diffusion.PRESETS[options.preset]
        words = f"{words}. {preset[0]}" if words.strip() else preset[0]
        negative = negative or preset[1]
    if not words.strip():
        raise UsageError("give words or --preset")
    model = ModelFolder(options.model, options.device)
    tiling = not options.no_tiling
    decoder = options.decoder and touch_decoder.load(options.decoder, model.vae, tiling=tiling)
    size = options.size or (100.0, 100.0)
    settings = diffusion.Settings(
        texels=options.resolution,
        steps=options.inference_steps,
        guidance=options.guidance,
        tiling=tiling,
        size_m=(size[0] / 1000.0, size[1] / 1000.0),
        depth_m=options.height / 1000.0,
        way=options.way,
        noticeable=texture_folder.steps_of(options),
    )

    def make(seed: int) -> Generated:
        return diffusion.generate(
            model,
            words,
            negative=negative,
            seed=seed,
            settings=settings,
            decoder=decoder,
            decoder_folder=options.decoder,
            is_metal=options.preset == diffusion.METAL,
            progress=console.progress(f"Diffusing {seed}"),
        )

    return make


def add_training(actions: Any) -> None:
    """Add ``train-decoder``."""
    parser = actions.add_parser(
        "train-decoder",
        help="train a decoder of touch for a diffusion model",
        description="Train a decoder with one channel, the intensity of touch, against the fixed "
        "encoder of a model's VAE, as the map paper does (section 3.3). Ctrl-C saves; the same "
        "command goes on.",
    )
    parser.add_argument("--model", type=Path, required=True, metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="pictures (default: those of the library)"
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
    parser.add_argument("--device", choices=_DEVICES, default="auto", help="(auto)")
    parser.add_argument("--json", action="store_true", help="the result as JSON")
    parser.set_defaults(run=_train)


def _is_stopped(training: DecoderTraining, console: Console) -> bool:
    """Train to the end, or to the end of the step in which Ctrl-C is pressed."""
    asked: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: asked.append(number))
    try:
        training.run(console.progress("Training"), lambda: bool(asked))
    finally:
        signal.signal(signal.SIGINT, before)
    return bool(asked)


def _train(options: argparse.Namespace, console: Console) -> int:
    from ..generation.decoder_pairs import FolderPairs, LibraryPairs
    from ..generation.decoder_training import DecoderTraining, Pairs, TrainingSettings
    from ..generation.model_folder import ModelFolder

    for name in ("pairs", "training_steps", "batch", "resolution"):
        if getattr(options, name) < 1:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} {getattr(options, name)}: expected 1 or more")
    if options.pictures is not None and options.truth == "relief":
        raise UsageError("--truth relief: only the library knows its true relief")
    model = ModelFolder(options.model, options.device)
    pairs: Pairs
    if options.pictures is None:
        pairs = LibraryPairs(options.resolution, options.pairs, options.truth, options.seed)
        judged: Pairs = pairs
        numbers = range(options.pairs, options.pairs + _HELD_OUT)  # never asked for in training
    else:
        pairs = judged = FolderPairs(options.pictures, options.resolution, texture_folder.pixels)
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
        console.say(f"going on after step {training.step}")
    if _is_stopped(training, console):
        console.warn(f"stopped after step {training.step}; the same command goes on from there")
        return 130
    found = training.errors(judged, list(numbers))
    which = "held-out pairs" if options.pictures is None else "pairs of the training"
    console.say(
        f"{which}: MSE {found['mse']:.5f}, perceptual distance {found['perceptual_distance']:.5f} "
        f"({training.network.name})"
    )
    console.say(f"wrote {options.output}")
    console.result({"folder": str(options.output), "steps": training.step, **found})
    return 0
