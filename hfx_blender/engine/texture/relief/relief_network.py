# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolutional network in numpy for relief from the colours of a picture.

U-shaped (Ronneberger, Fischer and Brox 2015, "U-Net"), 280,000 weights of 8 bits, trained by ``hfx
texture train-relief`` on synthetic pictures.
"""

from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import F32
from .linear_light import luminance, srgb_to_linear

STRIDE: Final = 32  # divisor of a picture's edges; the edges of its half are multiples of 16
WEIGHTS: Final = Path(__file__).with_suffix(".npz")

_DARK: Final = 0.02  # light added before logarithms
_FLAT: Final = 0.03
"""Slope below which most texels are flat; the network's slopes are always above 0."""

STEP: Final = ".step"

_ROWS: Final = 64  # rows of a convolution at a time

Weights = dict[str, F32]


class Estimate(NamedTuple):
    """Estimate of relief, (H, W) each, bottom row first. Heights are in texels. Slope, metres per
    metre, is the Sobel magnitude of the true heights after a blur of one texel. Roughness is 0
    glossy to 1 dull."""

    heights: F32
    slope: F32
    roughness: F32


def prepared(srgb: npt.ArrayLike) -> F32:
    """Inputs (3, H, W) of colours (H, W, 3), sRGB 0..1: log luminance and two log colour ratios.
    Logarithms turn factors of light (colour, shadow) into sums; the mean luminance is
    subtracted."""
    light = srgb_to_linear(srgb)
    grey = np.log(luminance(light) + _DARK)
    red, blue = (np.log(light[..., k] + _DARK) - grey for k in (0, 2))
    return np.stack([2.0 * (grey - grey.mean()), 2.0 * red, 2.0 * blue]).astype(np.float32)


@cache
def stored_weights() -> Weights:
    """Weights of the file in the package, unpacked; cached, so not to be changed."""
    with np.load(WEIGHTS) as file:
        return unpacked(dict(file))


def unpacked(stored: dict[str, npt.NDArray[Any]]) -> Weights:
    """Weights, float32, of the storage form: int8 and a step per output, or as they are."""
    return {
        name: (value * stored.get(name + STEP, 1)).astype(np.float32)
        for name, value in stored.items()
        if not name.endswith(STEP)
    }


def estimated(srgb: npt.ArrayLike, *, tiles: bool, weights: Weights | None = None) -> Estimate:
    """Estimate the relief of a picture (H, W, 3), sRGB 0..1, with H and W multiples of 32.

    Slopes have no scale; the picture at half its resolution gives a second estimate of their mean,
    and the geometric mean of both is used. ``tiles`` continues the picture at its opposite edge.
    ``weights`` None: :func:`stored_weights`.
    """
    weights = stored_weights() if weights is None else weights
    colours = np.asarray(srgb, np.float32)
    # The mean slope is a matter of scale, so only the mean comes from the half resolution.
    full = of_all_turns(colours, weights, tiles)
    half = _pooled_by_two(colours.transpose(2, 0, 1)).transpose(1, 2, 0)
    ratio = of_all_turns(half, weights, tiles).slope.mean() / full.slope.mean()
    return full._replace(slope=full.slope * np.sqrt(ratio))


def of_all_turns(srgb: F32, weights: Weights, tiles: bool) -> Estimate:
    """Mean of the estimates for four rotations by 90 degrees; a slope s becomes s * s / (s +
    0.03), so faint slopes are reduced."""
    # The light of a picture comes from one side; turned pictures cancel that side's bias.
    inputs = prepared(srgb)
    total = np.zeros_like(inputs)
    for turns in range(4):
        outputs = forward(np.ascontiguousarray(np.rot90(inputs, turns, (1, 2))), weights, tiles)
        total += np.rot90(outputs, -turns, (1, 2))
    heights, slope, roughness = total * np.float32(0.25)
    # A soft threshold preserves the faint pattern of a smooth surface.
    return Estimate(heights, slope * (slope / (slope + np.float32(_FLAT))), roughness)


