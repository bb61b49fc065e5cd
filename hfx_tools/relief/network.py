# SPDX-License-Identifier: GPL-3.0-or-later
"""Network of :mod:`...engine.texture.relief_network` in PyTorch, for training."""

from __future__ import annotations

from typing import Final

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from hfx_blender.engine.arrays import F32

WIDTHS: Final = (16, 32, 64, 96)
"""Channels at a half, a quarter, an eighth and a sixteenth of the picture's resolution."""


class Convolution(nn.Conv2d):
    """3 x 3 convolution with padding for tileable ("circular") or plain ("replicate") pictures."""

    mode = "circular"

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, 3)

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(functional.pad(x, (1, 1, 1, 1), self.mode))


class ReliefNetwork(nn.Module):
    """U-net from prepared colours (B, 3, H, W) to height, slope and roughness (B, 3, H, W)."""

    def __init__(self) -> None:
        super().__init__()
        a, b, c, d = WIDTHS
        self.first1, self.first2 = Convolution(12, a), Convolution(a, a)
        self.second1, self.second2 = Convolution(a, b), Convolution(b, b)
        self.third1, self.third2 = Convolution(b, c), Convolution(c, c)
        self.fourth1, self.fourth2 = Convolution(c, d), Convolution(d, d)
        self.overall = nn.Linear(d, d)
        self.to_third, self.back3 = nn.Conv2d(d, c, 1), Convolution(c, c)
        self.to_second, self.back2 = nn.Conv2d(c, b, 1), Convolution(b, b)
        self.to_first, self.back1 = nn.Conv2d(b, a, 1), Convolution(a, a)
        self.last = Convolution(a, 12)

    def set_tiles(self, tiles: bool) -> None:
        """Set the padding of all convolutions for tileable or plain pictures."""
        for part in self.modules():
            if isinstance(part, Convolution):
                part.mode = "circular" if tiles else "replicate"

    def forward(self, x: Tensor) -> Tensor:
        x = functional.pixel_unshuffle(x, 2)
        half = _leaky_relu(self.first1(x))
        half = half + _leaky_relu(self.first2(half))
        quarter = _leaky_relu(self.second1(functional.avg_pool2d(half, 2)))
        quarter = quarter + _leaky_relu(self.second2(quarter))
        eighth = _leaky_relu(self.third1(functional.avg_pool2d(quarter, 2)))
        eighth = eighth + _leaky_relu(self.third2(eighth))
        sixteenth = _leaky_relu(self.fourth1(functional.avg_pool2d(eighth, 2)))
        sixteenth = sixteenth + _leaky_relu(self.fourth2(sixteenth))
        sixteenth = sixteenth + _leaky_relu(self.overall(sixteenth.mean((2, 3))))[:, :, None, None]
        eighth = eighth + _upsampled(self.to_third(sixteenth))
        eighth = eighth + _leaky_relu(self.back3(eighth))
        quarter = quarter + _upsampled(self.to_second(eighth))
        quarter = quarter + _leaky_relu(self.back2(quarter))
        half = half + _upsampled(self.to_first(quarter))
        half = half + _leaky_relu(self.back1(half))
        height, slope, rough = functional.pixel_shuffle(self.last(half), 2).unbind(1)
        return torch.stack(
            [4.0 * height, functional.softplus(slope - 2.0), torch.sigmoid(rough)], 1
        )


def _leaky_relu(x: Tensor) -> Tensor:
    return functional.leaky_relu(x, 0.1)


def _upsampled(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


def weights_of(network: ReliefNetwork) -> dict[str, F32]:
    """Weights of a network by name, float32 copies."""
    return {
        name: value.detach().numpy().astype(np.float32)
        for name, value in network.state_dict().items()
    }
