# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products and inverses without BLAS threads, which take longer to wake than the work."""

from __future__ import annotations

from typing import Final

import numpy as np

from .arrays import F64

# Largest number of multiplications in a product without threads of OpenBLAS
_UNTHREADED: Final = 1 << 18


def stacked_product(stacked: F64, factors: F64) -> F64:
    """Products (k, n V) of each row of stacked matrices (k, n, K) with all factors (V, K)."""
    size, (stack, count, width) = len(factors), stacked.shape
    products = np.empty((stack, count, size))
    # Parts small enough for one thread; single rows by einsum, because BLAS threads long rows.
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


def inverse_3x3(matrices: F64) -> F64:
    """Inverses of well-conditioned matrices (T, 3, 3) by cofactors.

    LAPACK would start threads for each matrix.
    """
    next_rows, last_rows = matrices[:, [1, 2, 0]], matrices[:, [2, 0, 1]]
    crosses = (
        next_rows[:, :, [1, 2, 0]] * last_rows[:, :, [2, 0, 1]]
        - next_rows[:, :, [2, 0, 1]] * last_rows[:, :, [1, 2, 0]]
    )
    cofactors = crosses.transpose(0, 2, 1)  # adjugate: cross products of the rows as columns
    determinants = np.einsum("ti,ti->t", matrices[:, 0], crosses[:, 0])
    inverses = cofactors / determinants[:, None, None]
    # A Newton step removes the cancellation errors of the cofactors.
    inverses = inverses @ (2.0 * np.eye(3) - matrices @ inverses)
    return np.asarray(inverses)


def affine_inverse(matrices: F64) -> F64:
    """Inverses of regular affine matrices (T, 4, 4) with last row 0, 0, 0, 1."""
    inverses = np.zeros(matrices.shape)
    inverses[:, :3, :3] = inverse_3x3(matrices[:, :3, :3])
    inverses[:, :3, 3] = -np.einsum("tij,tj->ti", inverses[:, :3, :3], matrices[:, :3, 3])
    inverses[:, 3, 3] = 1.0
    return inverses
