# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for and loading of the compiled library, with its signatures and structures.

The build reads the C sources (``release/native_interface.py``); the library returns the result
as JSON. ``int64_t`` and ``double`` become numbers, ``const double *`` a float64 array for
reading, ``double *`` a float64 array for writing, ``const hfx_tree *`` a structure. Each array and
structure may be None.
"""

import ctypes
import importlib.util
import json
import os
import struct
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from . import sources

SWITCH: Final = "HFX_NATIVE"  # environment variable; 0 disables the library
_SECTIONS: Final = ((40, 48), (58, 60), (60, 62))  # of an ELF header, see :func:`_load`

NAME: Final = {"win32": "hfx_native.dll", "darwin": "hfx_native.dylib"}.get(
    sys.platform, "hfx_native.so"
)

_NUMBERS: Final[dict[str, Any]] = {"int64_t": ctypes.c_int64, "double": ctypes.c_double}
_RESULTS: Final = {**_NUMBERS, "void": None, "const char *": ctypes.c_char_p}
_ARRAYS: Final[dict[str, tuple[Any, ...]]] = {
    **dict.fromkeys(("int64_t", "uint64_t"), (np.int64, np.uint64)),
    **dict.fromkeys(("int32_t", "uint32_t"), (np.int32, np.uint32)),
    **dict.fromkeys(("double", "hfx_quad", "extent", "event"), (np.float64,)),
    **{"float": (np.float32,), "uint8_t": (np.uint8, np.bool_), "void": ()},
}

_structures: dict[str, list[tuple[str, str, int]]] = {}
"""Fields of each structure: name, C type, element count; filled by :func:`declare`."""


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
    """Search for a library and load the first usable file, ignoring any loaded before. Returns the
    library or None, and the text of :func:`state`."""
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
    The module is named after the digest of the sources; no code of the module is imported."""
    folders = [Path(__file__).parent]
    try:
        spec = importlib.util.find_spec(f"{sources.MARK}_{sources.digest()}")
        folders += map(Path, (spec and spec.submodule_search_locations) or ())
    except (ImportError, ValueError, AttributeError):
        pass  # another module has that name
    return (path for path in (folder / NAME for folder in folders) if path.is_file())


def _load(path: Path) -> ctypes.CDLL:
    """Load a library file and declare the functions. Raises OSError for a file of another platform,
    unreadable or damaged, AttributeError for another library, and ValueError for a library of other
    sources."""
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


