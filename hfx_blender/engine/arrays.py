# SPDX-License-Identifier: GPL-3.0-or-later
"""Array types, indexing helpers, products and inverses of matrices, and .npz archives.

Products and inverses run without BLAS threads, which take longer to wake than the work.
"""

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
U32 = npt.NDArray[np.uint32]
U64 = npt.NDArray[np.uint64]
Bool = npt.NDArray[np.bool_]
Weights = npt.NDArray[np.floating[Any]]

NPZ_DAMAGE: Final = (
    OSError,
    EOFError,
    ValueError,
    ArithmeticError,
    LookupError,
    AttributeError,  # a member other than an array
    RuntimeError,
    struct.error,
    # numpy parses array headers as Python text
    SyntaxError,
    TypeError,
    MemoryError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""Exceptions of numpy, zipfile and zlib for damaged .npz archives (found by fuzzing)."""


def ramp(counts: I64) -> tuple[I64, I64]:
    """Steps and owners of counts: (2, 3) gives 0 1 0 1 2 and 0 0 1 1 1."""
    owners = np.repeat(np.arange(len(counts)), counts)
    steps = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    return steps, owners


def expand(offsets: I64, rows: I64 | I32) -> tuple[I64, I64]:
    """Indices of all entries of sparse rows ``rows`` (n,), and the position 0 to n - 1 of each
    entry's row. Row ``r`` holds the entries ``offsets[r]`` to ``offsets[r + 1] - 1``."""
    steps, owners = ramp(offsets[rows + 1] - offsets[rows])
    return offsets[rows][owners] + steps, owners


def missing_ids(has_entry: Bool, ids: I64) -> I64:
    """Sorted unique ids, of ``ids``, with False in ``has_entry``."""
    is_known = has_entry[ids]
    return np.zeros(0, np.int64) if is_known.all() else np.unique(ids[~is_known])


def sorted_by(keys: npt.NDArray[np.integer[Any]], count: int) -> tuple[I64, I64]:
    """Stable counting sort of keys (E,) in 0..count - 1: order (E,) that sorts them, and the first
    position of each key in it (count + 1,)."""
    # numpy sorts 16-bit keys by radix sort.
    short = keys.astype(np.uint16) if count <= 1 << 16 else keys
    order = np.argsort(short, kind="stable").astype(np.int64, copy=False)
    starts = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(keys, minlength=count), out=starts[1:])
    return order, starts


def write_npz(
    file: BinaryIO, arrays: Mapping[str, npt.NDArray[Any]], *, is_compressed: bool = False
) -> None:
    """Write arrays as ``numpy.savez``, closing the archive if a write fails. Raises OSError: the
    file cannot be written."""
    method = zipfile.ZIP_DEFLATED if is_compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(  # type: ignore[no-untyped-call]
                    entry, np.asanyarray(array), allow_pickle=False
                )


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
    """Inverses of well-conditioned matrices (T, 3, 3) by cofactors. LAPACK would start threads for
    each matrix."""
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
