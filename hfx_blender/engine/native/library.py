# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds and loads the compiled library, if there is one."""

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

from ...errors import InputError
from . import sources
from .declarations import declare

SWITCH: Final = "HFX_NATIVE"
"""Environment variable: 0 leaves the library out."""

NAME: Final = {"win32": "hfx_native.dll", "darwin": "hfx_native.dylib"}.get(
    sys.platform, "hfx_native.so"
)


@cache
def library() -> ctypes.CDLL | None:
    """Library, loaded once; None without a fitting one."""
    return find_library()[0]


def loaded() -> ctypes.CDLL:
    """Library, which must be there."""
    found = library()
    assert found is not None
    return found


def is_there() -> bool:
    """Test for the library; without it contacts are computed by :mod:`..reference`."""
    return library() is not None


def require_in_time() -> None:
    """Refuse to feel volumes while somebody waits for it, where the library is missing.

    Raises
    ------
    InputError
    """
    if not is_there():
        raise InputError(
            "Live playback and preview of haptic volumes need the compiled part of HFX, which is "
            "missing here; only exports work without it, far more slowly (docs/native.md)."
        )


def state() -> str:
    """``compiled``, or ``numpy`` and why; for people."""
    return find_library()[1]


def find_library() -> tuple[ctypes.CDLL | None, str]:
    """Library, or None, and its :func:`state`; loaded anew, whatever was loaded before."""
    if os.environ.get(SWITCH) == "0":
        return None, f"numpy ({SWITCH}=0)"
    faults = []
    for path in _places():
        try:
            return _load(path), "compiled"
        except (OSError, AttributeError, ValueError) as error:
            faults.append(f"{path}: {error}")
    return None, f"numpy ({'; '.join(faults) or 'no library was built'})"


def _places() -> Iterator[Path]:
    """Existing files: beside this one, then in the module that a Blender extension brings.

    That one is named after the sources' digest; nothing of it is imported.
    """
    folders = [Path(__file__).parent]
    try:
        spec = importlib.util.find_spec(f"{sources.MARK}_{sources.digest()}")
        folders += map(Path, (spec and spec.submodule_search_locations) or ())
    except (ImportError, ValueError, AttributeError):
        pass  # something else of that name
    return (path for path in (folder / NAME for folder in folders) if path.is_file())


def _load(path: Path) -> ctypes.CDLL:
    """Load one file.

    Raises
    ------
    OSError
        It is for another computer, cannot be read, or is damaged.
    AttributeError
        It is something else.
    ValueError
        It fits another version of the package.
    """
    if _is_cut_off(path):
        raise OSError("the file is cut off")
    found = ctypes.CDLL(str(path))
    found.hfx_build.argtypes, found.hfx_build.restype = (), ctypes.c_char_p
    build = found.hfx_build().decode(errors="replace").split()
    own = sources.digest()
    if build and own and build[1:2] != [own]:
        raise ValueError("was built of other sources; install the package again")
    declare(found)
    return found


def _is_cut_off(path: Path) -> bool:
    """Test a library for Linux for a missing end: loading such a file would end the process."""
    with path.open("rb") as file:
        head = file.read(64)
        size = file.seek(0, os.SEEK_END)
    if head[:4] != b"\x7fELF":
        return False
    table, one, count = (int.from_bytes(head[a:b], "little") for a, b in _SECTIONS)
    return len(head) < 64 or size < table + one * count


_SECTIONS: Final = ((40, 48), (58, 60), (60, 62))  # where the table at the end is, and how long


def f64(array: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Contiguous float64 copy or view of an array."""
    return np.ascontiguousarray(array, np.float64)


def i64(array: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Contiguous int64 copy or view of an array."""
    return np.ascontiguousarray(array, np.int64)
