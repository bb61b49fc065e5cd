# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds and loads the compiled library, if there is one."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from . import sources

INTERFACE: Final = 8
"""Version in ``source/hfx_native.h``: any other library is not loaded."""

SWITCH: Final = "HFX_NATIVE"
"""Environment variable: 0 leaves the library out."""

NAME: Final = {"win32": "hfx_native.dll", "darwin": "hfx_native.dylib"}.get(
    sys.platform, "hfx_native.so"
)


class ArrayOf:
    """Argument or field: a contiguous array of some types, or None.

    A call has its arguments until it is over, and a structure what it was made of: so no array is
    gone before it was read, whether or not it has a name.
    """

    def __init__(self, *types: npt.DTypeLike) -> None:
        self._types = tuple(np.dtype(each) for each in types)
        self._first = self._types[0] if types else None

    def from_param(self, array: Any) -> Any:
        """Array as an argument, as ctypes asks for it."""
        if array is None:
            return None
        if array.dtype is not self._first:
            self._check(array)
        try:  # four times as fast as asking the array
            return _by_reference(_start(array))
        except (TypeError, ValueError):  # it is not to be written, empty, or not contiguous
            return ctypes.c_void_p(self.address(array))

    def address(self, array: Any) -> int:
        """Address of an array's data; the array must live as long as that is used.

        Raises
        ------
        TypeError
            It is of another type, or not contiguous.
        """
        if array.dtype is not self._first:
            self._check(array)
        try:
            return _address(_start(array))
        except (TypeError, ValueError):
            if not array.flags.c_contiguous:
                raise TypeError("expected a contiguous array") from None
            found: int = array.ctypes.data
            return found

    def _check(self, array: npt.NDArray[Any]) -> None:
        if self._types and array.dtype not in self._types:
            raise TypeError(f"expected an array of {self._types[0]}, got one of {array.dtype}")


_by_reference, _address, _start = ctypes.byref, ctypes.addressof, ctypes.c_char.from_buffer

POINTER: Final[Any] = ctypes.c_void_p
INTEGER: Final[Any] = ctypes.c_int64
DOUBLE: Final[Any] = ctypes.c_double
DOUBLES: Final[Any] = ArrayOf(np.float64)
SINGLES: Final[Any] = ArrayOf(np.float32)
LONGS: Final[Any] = ArrayOf(np.int64, np.uint64)
INTS: Final[Any] = ArrayOf(np.int32, np.uint32)
BYTES: Final[Any] = ArrayOf(np.uint8, np.bool_)
ANY: Final[Any] = ArrayOf()
"""Arguments of the library's functions, fields of its structures."""


@cache
def library() -> ctypes.CDLL | None:
    """Library, loaded once; None without a fitting one."""
    return _found()[0]


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
    return _found()[1]


def _found() -> tuple[ctypes.CDLL | None, str]:
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
    found.hfx_interface.argtypes, found.hfx_interface.restype = (), ctypes.c_int64
    if found.hfx_interface() != INTERFACE:
        raise ValueError(f"has interface {found.hfx_interface()}, not {INTERFACE}")
    found.hfx_build.argtypes, found.hfx_build.restype = (), ctypes.c_char_p
    build = found.hfx_build().decode(errors="replace").split()
    own = sources.digest()
    if build and own and build[1:2] != [own]:
        raise ValueError("was built of other sources; install the package again")
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


class Structure(ctypes.Structure):
    """Structure of the library. It keeps the arrays that it is made of; see :func:`structure`."""

    _arrays: tuple[tuple[int, Callable[[Any], int]], ...] = ()

    def __init__(self, *values: Any) -> None:
        self.kept, given = values, list(values)
        for field, address in self._arrays:
            if field < len(given) and given[field].__class__ is np.ndarray:
                given[field] = address(given[field])
        super().__init__(*given)


def pointer_to(made: ctypes.Structure | None) -> Any:
    """Argument that is a structure, or none."""
    return None if made is None else ctypes.byref(made)


def structure(name: str, **types: Any) -> type[Structure]:
    """A structure of the library with these fields, in this order."""
    kinds = enumerate(types.values())
    arrays = tuple((k, each.address) for k, each in kinds if isinstance(each, ArrayOf))
    fields = [(key, POINTER if isinstance(each, ArrayOf) else each) for key, each in types.items()]
    return type(name, (Structure,), {"_fields_": fields, "_arrays": arrays})
