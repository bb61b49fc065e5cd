# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of a touch decoder against a fixed encoder (Liu and Gu 2025, section 3.3).

Pixel, perceptual and adversarial terms; the adversarial weight is adapted to the gradients at the
last layer, as in Esser, Rombach and Ommer (2021, equation 7). The data of a step depends on its
number alone, so an interrupted training resumes with equal results.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from hfx_blender.engine.arrays import F32
from hfx_blender.errors import InputError

from . import touch_decoder
from .model_folder import libraries

STATE: Final = "training.safetensors"
_OWN: Final = "decoder_now."
_OTHER: Final = "discriminator."


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of the paper; the paper states no weights of the terms and no decay."""

    steps: int = 100_000
    batch: int = 2
    learning_rate: float = 1e-4  # Adam, decoder
    discriminator_rate: float = 1e-4  # AdamW
    warm_up: int = 500
    clipping: float = 1.0
    perceptual_weight: float = 0.1
    adversarial_weight: float = 0.1
    seed: int = 0
    saved_every: int = 500


class Pairs(Protocol):
    """Interface of training pairs: colours (3, H, W) and intensity (1, H, W), both -1..1."""

    def __len__(self) -> int: ...

    def __getitem__(self, number: int) -> tuple[F32, F32]: ...


class PerceptualNetwork:
    """Perceptual distance of pictures, in the features of a network.

    ``folder``: vision model of transformers, safetensors. None: a fixed random network.
    """

    def __init__(self, folder: Path | None, device: str) -> None:
        torch, _ = libraries()
        self._torch = torch
        self.name = "fixed random network" if folder is None else folder.name
        if folder is None:
            self._network = _random_network(torch)
        else:
            import transformers

            try:
                self._network = transformers.AutoModel.from_pretrained(
                    str(folder), local_files_only=True, use_safetensors=True
                )
            except Exception as error:  # as in ModelFolder
                reason = [*str(error).strip().splitlines(), type(error).__name__][0]
                raise InputError(f"{folder}: cannot be loaded ({reason}).") from error
        self._network.to(device).eval().requires_grad_(False)
        self._is_random = folder is None

    def distance(self, one: Any, other: Any) -> Any:
        """Mean squared difference of unit feature vectors, summed over all layers.

        ``one`` and ``other`` are grey pictures (N, 1, H, W).
        """
        total = 0.0
        for a, b in zip(self._features(one), self._features(other), strict=True):
            a, b = (x / (x.norm(dim=1, keepdim=True) + 1e-6) for x in (a, b))
            total = total + (a - b).square().sum(dim=1).mean()
        return total

    def _features(self, grey: Any) -> Sequence[Any]:
        picture = grey.expand(-1, 3, -1, -1)
        if not self._is_random:
            hidden_states = self._network(picture, output_hidden_states=True).hidden_states
            return [state for state in hidden_states if state.dim() == 4]
        features = []
        for layer in self._network:
            picture = self._torch.nn.functional.leaky_relu(layer(picture), 0.2)
            features.append(picture)
        return features


def _random_network(torch: Any) -> Any:
    generator = torch.Generator().manual_seed(0)
    layers = torch.nn.ModuleList()
    for before, after in ((3, 16), (16, 32), (32, 32)):
        layer = torch.nn.Conv2d(before, after, 3, stride=2, padding=1)
        with torch.no_grad():
            layer.weight.normal_(0.0, (2.0 / (9 * before)) ** 0.5, generator=generator)
            layer.bias.zero_()
        layers.append(layer)
    return layers


def _discriminator(torch: Any) -> Any:
    """Small discriminator of patches (Isola et al. 2017)."""
    nn = torch.nn
    return nn.Sequential(
        nn.Conv2d(1, 32, 4, 2, 1), nn.LeakyReLU(0.2),
        nn.Conv2d(32, 64, 4, 2, 1), nn.GroupNorm(8, 64), nn.LeakyReLU(0.2),
        nn.Conv2d(64, 1, 4, 1, 1),
    )  # fmt: skip


class DecoderTraining:
    """Resumable training of a touch decoder.

    Parameters
    ----------
    vae : module
        VAE of the diffusion model, unchanged.
    folder : Path
        Folder of the decoder and the training's state; an existing state is resumed.

    Raises
    ------
    InputError
        The folder has a training with other settings, or a broken state.
    """

    def __init__(
        self,
        vae: Any,
        pairs: Pairs,
        folder: Path,
        settings: TrainingSettings | None = None,
        perceptual: Path | None = None,
    ) -> None:
        self._torch, _ = libraries()
        self.settings = settings or TrainingSettings()
        self._vae, self._pairs, self.folder = vae.eval().requires_grad_(False), pairs, folder
        self._device = next(vae.parameters()).device
        self.network = PerceptualNetwork(perceptual, str(self._device))
        torch = self._torch
        torch.manual_seed(self.settings.seed)
        self.decoder = touch_decoder.from_vae(vae).to(self._device).requires_grad_(True)
        self.discriminator = _discriminator(torch).to(self._device)
        chosen = self.settings
        self._adam = torch.optim.Adam(self.decoder.parameters(), chosen.learning_rate)
        self._adamw = torch.optim.AdamW(self.discriminator.parameters(), chosen.discriminator_rate)
        self.step = 0
        if (folder / STATE).is_file():
            self._resume()

    def run(
        self,
        progress: Callable[[float], None] = lambda share: None,
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        """Train up to the last step or cancellation; saves at intervals and at the end."""
        while self.step < self.settings.steps and not is_cancelled():
            self._one_step()
            self.step += 1
            progress(self.step / self.settings.steps)
            if self.step % self.settings.saved_every == 0:
                self.save()
        self.save()

    def _batch(self) -> tuple[Any, Any]:
        """Latents and intensity maps of the current step, chosen by seed and step."""
        torch = self._torch
        rng = np.random.default_rng([self.settings.seed, self.step])
        chosen = rng.integers(len(self._pairs), size=self.settings.batch)
        chosen_pairs = [self._pairs[int(k)] for k in chosen]
        colours, maps = (
            torch.from_numpy(np.stack(arrays)).to(self._device)
            for arrays in zip(*chosen_pairs, strict=True)
        )
        return self.encoded(colours), maps

    def encoded(self, colours: Any) -> Any:
        """Latents of pictures (N, 3, H, W) in -1..1: the mode of the fixed encoder."""
        with self._torch.no_grad():
            return self._vae.encode(colours).latent_dist.mode()

    def _one_step(self) -> None:
        torch, chosen = self._torch, self.settings
        latents, truth = self._batch()
        estimate = self.decoder(latents)
        pixel = (estimate - truth).abs().mean()
        near = pixel + chosen.perceptual_weight * self.network.distance(estimate, truth)
        fooled = -self.discriminator(estimate).mean()
        last = self.decoder.decoder.conv_out.weight
        # Equation 7: the adversarial gradient at the last layer gets the size of the other terms'.
        norms = [
            torch.autograd.grad(term, last, retain_graph=True)[0].norm() for term in (near, fooled)
        ]
        weight = (norms[0] / (norms[1] + 1e-4)).clamp(0.0, 1e4).detach()
        self._adam.zero_grad(set_to_none=True)
        (near + chosen.adversarial_weight * weight * fooled).backward()
        torch.nn.utils.clip_grad_norm_(self.decoder.parameters(), chosen.clipping)
        self._adam.step()

        hinge = torch.nn.functional.relu
        loss = hinge(1.0 - self.discriminator(truth)).mean()
        loss = loss + hinge(1.0 + self.discriminator(estimate.detach())).mean()
        self._adamw.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.discriminator.parameters(), chosen.clipping)
        for group in self._adamw.param_groups:
            group["lr"] = chosen.discriminator_rate * self._rate()
        self._adamw.step()

    def _rate(self) -> float:
        """Share of the discriminator's rate: a linear warm-up, then a half cosine down to 0."""
        chosen = self.settings
        if self.step < chosen.warm_up:
            return (self.step + 1) / chosen.warm_up
        rest = max(chosen.steps - chosen.warm_up, 1)
        return float(0.5 + 0.5 * np.cos(np.pi * (self.step - chosen.warm_up) / rest))

    def errors(self, pairs: Pairs, numbers: Sequence[int]) -> dict[str, float]:
        """Mean MSE (of values 0..1) and perceptual distance of the current decoder on pairs."""
        torch = self._torch
        squares, distances = [], []
        with torch.no_grad():
            for number in numbers:
                colours, truth = (
                    torch.from_numpy(pair[None]).to(self._device) for pair in pairs[number]
                )
                estimate = self.decoder(self.encoded(colours)).clamp(-1.0, 1.0)
                squares.append(float((0.5 * (estimate - truth)).square().mean()))
                distances.append(float(self.network.distance(estimate, truth)))
        return {
            "mse": float(np.mean(squares)),
            "perceptual_distance": float(np.mean(distances)),
        }

    # State

    def save(self) -> None:
        """Write the decoder, and the state of both networks and optimizers."""
        from safetensors.torch import save_file

        record = {
            "steps": self.step,
            "settings": asdict(self.settings),
            "perceptual_network": self.network.name,
        }
        touch_decoder.save(self.decoder, self.folder, record)
        state = {f"{_OWN}{k}": v for k, v in self.decoder.state_dict().items()}
        state |= {f"{_OTHER}{k}": v for k, v in self.discriminator.state_dict().items()}
        for name, optimizer in (("adam", self._adam), ("adamw", self._adamw)):
            for number, values in optimizer.state_dict()["state"].items():
                state |= {f"{name}.{number}.{key}": value for key, value in values.items()}
        state = {key: value.detach().cpu().contiguous().clone() for key, value in state.items()}
        # One file, replaced at once: after an interruption the state is never a mix of two steps.
        new_file = self.folder / f"{STATE}.new"
        save_file(state, str(new_file), {"record": json.dumps(record)})
        new_file.replace(self.folder / STATE)

    def _resume(self) -> None:
        from safetensors import SafetensorError, safe_open

        path = self.folder / STATE
        try:
            with safe_open(str(path), "pt", device=str(self._device)) as file:
                record = json.loads(file.metadata()["record"])
                state = {key: file.get_tensor(key) for key in file.keys()}
        except (SafetensorError, TypeError, KeyError, ValueError) as error:
            raise InputError(f"{path}: is no state of a training ({error}).") from error
        if record["settings"] != asdict(self.settings):
            raise InputError(f"{self.folder}: holds a training with other settings.")
        for prefix, module in ((_OWN, self.decoder), (_OTHER, self.discriminator)):
            own_state = {
                k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)
            }
            module.load_state_dict(own_state)
        for name, optimizer in (("adam", self._adam), ("adamw", self._adamw)):
            optimizer_state: dict[int, dict[str, Any]] = {}
            for key, value in state.items():
                if key.startswith(f"{name}."):
                    _, number, part = key.split(".")
                    optimizer_state.setdefault(int(number), {})[part] = value
            groups = optimizer.state_dict()["param_groups"]
            optimizer.load_state_dict({"state": optimizer_state, "param_groups": groups})
        self.step = int(record["steps"])
