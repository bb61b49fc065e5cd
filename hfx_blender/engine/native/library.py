# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for and loading of the compiled library."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from . import sources
from .declarations import declare

SWITCH: Final = "HFX_NATIVE"
"""Environment variable; 0 disables the library."""

_SECTIONS: Final = ((40, 48), (58, 60), (60, 62))  # of an ELF header, see :func:`_load`

NAME: Final = {"win32": "hfx_native.dll", "darwin": "hfx_native.dylib"}.get(
    sys.platform, "hfx_native.so"
)


@cache
def library() -> ctypes.CDLL | None:
    """Compiled library, loaded once; None where no usable file exists or ``HFX_NATIVE`` is 0."""
    return find_library()[0]


def loaded() -> ctypes.CDLL:
    """Compiled library; AssertionError without one."""
    native = library()
    assert native is not None
    return native


def is_there() -> bool:
    """True with the library; without it :mod:`..reference` computes contacts."""
    return library() is not None


def state() -> str:
    """Text for users: ``compiled``, or ``numpy`` and the reason in parentheses."""
    return find_library()[1]


def find_library() -> tuple[ctypes.CDLL | None, str]:
    """Search for a library and load the first usable file, ignoring any loaded before.

    Returns the library or None, and the text of :func:`state`.
    """
    if os.environ.get(SWITCH) == "0":
        return None, f"numpy ({SWITCH}=0)"
    faults = []
    for path in _library_files():
        try:
            return _load(path), "compiled"
        except (OSError, AttributeError, ValueError) as error:
            faults.append(f"{path}: {error}")
    return None, f"numpy ({'; '.join(faults) or 'no library was built'})"


def _library_files() -> Iterator[Path]:
    """Existing library files: in this folder, then in the module that a Blender extension bundles.

    The module is named after the digest of the sources; no code of the module is imported.
    """
    folders = [Path(__file__).parent]
    try:
        spec = importlib.util.find_spec(f"{sources.MARK}_{sources.digest()}")
        folders += map(Path, (spec and spec.submodule_search_locations) or ())
    except (ImportError, ValueError, AttributeError):
        pass  # another module has that name
    return (path for path in (folder / NAME for folder in folders) if path.is_file())


def _load(path: Path) -> ctypes.CDLL:
    """Load a library file and declare the functions.

    Raises OSError for a file of another platform, unreadable or damaged, AttributeError for another
    library, and ValueError for a library of other sources.
    """
    # ``dlopen`` of a truncated file kills the process with SIGBUS: the section table at the end of
    # a Linux library (ELF) must be there. Bytes of the header: its offset, entry size and count.
    with path.open("rb") as file:
        head, size = file.read(64), file.seek(0, os.SEEK_END)
    table, entry, count = (int.from_bytes(head[a:b], "little") for a, b in _SECTIONS)
    if head[:4] == b"\x7fELF" and (len(head) < 64 or size < table + entry * count):
        raise OSError("the file is cut off")
    native = ctypes.CDLL(str(path))
    native.hfx_build.argtypes, native.hfx_build.restype = (), ctypes.c_char_p
    build = native.hfx_build().decode(errors="replace").split()
    # A digest that differs means arguments in another order: refuse before any call.
    own = sources.digest()
    if build and own and build[1:2] != [own]:
        raise ValueError("was built of other sources; install the package again")
    declare(native)
    return native


def f64(array: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Contiguous float64 copy or view of an array."""
    return np.ascontiguousarray(array, np.float64)


def i64(array: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Contiguous int64 copy or view of an array."""
    return np.ascontiguousarray(array, np.int64)
