# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments of the library's functions and fields of its structures, as the library tells them.

They were read from its C sources when it was built (``release/native_interface.py``): in
``hfx_turns(int64_t count, const double *before, ...)`` a number is a number, ``const double *``
an array of float64 that is only read, ``double *`` one that is written, ``const hfx_tree *`` a
structure. Each array and structure may be None.
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
    **dict.fromkeys(("double", "hfx_quad", "extent", "event"), (np.float64,)),  # all of doubles
    **{"float": (np.float32,), "uint8_t": (np.uint8, np.bool_), "void": ()},
}

_structures: dict[str, list[tuple[str, str, int]]] = {}
"""Name, type and count of elements of each field of a structure; filled by :func:`declare`."""


class ArrayOf:
    """Argument or field: a contiguous array of one of some types, or None.

    An array that is only read is converted, within its kind of number. A call has its arguments
    until it is over, and a structure what it is made of: so no array is gone before it was read.
    """

    def __init__(self, types: tuple[npt.DTypeLike, ...], is_written: bool) -> None:
        self._types = tuple(np.dtype(each) for each in types)
        self._first = self._types[0] if types else None
        self._is_written = is_written

    def from_param(self, array: Any) -> Any:
        """Array as an argument, as ctypes asks for it; see :meth:`address`."""
        if array is None:
            return None
        if array.dtype is not self._first:
            array = self._of_type(array)
        try:  # four times as fast as asking the array
            return _by_reference(_start(array))
        except (TypeError, ValueError):
            fitting = self._contiguous(array)
        # As it is: what must not be written, and what is empty.
        if fitting is array:
            return ctypes.c_void_p(array.ctypes.data)
        return _by_reference(_start(fitting))

    def address(self, array: npt.NDArray[Any], kept: list[Any]) -> int:
        """Address of an array; what it is converted to is added to what is kept.

        Raises
        ------
        TypeError
            It holds another kind of number, or is to be written and of another type or not
            contiguous.
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
        if not self._types or array.dtype in self._types:
            return array
        if self._is_written:
            raise TypeError(f"expected an array of {self._first}, got one of {array.dtype}")
        return array.astype(self._types[0], casting="same_kind")

    def _contiguous(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        if self._is_written and not array.flags.c_contiguous:
            raise TypeError("expected a contiguous array")
        return np.ascontiguousarray(array)


_by_reference: Final = ctypes.byref
_address: Final = ctypes.addressof
_start: Final[Callable[[Any], ctypes.c_char]] = ctypes.c_char.from_buffer


class Structure(ctypes.Structure):
    """Structure of the library, made of its fields in their order; those that are missing are 0.

    A field is a number, an array, a list of arrays, a structure or None. ``kept`` has all of them.
    """

    _kinds: dict[str, Any]

    def __init__(self, *fields: Any) -> None:
        self.kept: list[Any] = [*fields]
        pairs = zip(self._kinds.values(), fields, strict=False)
        super().__init__(*[_stored(kind, value, self.kept) for kind, value in pairs])

    def put(self, name: str, value: Any) -> None:
        """Set a field."""
        self.kept.append(value)
        setattr(self, name, _stored(self._kinds[name], value, self.kept))


def _stored(kind: Any, value: Any, kept: list[Any]) -> Any:
    """A field as C has it."""
    if value.__class__ is np.ndarray:
        return kind.address(value, kept)
    if value.__class__ is list:
        return (ctypes.c_void_p * len(value))(*[_stored(kind, each, kept) for each in value])
    return ctypes.pointer(value) if isinstance(value, Structure) else value


@cache
def structure(name: str) -> Any:
    """Class of a structure, a :class:`Structure`; the library has to be loaded."""
    fields, kinds = [], {}
    for field, declared, count in _structures[name]:
        kinds[field] = kind = _kind(declared)
        stored = ctypes.c_void_p if isinstance(kind, ArrayOf) else kind
        fields.append((field, stored * count if count else stored))
    return type(name, (Structure,), {"_fields_": fields, "_kinds": kinds})


def declare(library: ctypes.CDLL) -> None:
    """Declare arguments and results of the library's functions.

    Raises
    ------
    AttributeError
        It lacks one of them.
    ValueError
        It does not tell them.
    """
    library.hfx_interface.restype = ctypes.c_char_p
    interface = json.loads(library.hfx_interface())
    _structures.update(interface["structures"])
    for name, (result, arguments) in interface["functions"].items():
        function = getattr(library, name)
        function.restype = _RESULTS[result]
        function.argtypes = [_kind(declared) for _, declared, _ in arguments]


def _kind(declared: str) -> Any:
    """Kind of an argument or a field, of its type in C."""
    name, stars = declared.removeprefix("const ").rstrip(" *"), declared.count("*")
    if not stars:
        return _NUMBERS[name]
    if stars == 1 and name not in _ARRAYS:
        return ctypes.POINTER(structure(name))
    of_numbers = _ARRAYS[name if stars == 1 else "int64_t"]
    return ArrayOf(of_numbers, is_written=not declared.startswith("const "))
