# SPDX-License-Identifier: GPL-3.0-or-later
"""Diffusion model in the user's folder: loaded offline, from safetensors only, run, decoded.

Needs the optional extra ``generate`` (torch, diffusers, transformers). Folders have the layout of
``diffusers``: Stable Diffusion 1.5 to 3.5, and models with equal parts.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F32, U8
from hfx_blender.errors import HfxError, InputError
from hfx_blender.files.json_shapes import Anything, Record, Row, Text
from hfx_blender.files.json_shapes import read as read_json

PIPELINES: Final = (
    "StableDiffusionPipeline",
    "StableDiffusionXLPipeline",
    "StableDiffusion3Pipeline",
)
_LIBRARIES: Final = ("diffusers", "transformers", "stable_diffusion")
"""Allowed libraries of a pipeline's parts: code in a folder is never run."""

_PARTS: Final = (
    "AutoencoderKL",
    "UNet2DConditionModel",
    "SD3Transformer2DModel",
    "CLIPTextModel",
    "CLIPTextModelWithProjection",
    "T5EncoderModel",
    "CLIPVisionModelWithProjection",
    "StableDiffusionSafetyChecker",
)
_PART_ENDS: Final = ("Scheduler", "Tokenizer", "TokenizerFast", "Processor", "FeatureExtractor")
"""Allowed endings of further classes of parts, without weights."""

_UNSAFE: Final = (".bin", ".ckpt", ".pt", ".pth", ".pkl")
Progress = Callable[[float], None]


class CancelledError(HfxError):
    """The user has cancelled the diffusion."""

    exit_code = 130


@dataclass(frozen=True, eq=False)
class Latents:
    """Result of a diffusion before decoding."""

    values: Any  # torch tensor (1, C, h, w), in the scale of the pipeline's denoiser


_INDEX: Final = Record({"_class_name": Text(PIPELINES)}, unknown="ignore")
_ORIGIN: Final = Row((Anything(), Anything()))
"""Library and class of a part."""


def check_folder(folder: Path) -> str:
    """Check a folder of diffusers; returns the class of its pipeline.

    Raises
    ------
    InputError
        No such folder, an unknown part, weights other than safetensors, or code.
    """
    index = folder / "model_index.json"
    if not index.is_file():
        raise InputError(f"{folder}: has no model_index.json; expected a folder of diffusers.")
    entries = read_json(index).hold(_INDEX)
    for part, node in entries.members().items():
        if part.startswith("_") or not isinstance(node.value, list):
            continue
        library, kind = node.hold(_ORIGIN).value
        if library is not None and library not in _LIBRARIES:
            raise InputError(
                f"{index}: {part} comes from '{library}', allowed are {', '.join(_LIBRARIES)}: "
                "code of a model is never run."
            )
        if kind not in (None, *_PARTS) and not str(kind).endswith(_PART_ENDS):
            raise InputError(
                f"{index}: {part} is a '{kind}', allowed are {', '.join(_PARTS)}, schedulers, "
                "tokenizers and processors of pictures."
            )
        if kind is not None:
            _check_weights(folder / part)
    return str(entries.get("_class_name"))


def _absent(folder: Path) -> list[str]:
    """Names of absent parts in the index, such as the largest text encoder of version 3."""
    entries = read_json(folder / "model_index.json").hold(_INDEX).value
    return [name for name, value in entries.items() if value == [None, None]]


def _check_weights(part: Path) -> None:
    if not part.is_dir():
        raise InputError(f"{part}: there is no such folder; the model has it as a part.")
    files = [path.name for path in part.iterdir()]
    unsafe = [name for name in files if name.endswith(_UNSAFE)]
    if unsafe and not any(name.endswith(".safetensors") for name in files):
        raise InputError(
            f"{part / unsafe[0]}: is a pickle, which can run code; only .safetensors are loaded."
        )
    code = [name for name in files if name.endswith(".py")]
    if code:
        raise InputError(f"{part / code[0]}: is code; a model's code is never run.")


def libraries() -> tuple[Any, Any]:
    """Import ``torch`` and ``diffusers`` in offline mode.

    Raises
    ------
    HfxError
        A package is not installed.
    """
    os.environ.update({"HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1"})
    try:
        import diffusers
        import torch
        import transformers  # noqa: F401
    except ModuleNotFoundError as error:
        raise HfxError(
            f"The Python package {error.name} is not installed; the extra 'generate' brings it: "
            "pip install 'hfx-blender[generate]'."
        ) from error
    diffusers.utils.logging.set_verbosity_error()
    diffusers.utils.logging.disable_progress_bar()
    return torch, diffusers


