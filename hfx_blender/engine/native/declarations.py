# SPDX-License-Identifier: GPL-3.0-or-later
"""Signatures and structures of the library, as ctypes types.

The build reads the C sources (``release/native_interface.py``); the library returns the result
as JSON. ``int64_t`` and ``double`` become numbers, ``const double *`` a float64 array for
reading, ``double *`` a float64 array for writing, ``const hfx_tree *`` a structure. Each array and
structure may be None.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

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

    def address(self, array: npt.NDArray[Any], kept: list[Any]) -> int:
        """Memory address of an array; a converted copy is appended to ``kept``.

        Raises TypeError for another kind of number, and, for writing, for another type or an array
        that is not contiguous.
        """
        if array.dtype is self._first:
            try:
                return _address(_start(array))
            except (TypeError, ValueError):
                pass  # see from_param
        fitting = self._contiguous(self._of_type(array))
        kept.append(fitting)
        return fitting.ctypes.data

    def _of_type(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the array if its type is accepted, else a converted copy.

        Raises TypeError: the library writes to the array, so that a copy would lose the result.
        """
        if not self._types or array.dtype in self._types:
            return array
        if self._is_written:
            raise TypeError(f"expected an array of {self._first}, got one of {array.dtype}")
        return array.astype(self._types[0], casting="same_kind")

    def _contiguous(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the array if its memory is contiguous, else a contiguous copy.

        Raises TypeError: the library writes to the array, so that a copy would lose the result.
        """
        if self._is_written and not array.flags.c_contiguous:
            raise TypeError("expected a contiguous array")
        return np.ascontiguousarray(array)


_by_reference: Final = ctypes.byref
_address: Final = ctypes.addressof
_start: Final[Callable[[Any], ctypes.c_char]] = ctypes.c_char.from_buffer


class Structure(ctypes.Structure):
    """Structure of the library, from the values of its leading fields; missing fields are 0.

    A value is a number, an array, a list of arrays, a structure or None. ``kept`` holds all values,
    and so keeps their memory alive.
    """

    _kinds: dict[str, Any]

    def __init__(self, *fields: Any) -> None:
        self.kept: list[Any] = [*fields]
        pairs = zip(self._kinds.values(), fields, strict=False)
        super().__init__(*[_stored(kind, value, self.kept) for kind, value in pairs])

    def put(self, name: str, value: Any) -> None:
        """Set the field ``name``; see :class:`Structure` for values."""
        self.kept.append(value)
        setattr(self, name, _stored(self._kinds[name], value, self.kept))


def _stored(kind: Any, value: Any, kept: list[Any]) -> Any:
    """Convert a field's value to C: an array to its address, a list item by item to a C array of
    addresses, a structure to a pointer; numbers and None stay. Converted copies of arrays are
    appended to ``kept``.
    """
    if value.__class__ is np.ndarray:
        return kind.address(value, kept)
    if value.__class__ is list:
        return (ctypes.c_void_p * len(value))(*[_stored(kind, item, kept) for item in value])
    return ctypes.pointer(value) if isinstance(value, Structure) else value


@cache
def structure(name: str) -> Any:
    """Subclass of :class:`Structure` for a C structure; a library must be loaded."""
    fields, kinds = [], {}
    for field, declared, count in _structures[name]:
        kinds[field] = kind = _kind(declared)
        stored = ctypes.c_void_p if isinstance(kind, ArrayOf) else kind
        fields.append((field, stored * count if count else stored))
    return type(name, (Structure,), {"_fields_": fields, "_kinds": kinds})


def declare(library: ctypes.CDLL) -> None:
    """Set argument and result types of all functions of the library.

    Raises AttributeError for a missing function, and ValueError for an interface that is no JSON.
    """
    library.hfx_interface.restype = ctypes.c_char_p
    interface = json.loads(library.hfx_interface())
    _structures.update(interface["structures"])
    for name, (result, arguments) in interface["functions"].items():
        function = getattr(library, name)
        function.restype = _RESULTS[result]
        function.argtypes = [_kind(declared) for _, declared, _ in arguments]


def _kind(declared: str) -> Any:
    """ctypes type, structure pointer or :class:`ArrayOf` of a C declaration; const: read-only.

    ``T **`` is an array of addresses.
    """
    name, stars = declared.removeprefix("const ").rstrip(" *"), declared.count("*")
    if not stars:
        return _NUMBERS[name]
    if stars == 1 and name not in _ARRAYS:
        return ctypes.POINTER(structure(name))
    of_numbers = _ARRAYS[name if stars == 1 else "int64_t"]
    return ArrayOf(of_numbers, is_written=not declared.startswith("const "))
