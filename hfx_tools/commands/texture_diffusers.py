# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's diffusion models for ``hfx texture generate``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.console import Console
from hfx_blender.errors import UsageError

from . import texture_source

if TYPE_CHECKING:
    from hfx_blender.generation.generated import Generated

DEVICES: Final = ("auto", "cpu", "cuda", "mps")
_PRESETS: Final = ("wood", "gravel", "metal", "textile")


def add_arguments(parser: Any) -> None:
    """Add the options of generation by a model."""
    group = parser.add_argument_group("your diffusion model")
    group.add_argument("--model", type=Path, metavar="DIR", help="folder of diffusers, safetensors")
    group.add_argument(
        "--decoder", type=Path, metavar="DIR", help="output of hfx texture train-decoder"
    )
    group.add_argument("--preset", choices=_PRESETS, help="words of the map paper's materials")
    group.add_argument("--inference-steps", type=int, default=30, metavar="N", help="(30)")
    group.add_argument("--guidance", type=float, default=7.5, metavar="N", help="(7.5)")
    group.add_argument("--device", choices=DEVICES, default="auto", help="(auto)")
    group.add_argument("--no-tiling", action="store_true", help="the picture may have a seam")


def maker(options: argparse.Namespace, console: Console) -> Callable[[int], Generated]:
    """Build a function from seed to generated surface, with the model of the options.

    Raises
    ------
    HfxError
        Model, decoder or packages are missing or unusable.
    """
    from ..diffusion import diffusion, touch_decoder
    from ..diffusion.model_folder import ModelFolder

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
        noticeable=texture_source.steps_of(options),
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
