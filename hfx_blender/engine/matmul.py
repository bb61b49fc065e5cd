# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products that wake no threads of BLAS: those go on spinning for longer than they take."""

from __future__ import annotations

from typing import Final

import numpy as np

from .arrays import F64

_UNTHREADED: Final = 1 << 18
"""Multiplications in one product: more, or a single row of some thousands, and OpenBLAS would
wake threads for it."""


def stacked_product(stacked: F64, factors: F64) -> F64:
    """Stacked matrices (k, n, K) times factors (V, K): (k, n V)."""
    size, (stack, count, width) = len(factors), stacked.shape
    products = np.empty((stack, count, size))
    step = _UNTHREADED // max(size * width, 1)
    if step < 2:
        return np.einsum("ink,vk->inv", stacked, factors, out=products).reshape(stack, -1)
    for first in range(0, count, step):
        part = stacked[:, first : first + step]
        out = products[:, first : first + step]
        if part.shape[1] == 1:
            np.einsum("ink,vk->inv", part, factors, out=out)
        else:
            np.matmul(part, factors.T, out=out)
    return products.reshape(stack, -1)