class ModelFolder:
    """Loaded diffusion model.

    ``device``: ``cpu``, ``cuda``, ``mps``, or ``auto``: a graphics card if available.

    Raises
    ------
    InputError
        The folder cannot be loaded.
    HfxError
        The packages are not installed.
    """

    def __init__(self, folder: Path, device: str = "auto") -> None:
        name = check_folder(folder)
        torch, diffusers = libraries()
        self._torch = torch
        self.device = device if device != "auto" else _best_device(torch)
        self.class_name = name
        half = torch.float16 if self.device != "cpu" else torch.float32
        try:
            self.pipeline = getattr(diffusers, name).from_pretrained(
                str(folder),
                local_files_only=True,
                use_safetensors=True,
                torch_dtype=half,
                **dict.fromkeys(_absent(folder)),
            )
            self.pipeline.to(self.device)
        except Exception as error:  # a faulty folder may raise any exception in the libraries
            reason = [*str(error).strip().splitlines(), type(error).__name__][0]
            raise InputError(f"{folder}: cannot be loaded ({reason}).") from error
        self.pipeline.set_progress_bar_config(disable=True)
        # Half floats overflow in the decoders of larger models.
        self.vae = self.pipeline.vae.to(torch.float32)
        self.versions = {"torch": torch.__version__, "diffusers": diffusers.__version__}

    @property
    def texels_per_latent(self) -> int:
        """Texels along an edge of a latent."""
        return int(self.pipeline.vae_scale_factor)

    def make_tiling(self) -> None:
        """Let all convolutions wrap, for pictures without a seam; irreversible for this model."""
        torch = self._torch
        for part in (getattr(self.pipeline, "unet", None), self.vae):
            for module in part.modules() if part is not None else ():
                if isinstance(module, torch.nn.Conv2d):
                    module.padding_mode = "circular"

    def latents(
        self,
        words: str,
        negative: str,
        seed: int,
        texels: int,
        *,
        steps: int,
        guidance: float,
        tiling: bool,
        progress: Progress = lambda share: None,
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> Latents:
        """Run the diffusion from words to latents of a picture of ``texels`` squared.

        Raises
        ------
        InputError
            The size does not fit the model.
        CancelledError
        """
        torch = self._torch
        unit = 2 * self.texels_per_latent
        if texels % unit:
            raise InputError(
                f"--resolution {texels}: expected a multiple of {unit} for this model."
            )
        generator = torch.Generator("cpu").manual_seed(seed)
        # A transformer encodes positions, so wrapping convolutions are not enough: the latents are
        # shifted cyclically between the steps, which spreads the seam over the picture.
        rolls = tiling and getattr(self.pipeline, "transformer", None) is not None
        offsets = np.random.default_rng([seed, 29])
        moved = [0, 0]

        def after_step(_pipeline: Any, number: int, _time: Any, values: Any) -> Any:
            if is_cancelled():
                raise CancelledError("Cancelled: nothing was made.")
            progress((number + 1) / steps)
            if rolls:
                shift = [2 * int(k) for k in offsets.integers(0, texels // unit, 2)]
                values["latents"] = torch.roll(values["latents"], shift, (2, 3))
                moved[:] = [a + b for a, b in zip(moved, shift, strict=True)]
            return values

        if tiling:
            self.make_tiling()
        images = self.pipeline(
            words,
            negative_prompt=negative,
            height=texels,
            width=texels,
            num_inference_steps=steps,
            guidance_scale=guidance,
            generator=generator,
            output_type="latent",
            callback_on_step_end=after_step,
            callback_on_step_end_tensor_inputs=["latents"],
        ).images
        return Latents(torch.roll(images, [-offset for offset in moved], (2, 3)))

    def unscaled(self, latents: Latents) -> Any:
        """Latents in the scale of the decoder, a float32 tensor."""
        config = self.vae.config
        shift = getattr(config, "shift_factor", None) or 0.0
        return latents.values.to(self._torch.float32) / config.scaling_factor + shift

    def colours(self, latents: Latents) -> U8:
        """Colour picture (H, W, 3) of latents, sRGB, bottom row first.

        Raises
        ------
        InputError
            The model's safety checker rejects the picture.
        """
        torch = self._torch
        with torch.no_grad():
            image = self.vae.decode(self.unscaled(latents)).sample
        if getattr(self.pipeline, "safety_checker", None) is not None:
            part = self.pipeline.safety_checker.dtype
            _, refused = self.pipeline.run_safety_checker(image.clamp(-1, 1), self.device, part)
            if refused and any(refused):
                raise InputError("The model's safety checker refuses this picture.")
        return np.rint(255.0 * _unit(image)[::-1]).astype(np.uint8)

    def intensity(self, latents: Latents, decoder: Any) -> F32:
        """Intensity (H, W) of latents by a touch decoder, bottom row first."""
        with self._torch.no_grad():
            image = decoder(self.unscaled(latents))
        return np.ascontiguousarray(_unit(image)[::-1, :, 0], np.float32)


def _best_device(torch: Any) -> str:
    if torch.cuda.is_available():
        return "cuda"
    return "mps" if torch.backends.mps.is_available() else "cpu"


def _unit(image: Any) -> npt.NDArray[np.float64]:
    """Convert a decoder's output (1, C, H, W) in -1..1 to a picture (H, W, C) in 0..1."""
    values = image[0].float().cpu().numpy().astype(np.float64)
    return np.clip(0.5 + 0.5 * values, 0.0, 1.0).transpose(1, 2, 0)
