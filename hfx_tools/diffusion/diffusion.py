# SPDX-License-Identifier: GPL-3.0-or-later
"""Back end ``diffusers``: surfaces from the user's diffusion model.

The same latents are decoded twice: to colours by the model, to the intensity of touch by the
decoder of ``hfx texture train-decoder``; without a decoder, the picture is converted to relief.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.texture.haptic_map import NoticeableSteps
from hfx_blender.engine.texture.mcha import MapSettings, make_map
from hfx_blender.files.hashes import sha256_of
from hfx_blender.generation.generated import Generated, name_of
from hfx_blender.generation.picture_folder import WAYS, Way, surface_of

from .model_folder import ModelFolder, Progress
from .touch_decoder import WEIGHTS

NAME: Final = "diffusers"

_MACRO: Final = " Ultra-detailed, photorealistic, macro."
_LIT: Final = " Soft, diffused lighting showing texture depth without harsh shadows."

PRESETS: Final = {
    "wood": (
        "Old wooden surface close-up, top\N{EN DASH}down view with visible ridges, grooves, "
        "cracks, splits, and weathered texture. Rugged, tactile wood grain with natural damage and "
        f"worn matte finish.{_LIT} Light to dark brown tones.{_MACRO}",
        "smooth surface, polished, glossy, plastic, uniform grain, perfect texture, no cracks, "
        "flat, blurry, clean edges.",
    ),
    "gravel": (
        "Gravel ground close-up, top\N{EN DASH}down view with loose stones of different sizes, "
        "gaps and sharp edges. Rugged, tactile stones with a dry matte finish."
        f"{_LIT} Grey tones.{_MACRO}",
        "smooth surface, polished, sand, asphalt, water, plants, uniform stones, flat, blurry.",
    ),
    "metal": (
        "Brushed metal sheet close-up, top\N{EN DASH}down view with fine parallel scratches, small "
        f"dents and pits. Tactile, worn satin finish.{_LIT} Silver grey tones.{_MACRO}",
        "mirror finish, reflections, painted, plastic, perfect texture, flat, blurry.",
    ),
    "textile": (
        "Woven fabric close-up, top\N{EN DASH}down view with visible threads, weave and gaps. "
        f"Tactile, coarse cloth with natural fibres.{_LIT} Even tones.{_MACRO}",
        "smooth surface, print, folds, seams, plastic, glossy, flat, blurry.",
    ),
}
"""Words and negative words for the map paper's four materials. The words of wood are from the paper
(section 3.4.2); the paper prints no words of the remaining materials, modelled on wood here."""

METAL: Final = "metal"


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of a diffusion, without its words; sizes and depth in metres."""

    texels: int = 512
    steps: int = 30
    guidance: float = 7.5
    tiling: bool = True
    size_m: tuple[float, float] = (0.1, 0.1)
    depth_m: float = 0.2e-3
    way: Way = WAYS[0]
    noticeable: NoticeableSteps | None = None


def generate(
    model: ModelFolder,
    words: str,
    *,
    negative: str = "",
    seed: int = 0,
    settings: Settings | None = None,
    decoder: Any = None,
    decoder_folder: Path | None = None,
    is_metal: bool = False,
    progress: Progress = lambda share: None,
    is_cancelled: Callable[[], bool] = lambda: False,
) -> Generated:
    """Generate a surface from words.

    ``decoder``: result of :func:`.touch_decoder.load`, from ``decoder_folder``.

    Raises
    ------
    InputError
        The size does not fit the model, or the model's safety checker rejects the picture.
    CancelledError
    """
    chosen = settings or Settings()
    latents = model.latents(
        words,
        negative,
        seed,
        chosen.texels,
        steps=chosen.steps,
        guidance=chosen.guidance,
        tiling=chosen.tiling,
        progress=progress,
        is_cancelled=is_cancelled,
    )
    colour = model.colours(latents)
    surface = surface_of(
        colour / 255.0,
        chosen.size_m,
        depth_m=chosen.depth_m,
        tiles=chosen.tiling,
        way=chosen.way,
    )
    slope = surface.slope
    map_ = make_map(surface.height, surface.roughness, MapSettings(), slope)
    notes = list(surface.notes)
    if decoder is not None:
        touch = model.intensity(latents, decoder)
        # A slope of 1 is full strength, so the slope map stores the intensity in a .blend.
        map_, slope = replace(map_, intensity=touch), touch
        notes = ["the intensity is decoded from the picture's own latents"]
    if chosen.noticeable is not None:
        map_ = map_.in_steps(chosen.noticeable)
    record = {
        "words": words,
        "negative_words": negative,
        "seed": seed,
        "back_end": NAME,
        "model": {"class": model.class_name, "device": model.device},
        "inference_steps": chosen.steps,
        "guidance": chosen.guidance,
        "tiling": chosen.tiling,
        "conversion": chosen.way,
        "decoder_sha256": None if decoder_folder is None else sha256_of(decoder_folder / WEIGHTS),
        "versions": model.versions,
    }
    return Generated(
        name_of(words, str(seed)),
        colour,
        surface.height,
        np.asarray(surface.roughness),
        map_,
        record,
        is_metal=is_metal,
        notes=tuple(notes),
        slope=slope,
    )
