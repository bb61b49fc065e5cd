# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of the network from picture to relief; needs PyTorch (extra ``train``)."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Final

import numpy as np
import torch
import torch.distributed
from torch import Tensor
from torch.nn import functional

from hfx_blender.engine.texture.relief.relief_network import prepared
from hfx_blender.files.atomic import atomic_file
from hfx_blender.processes import start

from . import data_set
from .network import ReliefNetwork, weights_of
from .weight_storage import packed

SEED: Final = 1
SAMPLES: Final = 8000
STEPS: Final = 28000
_WHOLE: Final = 0.25  # share of steps with whole, tileable pictures; the rest uses crops
_BATCH: Final = {True: 4, False: 8}
_CROP: Final = 128
_RATE: Final = 3e-3
_WARM: Final = 100  # steps up to the full learning rate; then the rate falls linearly to 0
_LEARNERS: Final = 3
_AVERAGE_EVERY: Final = 10  # steps between two averages of the processes' weights

_AVERAGED: Final = 0.98
"""Share of the old value in the running mean of weights at each average; the mean is stored."""

_MODULE: Final = "hfx_tools.relief.training"
_RENDEZVOUS: Final = ".hfx-relief-training"  # rendezvous file of the processes
_LATEST: Final = "latest.npz"


def train(folder: Path, *, jobs: int = 2, steps: int = STEPS) -> dict[str, np.ndarray]:
    """Train a network on pictures generated into ``folder``; returns the weights by name.

    Three processes learn from different pictures, and average their weights every ten steps
    (McMahan et al. 2017, "Communication-efficient learning"). The first process prints progress.

    Parameters
    ----------
    jobs : int
        Number of processes for generating pictures.
    steps : int
        Steps of each process.

    Raises
    ------
    RuntimeError
        A process failed; its error output has the reason.
    """
    data_set.opened(folder, SAMPLES, SEED, jobs)
    (folder / _RENDEZVOUS).unlink(missing_ok=True)
    data_set.run_together(
        [start.command(_MODULE, folder, str(rank), str(steps)) for rank in range(_LEARNERS)]
    )
    with np.load(folder / _LATEST) as file:
        return dict(file)


def _learn(folder: Path, rank: int, steps: int) -> None:
    """Train in one of the processes; the first stores the running mean of the weights."""
    torch.manual_seed(SEED)
    torch.set_num_threads(1)
    torch.distributed.init_process_group(
        "gloo", f"file://{(folder / _RENDEZVOUS).resolve()}", rank=rank, world_size=_LEARNERS
    )
    data, rng = data_set.opened(folder, SAMPLES, SEED, 1), np.random.default_rng([SEED, rank])
    network, mean = ReliefNetwork(), ReliefNetwork()
    mean.load_state_dict(network.state_dict())
    optimizer = torch.optim.AdamW(network.parameters(), _RATE, weight_decay=1e-3)
    begin, losses = time.monotonic(), []
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = _RATE * min((step + 1) / _WARM, (steps - step) / steps)
        losses.append(_step(network, optimizer, data, rng))
        if (step + 1) % _AVERAGE_EVERY == 0:
            _average_weights(network, mean, min(_AVERAGED, step / (step + 100.0)))
        if rank == 0 and ((step + 1) % 100 == 0 or step + 1 == steps):
            np.savez(folder / _LATEST, **weights_of(mean))
            spent, loss = time.monotonic() - begin, np.mean(losses[-100:])
            sys.stderr.write(f"step {step + 1} of {steps}: loss {loss:.4f}, {spent:.0f} s\n")
            sys.stderr.flush()
    torch.distributed.destroy_process_group()


def _step(
    network: ReliefNetwork,
    optimizer: torch.optim.Optimizer,
    data: data_set.DataSet,
    rng: np.random.Generator,
) -> float:
    tiles = bool(rng.random() < _WHOLE)
    network.set_tiles(tiles)
    inputs, truth = _batch(data, rng, tiles)
    # Half the time of float32 on processors with bfloat16 instructions.
    with torch.autocast("cpu", torch.bfloat16):
        estimates = network(inputs.contiguous(memory_format=torch.channels_last))
    loss = loss_of(estimates.float(), truth)
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    return float(loss.detach())


