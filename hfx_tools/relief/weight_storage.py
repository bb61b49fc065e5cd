# SPDX-License-Identifier: GPL-3.0-or-later
"""Storage form of the relief network's weights, written after a training."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.texture.relief.relief_network import STEP, Weights

_LEAST_STEP: Final = np.float32(1e-30)  # for outputs with zero weights only


def packed(weights: Weights) -> dict[str, npt.NDArray[np.generic]]:
    """Storage form: arrays as int8, -127..127, and a step per output; 1-D biases as they are."""
    stored: dict[str, npt.NDArray[np.generic]] = {}
    for name, value in weights.items():
        if value.ndim == 1:
            stored[name] = value
            continue
        step = np.abs(value).max(tuple(range(1, value.ndim)), keepdims=True) / np.float32(127.0)
        stored[name] = np.round(value / np.maximum(step, _LEAST_STEP)).astype(np.int8)
        stored[name + STEP] = step
    return stored