class ArrayOf:
    """Type of an argument or field that is an array or None.

    A read-only array is made contiguous and converted within the kind of number; an array for
    writing must have the right type and be contiguous. A call keeps arguments until the end
    and a :class:`Structure` keeps fields, so no memory is freed while C reads it. ``types`` are the
    accepted element types, the first for conversions; empty accepts any type. ``is_written``: C
    writes to the array.
    """

    def __init__(self, types: tuple[npt.DTypeLike, ...], is_written: bool) -> None:
        self._types = tuple(np.dtype(kind) for kind in types)
        self._first = self._types[0] if types else None
        self._is_written = is_written

    def from_param(self, array: Any) -> Any:
        """Convert an array to a ctypes argument, None to None; TypeError as of :meth:`address`."""
        if array is None:
            return None
        if array.dtype is not self._first:
            array = self._of_type(array)
        try:  # four times as fast as ``array.ctypes``
            return _by_reference(_start(array))
        except (TypeError, ValueError):
            fitting = self._contiguous(array)
        # The buffer protocol refuses read-only and empty arrays.
        if fitting is array:
            return ctypes.c_void_p(array.ctypes.data)
        return _by_reference(_start(fitting))

    def address(self, array: Any, kept: list[Any]) -> int:
        """Memory address of an array, 0 of None; a converted copy is appended to ``kept``. An
        address stays. Raises TypeError for another kind of number, and, for writing, for another
        type or an array that is not contiguous."""
        if array.__class__ is not np.ndarray:
            return array or 0
        if array.dtype is self._first or not self._types or array.dtype in self._types:
            try:
                return _address(_start(array))
            except (TypeError, ValueError):
                pass  # see from_param
        fitting = self._contiguous(self._of_type(array))
        kept.append(fitting)
        return fitting.ctypes.data

    def _of_type(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the array if its type is accepted, else a converted copy. Raises TypeError: the
        library writes to the array, so that a copy would lose the result."""
        if not self._types or array.dtype in self._types:
            return array
        if self._is_written:
            raise TypeError(f"expected an array of {self._first}, got one of {array.dtype}")
        return array.astype(self._types[0], casting="same_kind")

    def _contiguous(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the array if its memory is contiguous, else a contiguous copy. Raises TypeError:
        the library writes to the array, so that a copy would lose the result."""
        if self._is_written and not array.flags.c_contiguous:
            raise TypeError("expected a contiguous array")
        return np.ascontiguousarray(array)


_by_reference: Final = ctypes.byref
_address: Final = ctypes.addressof
_start: Final[Callable[[Any], ctypes.c_char]] = ctypes.c_char.from_buffer


class Structure(ctypes.Structure):
    """Structure of the library, from the values of its leading fields; missing fields are 0. A
    value is a number, an array, a structure or None; a field of several addresses has as many
    values. ``kept`` holds all values, and so keeps their memory alive."""

    _addresses: list[Callable[[Any, list[Any]], int] | None]  # of each value; None: a number
    _layout: struct.Struct

    def __init__(self, *values: Any) -> None:
        self.kept = kept = [*values]
        pairs = zip_longest(self._addresses, values)
        # Written at once: ctypes would convert field by field, at twice the time.
        self._layout.pack_into(self, 0, *[at(x, kept) if at else x or 0 for at, x in pairs])


def _address_of(kind: Any, value: Any, _kept: list[Any]) -> int:
    """Memory address of a structure or an array of structures; 0 for None. Raises TypeError for
    another kind of structure."""
    kind.from_param(value)
    return 0 if value is None else _address(value)


@cache
def structure(name: str) -> Any:
    """Subclass of :class:`Structure` for a C structure; a library must be loaded."""
    # Arrays are stored as bare addresses; ``kept`` keeps their memory alive.
    fields, addresses, layout = [], [], ""
    for field, declared, count in _structures[name]:
        kind = _kind(declared)
        stored = ctypes.c_void_p if isinstance(kind, ArrayOf) else kind
        fields.append((field, stored * count if count else stored))
        address = None if declared in _NUMBERS else partial(_address_of, kind)
        addresses += [getattr(kind, "address", address)] * (count or 1)
        layout += ("d" if declared == "double" else "q" if address is None else "P") * (count or 1)
    parts = {"_fields_": fields, "_addresses": addresses, "_layout": struct.Struct(layout)}
    return type(name, (Structure,), parts)


def declare(library: ctypes.CDLL) -> None:
    """Set argument and result types of all functions of the library. Raises AttributeError for a
    missing function, and ValueError for an interface that is no JSON."""
    library.hfx_interface.restype = ctypes.c_char_p
    # Types are those that the C compiler saw: no declaration is repeated in Python.
    interface = json.loads(library.hfx_interface())
    _structures.update(interface["structures"])
    for name, (result, arguments) in interface["functions"].items():
        function = getattr(library, name)
        function.restype = _RESULTS[result]
        function.argtypes = [_kind(declared) for _, declared, _ in arguments]


def _kind(declared: str) -> Any:
    """ctypes type, structure pointer or :class:`ArrayOf` of a C declaration; const: read-only. ``T
    **`` is an array of addresses."""
    name, stars = declared.removeprefix("const ").rstrip(" *"), declared.count("*")
    if not stars:
        return _NUMBERS[name]
    if stars == 1 and name not in _ARRAYS:
        return ctypes.POINTER(structure(name))
    of_numbers = _ARRAYS[name if stars == 1 else "int64_t"]
    return ArrayOf(of_numbers, is_written=not declared.startswith("const "))
