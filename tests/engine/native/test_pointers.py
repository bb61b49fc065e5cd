# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of the compiled library are of the declared types, and live as long as they are read.

Memory that is freed too early is reused only by chance, and hardly ever in one thread.
"""

from __future__ import annotations

import ctypes
import gc
import re
import weakref
from pathlib import Path

import numpy as np
import pytest

import hfx_blender.engine.native
from hfx_blender.engine.native.library import ANY, BYTES, DOUBLES, INTEGER, LONGS, structure

ENGINE = Path(hfx_blender.engine.native.__file__).parents[1]
FILES = sorted((*ENGINE.glob("native/*.py"), *ENGINE.glob("contact/compiled_*.py")))

_Pair = structure("pair", ones=DOUBLES, count=INTEGER, others=LONGS)


def _address(argument: object) -> int | None:
    return ctypes.cast(argument, ctypes.c_void_p).value


def _read(address: int, count: int) -> list[float]:
    return list((ctypes.c_double * count).from_address(address))


def test_an_argument_is_where_the_array_is() -> None:
    array = np.arange(4.0)
    for each in (array, array[1:], array[:0]):
        assert _address(DOUBLES.from_param(each)) == each.ctypes.data
    array.flags.writeable = False
    assert _read(_address(DOUBLES.from_param(array)), 4) == [0.0, 1.0, 2.0, 3.0]
    assert DOUBLES.from_param(None) is None


@pytest.mark.parametrize(
    ("kind", "array", "message"),
    [
        (DOUBLES, np.zeros(3, np.float32), "expected an array of float64, got one of float32"),
        (LONGS, np.zeros(3, np.int32), "expected an array of int64, got one of int32"),
        (BYTES, np.zeros(3), "expected an array of uint8, got one of float64"),
        (DOUBLES, np.zeros((3, 3))[:, 1], "expected a contiguous array"),
        (ANY, np.zeros((3, 3)).T[1:], "expected a contiguous array"),
    ],
)
def test_other_arrays_are_refused(kind: object, array: np.ndarray, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        kind.from_param(array)
    if kind is DOUBLES:
        with pytest.raises(TypeError, match=message):
            _Pair(array, 3, np.zeros(3, np.int64))


def test_a_structure_keeps_what_it_was_made_of() -> None:
    array = np.arange(3.0)
    alive = weakref.ref(array)
    made = _Pair(array, 3, None)
    del array
    gc.collect()
    assert alive() is not None and made.others is None
    assert _read(made.ones, made.count) == [0.0, 1.0, 2.0]
    del made
    gc.collect()
    assert alive() is None
    assert _Pair().ones is None, "what is not given is nothing"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_array_of_a_call_is_declared(path: Path) -> None:
    """``argtypes`` name arrays by their types: a plain pointer is a structure."""
    text = path.read_text(encoding="utf-8")
    assert len(re.findall(r"\bPOINTER\] \* ", text)) <= (path.stem == "compiled_narrow_phase")