@torch.no_grad()
def _average_weights(network: ReliefNetwork, mean: ReliefNetwork, old_share: float) -> None:
    """Average the weights of all processes, and update the running mean, both in place."""
    values = torch.nn.utils.parameters_to_vector(network.parameters())
    torch.distributed.all_reduce(values)
    torch.nn.utils.vector_to_parameters(values / _LEARNERS, network.parameters())
    for old, new in zip(mean.parameters(), network.parameters(), strict=True):
        old.lerp_(new, 1.0 - old_share)


def _batch(data: data_set.DataSet, rng: np.random.Generator, tiles: bool) -> tuple[Tensor, Tensor]:
    """Random inputs (B, 3, H, W) and truth (B, 3, H, W): heights, slopes, roughness; rotated."""
    inputs, truths = [], []
    for k in rng.integers(0, len(data.pictures), _BATCH[tiles]):
        slices: tuple[slice, ...] = (slice(None), slice(None))
        if not tiles:
            first = rng.integers(0, data_set.TEXELS - _CROP + 1, 2)
            slices = tuple(slice(f, f + _CROP) for f in first)
        truth = np.stack(
            [
                data.heights[k][slices].astype(np.float32),
                data_set.slopes_of(data.slopes[k][slices]),
                data.roughness[k][slices].astype(np.float32) / 255.0,
            ]
        )
        colours = data.pictures[k][slices].astype(np.float32) / 255.0
        if rng.random() < 0.5:
            colours = colours[..., rng.permutation(3)]
        both = np.concatenate([prepared(colours), truth])
        both = np.rot90(both, rng.integers(4), (1, 2))
        both = both[:, ::-1] if rng.random() < 0.5 else both
        inputs.append(both[:3])
        truths.append(both[3:])
    return torch.from_numpy(np.stack(inputs)), torch.from_numpy(np.stack(truths))


def loss_of(estimates: Tensor, truth: Tensor) -> Tensor:
    """Loss of estimates (B, 3, H, W): errors of slope, slope pattern, level, height, roughness.

    Pattern and height are compared by correlation, independent of scale, and left out for a flat
    surface.
    """
    height, slope, rough = estimates.unbind(1)
    true_height, true_slope, true_rough = truth.unbind(1)
    true_slope = true_slope.clamp(max=1.0)
    error = (slope - true_slope).abs().mean((1, 2))
    level = slope.clamp(max=1.0).mean((1, 2)) + 0.01
    true_level = true_slope.mean((1, 2)) + 0.01
    level_error = (level / true_level).log().abs()
    has_relief = (true_level > 0.015).float()
    pattern = has_relief * (1.0 - _correlation(slope.clamp(max=1.5), true_slope))
    shape = has_relief * (1.0 - _correlation(height, true_height))
    steps = (
        has_relief
        * 0.5
        * sum(1.0 - _correlation(height.diff(dim=k), true_height.diff(dim=k)) for k in (1, 2))
    )
    dull = (rough - true_rough).abs().mean((1, 2))
    parts = 3.0 * error + pattern + 0.3 * level_error + 0.1 * shape + 0.15 * steps + 0.3 * dull
    # Correlation ignores the scale of heights, so mean slopes of heights are compared, too.
    rise = torch.sqrt(
        height[:, :-1].diff(dim=2) ** 2 + height[:, :, :-1].diff(dim=1) ** 2 + 1e-6
    ).mean((1, 2))
    true_rise = torch.sqrt(
        true_height[:, :-1].diff(dim=2) ** 2 + true_height[:, :, :-1].diff(dim=1) ** 2 + 1e-6
    ).mean((1, 2))
    return (parts + 0.1 * ((rise + 0.01) / (true_rise + 0.01)).log().abs()).mean()


def _correlation(a: Tensor, b: Tensor) -> Tensor:
    a = a - a.mean((1, 2), keepdim=True)
    b = b - b.mean((1, 2), keepdim=True)
    return functional.cosine_similarity(a.flatten(1), b.flatten(1), eps=1e-4)


def store(weights: dict[str, np.ndarray], path: Path) -> int:
    """Write weights; returns the size of the file in bytes."""
    with atomic_file(path) as stream:
        np.savez_compressed(stream, **packed(weights))
    return path.stat().st_size


if __name__ == "__main__":
    _learn(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
