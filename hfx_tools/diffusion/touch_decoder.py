# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of latents to a single channel, the intensity of touch (Liu and Gu 2025, section 3.3)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from hfx_blender.errors import InputError
from hfx_blender.files.hashes import sha256_of
from hfx_blender.files.json_shapes import Anything, Record, Text, strict
from hfx_blender.files.json_shapes import read as read_json

from .model_folder import libraries

WEIGHTS: Final = "decoder.safetensors"
CONFIG: Final = "decoder.json"
FORMAT: Final = "hfx-touch-decoder"
_CONFIG: Final = strict(
    {
        "format": Text((FORMAT,)),
        "config": Record(unknown="ignore", title="the decoder's sizes"),
        **dict.fromkeys(("version", "sha256", "record"), Anything()),
    }
)
_KEYS: Final = (
    "latent_channels", "block_out_channels", "layers_per_block", "norm_num_groups", "act_fn",
    "up_block_types", "mid_block_add_attention",
)  # fmt: skip


def from_vae(vae: Any) -> Any:
    """Copy a VAE's decoder with its output channels averaged into one, as a torch module."""
    config = {key: vae.config.get(key) for key in _KEYS}
    decoder = _module(config, has_quantization=vae.post_quant_conv is not None)
    state = {f"decoder.{key}": value for key, value in vae.decoder.state_dict().items()}
    for name in ("weight", "bias"):
        key = f"decoder.conv_out.{name}"
        state[key] = state[key].mean(0, keepdim=True)
    if vae.post_quant_conv is not None:
        quantized = vae.post_quant_conv.state_dict()
        state |= {f"post_quant_conv.{key}": value for key, value in quantized.items()}
    decoder.load_state_dict(state)
    return decoder


def _module(config: dict[str, Any], *, has_quantization: bool) -> Any:
    torch, diffusers = libraries()
    kind = diffusers.models.autoencoders.vae.Decoder
    nn = torch.nn

    class TouchDecoder(nn.Module):  # type: ignore[name-defined,misc]
        def __init__(self) -> None:
            super().__init__()
            self.config = {**config, "has_quantization": has_quantization}
            channels = config["latent_channels"]
            self.decoder = kind(
                in_channels=channels,
                out_channels=1,
                up_block_types=config["up_block_types"],
                block_out_channels=config["block_out_channels"],
                layers_per_block=config["layers_per_block"],
                norm_num_groups=config["norm_num_groups"],
                act_fn=config["act_fn"],
                mid_block_add_attention=config["mid_block_add_attention"] is not False,
            )
            self.post_quant_conv = nn.Conv2d(channels, channels, 1) if has_quantization else None

        def forward(self, latents: Any) -> Any:
            if self.post_quant_conv is not None:
                latents = self.post_quant_conv(latents)
            return self.decoder(latents)

    return TouchDecoder()


def save(decoder: Any, folder: Path, record: dict[str, Any]) -> None:
    """Write a decoder's weights as safetensors, and sizes and training record as JSON."""
    from safetensors.torch import save_file

    folder.mkdir(parents=True, exist_ok=True)
    state = {key: value.detach().cpu().contiguous() for key, value in decoder.state_dict().items()}
    save_file(state, str(folder / WEIGHTS))
    document = {
        "format": FORMAT,
        "version": 1,
        "config": decoder.config,
        "sha256": sha256_of(folder / WEIGHTS),
        "record": record,
    }
    (folder / CONFIG).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def load(folder: Path, vae: Any, *, tiling: bool) -> Any:
    """Read a decoder for a model's latents, on the model's device; ``tiling`` wraps convolutions.

    Raises
    ------
    InputError
        No decoder, a changed file, or a decoder for other latents.
    """
    torch, _ = libraries()
    from safetensors.torch import load_file

    document = read_json(folder / CONFIG).hold(_CONFIG)
    sizes = dict(document.get("config"))
    if sizes.get("latent_channels") != vae.config.latent_channels:
        raise InputError(
            f"{folder}: a decoder of {sizes.get('latent_channels')} latent channels; this model "
            f"has {vae.config.latent_channels}."
        )
    path = folder / WEIGHTS
    if not path.is_file() or sha256_of(path) != document.get("sha256"):
        raise InputError(f"{path}: is not the file that {CONFIG} names.")
    has_quantization = bool(sizes.pop("has_quantization", False))
    decoder = _module(sizes, has_quantization=has_quantization)
    try:
        decoder.load_state_dict(load_file(str(path)))
    except RuntimeError as error:
        raise InputError(f"{path}: does not fit its sizes ({str(error)[:200]}).") from error
    for module in decoder.modules() if tiling else ():
        if isinstance(module, torch.nn.Conv2d):
            module.padding_mode = "circular"
    device = next(vae.parameters()).device
    return decoder.to(device).eval()
