# SPDX-License-Identifier: GPL-3.0-or-later
"""Types of numpy arrays, by the type of their elements, and archives of arrays."""

from __future__ import annotations

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
    AttributeError,  # a member that is no array
    RuntimeError,
    struct.error,
    # numpy takes an array's header apart as Python text
    SyntaxError,
    TypeError,
    MemoryError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""Exceptions of numpy, zipfile and zlib for damaged archives, as found by changing bytes."""


def write_npz(
    file: BinaryIO, arrays: Mapping[str, npt.NDArray[Any]], *, is_compressed: bool = False
) -> None:
    """Write arrays as ``numpy.savez`` does; the archive is closed where the file cannot be written.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    method = zipfile.ZIP_DEFLATED if is_compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(  # type: ignore[no-untyped-call]
                    entry, np.asanyarray(array), allow_pickle=False
                )