def forward(x: F32, weights: Weights, tiles: bool) -> F32:
    """Network outputs (3, H, W), heights, slope >= 0 and roughness 0..1, of inputs (3, H, W)."""

    def layer(x: F32, name: str, *, activated: bool = True) -> F32:
        out = convolved(x, weights[f"{name}.weight"], weights[f"{name}.bias"], tiles)
        return _leaky_relu(out) if activated else out

    def up(x: F32, name: str) -> F32:
        matrix = weights[f"{name}.weight"][:, :, 0, 0]
        out = np.tensordot(matrix, x, 1) + weights[f"{name}.bias"][:, None, None]
        return out.repeat(2, axis=1).repeat(2, axis=2)

    def deeper(x: F32, name: str) -> F32:
        x = layer(x, f"{name}1")
        x += layer(x, f"{name}2")
        return x

    # Down to a sixteenth of the resolution, and up again with the inputs of each level added.
    one = deeper(_unshuffled(x), "first")
    two = deeper(_pooled_by_two(one), "second")
    three = deeper(_pooled_by_two(two), "third")
    four = deeper(_pooled_by_two(three), "fourth")
    overall = weights["overall.weight"] @ four.mean((1, 2)) + weights["overall.bias"]
    four += _leaky_relu(overall)[:, None, None]
    three += up(four, "to_third")
    three += layer(three, "back3")
    two += up(three, "to_second")
    two += layer(two, "back2")
    one += up(two, "to_first")
    one += layer(one, "back1")
    height, slope, rough = _shuffled(layer(one, "last", activated=False))
    # Softplus keeps slopes above 0, a sigmoid keeps roughness within 0..1.
    return np.stack([4.0 * height, np.logaddexp(0.0, slope - 2.0), 1.0 / (1.0 + np.exp(-rough))])


def _leaky_relu(x: F32) -> F32:
    """Activation: ``x``, or a tenth of it below 0."""
    return np.maximum(x, np.float32(0.1) * x)


def _pooled_by_two(x: F32) -> F32:
    """Means (C, H / 2, W / 2) of squares of 2 x 2 texels of (C, H, W)."""
    channels, rows, columns = x.shape
    return x.reshape(channels, rows // 2, 2, columns // 2, 2).mean((2, 4))


def _unshuffled(x: F32) -> F32:
    """Squares of 2 x 2 texels as channels: (C, H, W) to (4 C, H / 2, W / 2)."""
    channels, rows, columns = x.shape
    parts = x.reshape(channels, rows // 2, 2, columns // 2, 2).transpose(0, 2, 4, 1, 3)
    return np.ascontiguousarray(parts).reshape(4 * channels, rows // 2, columns // 2)


def _shuffled(x: F32) -> F32:
    """Inverse of :func:`_unshuffled`."""
    channels, rows, columns = x.shape
    parts = x.reshape(channels // 4, 2, 2, rows, columns).transpose(0, 3, 1, 4, 2)
    return np.ascontiguousarray(parts).reshape(channels // 4, 2 * rows, 2 * columns)


def convolved(x: F32, kernel: F32, bias: F32, tiles: bool) -> F32:
    """Convolution (O, H, W) of (C, H, W) with a kernel (O, C, 3, 3), by matrix products. The three
    column shifts are stacked, so that row shifts are slices of the same array. Edges wrap for
    ``tiles``, else continue."""
    channels, rows, columns = x.shape
    outputs = len(kernel)
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1)), "wrap" if tiles else "edge")
    # One matrix per row of the kernel, its inputs in the order of ``shifts`` below.
    matrices = [kernel[:, :, k].transpose(0, 2, 1).reshape(outputs, -1) for k in range(3)]
    result = np.zeros((outputs, rows * columns), np.float32)
    for first in range(0, rows, _ROWS):
        count = min(_ROWS, rows - first)
        part = padded[:, first : first + count + 2]
        shifts = np.stack([part[:, :, k : k + columns] for k in range(3)])
        shifts = shifts.reshape(3 * channels, (count + 2) * columns)
        row_slice = slice(first * columns, (first + count) * columns)
        total = matrices[0] @ shifts[:, : count * columns]
        for k in (1, 2):
            total += matrices[k] @ shifts[:, k * columns : (k + count) * columns]
        total += bias[:, None]
        result[:, row_slice] = total
    return result.reshape(outputs, rows, columns)
