# SPDX-License-Identifier: GPL-3.0-or-later
"""Products and inverses of matrices."""

from __future__ import annotations

import numpy as np

from hfx_blender.engine.arrays import affine_inverse


def test_affine_inverse() -> None:
    """Scaled by two, turned by 90 degrees around z, and moved: x' = 1 - 2 y, y' = 2 + 2 x."""
    matrix = np.array([[[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]], np.float64)
    by_hand = [[0, 0.5, 0, -1], [-0.5, 0, 0, 0.5], [0, 0, 0.5, -1.5], [0, 0, 0, 1]]
    assert affine_inverse(matrix)[0].tolist() == by_hand
