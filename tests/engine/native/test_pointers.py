# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of the compiled library have the declared types, and outlive their use.

Memory freed too early is reused only by chance, and hardly ever in a single thread.
"""

from __future__ import annotations

import ctypes
import gc
import weakref
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mesh_twins import needs_library

from hfx_blender.engine.contact.compiled_target import PlacedTarget
from hfx_blender.engine.native import library as loading
from hfx_blender.engine.native.library import ArrayOf, structure
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.shape import Falloff
from release.native_interface import interface

READ = ArrayOf((np.float64,), is_written=False)
DOUBLES = ArrayOf((np.float64,), is_written=True)
LONGS = ArrayOf((np.int64, np.uint64), is_written=True)
BYTES = ArrayOf((np.uint8, np.bool_), is_written=True)
ANY = ArrayOf((), is_written=True)


def _address(argument: object) -> int | None:
    return ctypes.cast(argument, ctypes.c_void_p).value


def _read(address: int, count: int) -> list[float]:
    return list((ctypes.c_double * count).from_address(address))


def test_an_argument_is_where_the_array_is() -> None:
    array = np.arange(4.0)
    for part in (array, array[1:], array[:0]):
        assert _address(DOUBLES.from_param(part)) == part.ctypes.data
    array.flags.writeable = False
    assert _read(_address(DOUBLES.from_param(array)), 4) == [0.0, 1.0, 2.0, 3.0]
    assert DOUBLES.from_param(None) is None


@pytest.mark.parametrize(
    "array",
    [np.arange(8.0)[::2], np.float32([0, 2, 4, 6]), np.array([0, 2, 4, 6]), np.zeros((4, 0)).T],
)
def test_input_arrays_are_converted_and_kept_alive(array) -> None:
    array.flags.writeable = False
    argument = READ.from_param(array)
    gc.collect()
    others = [np.full(4, np.nan) for _ in range(8)]  # where freed memory would be taken again
    assert not array.size or _read(_address(argument), 4) == [0.0, 2.0, 4.0, 6.0]
    assert np.isnan(others).all()


@pytest.mark.parametrize(
    ("kind", "array", "message"),
    [
        (READ, np.zeros(3, np.complex128), "Cannot cast array data from dtype"),
        (DOUBLES, np.zeros(3, np.float32), "expected an array of float64, got one of float32"),
        (LONGS, np.zeros(3, np.int32), "expected an array of int64, got one of int32"),
        (BYTES, np.zeros(3), "expected an array of uint8, got one of float64"),
        (DOUBLES, np.zeros((3, 3))[:, 1], "expected a contiguous array"),
        (ANY, np.zeros((3, 3)).T[1:], "expected a contiguous array"),
    ],
)
def test_other_arrays_are_refused(kind: ArrayOf, array: np.ndarray, message: str) -> None:
    for ask in (kind.from_param, lambda each: kind.address(each, [])):
        with pytest.raises(TypeError, match=message):
            ask(array)


@needs_library
def test_a_structure_keeps_its_arrays_alive() -> None:
    array = np.arange(6, dtype=np.int32)[::2]  # is converted
    boxes = np.arange(3.0)
    tree = structure("hfx_tree")(boxes, None, array, None, 3)
    alive = weakref.ref(boxes)
    mesh = structure("hfx_mesh")(None, tree, None, 0.5)
    assert tree.order is None and not mesh.grid
    del tree, boxes, array
    gc.collect()
    assert _read(mesh.tree.contents.boxes, 3) == [0.0, 1.0, 2.0]
    assert _read(mesh.tree.contents.corners, 3) == [0.0, 2.0, 4.0]
    assert (mesh.tree.contents.size, mesh.slack, mesh.depth) == (3, 0.5, 0.0)
    del mesh
    gc.collect()
    assert alive() is None
    with pytest.raises(TypeError, match="expected an array of int64, got one of float64"):
        structure("hfx_pairs")(1, np.zeros(1))
    drift = structure("hfx_drift")(None, np.ones(2), *12 * [None], 4)
    assert drift.before[0] is None and _read(drift.before[1], 2) == [1.0, 1.0]
    assert list(drift.after) == 7 * [None] and drift.intervals == 4


@needs_library
def test_a_placed_volume_lives_as_long_as_its_structure() -> None:
    """Threads use the structure after all other references are gone."""
    still, rows = np.eye(4)[None], np.arange(1)
    target = PlacedTarget((Sphere(),), None, still, still, rows, Falloff(), 0.0, 1e6)
    pointers, room = target.pointers, weakref.ref(target.room)
    del target
    gc.collect()
    assert room() is not None and _read(pointers.to_shape, 16) == np.eye(4).ravel().tolist()


def test_declarations_are_read_as_they_stand_in_c(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    text = """
    #define KINDS 2
    typedef struct {
      const double *boxes, *far;  // of each "box"
      int64_t count;
      uint8_t *marks[KINDS];
    } hfx_thing;
    HFX_EXPORT double hfx_ask(const hfx_thing *thing, const int32_t *ids,
                              float *found, const hfx_thing **others) {
    HFX_EXPORT const char *hfx_interface(void) {
    """
    source = tmp_path / "x.c"
    source.write_text(text)
    monkeypatch.setattr(loading, "structure", cache(loading.structure.__wrapped__))
    content = interface([source]).encode()
    library = SimpleNamespace(hfx_ask=SimpleNamespace(), hfx_interface=FunctionStub(content))
    loading.declare(library)
    thing = loading.structure("hfx_thing")
    assert library.hfx_ask.restype is ctypes.c_double
    assert library.hfx_interface.argtypes == []
    first, ids, actual, others = library.hfx_ask.argtypes
    assert first is ctypes.POINTER(thing)
    assert [name for name, _ in thing._fields_] == ["boxes", "far", "count", "marks"]
    assert ctypes.sizeof(thing) == 5 * 8
    floats, halves = np.zeros(2, np.float32), np.zeros(2, np.float16)
    for kind, is_written in ((ids, False), (actual, True), (others, False)):
        if is_written:  # an output of C must not be a copy
            with pytest.raises(TypeError):
                kind.from_param(halves)
    assert _address(actual.from_param(floats)) == floats.ctypes.data
    numbers = np.arange(2, dtype=np.int16)
    assert list((ctypes.c_int32 * 2).from_address(_address(ids.from_param(numbers)))) == [0, 1]
    assert list((ctypes.c_int64 * 2).from_address(_address(others.from_param(numbers)))) == [0, 1]
    created = thing(np.zeros(1), np.zeros(1), 7, np.zeros(1, np.uint8), np.zeros(1, np.uint8))
    assert created.count == 7
    with pytest.raises(TypeError):
        thing(None, None, 0, np.zeros(1), np.zeros(1))


def test_a_declaration_that_python_cannot_have_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "x.c"
    source.write_text("HFX_EXPORT long hfx_ask(int64_t) {")
    with pytest.raises(ValueError, match="'int64_t' cannot be declared"):
        interface([source])
    source.write_text("HFX_EXPORT long hfx_ask(int64_t n) {")
    content = interface([source]).encode()
    with pytest.raises(KeyError, match="long"):
        loading.declare(
            SimpleNamespace(hfx_ask=SimpleNamespace(), hfx_interface=FunctionStub(content))
        )


class FunctionStub:
    """Stand-in for a library function without arguments."""

    def __init__(self, told: bytes) -> None:
        self._told = told

    def __call__(self) -> bytes:
        return self._told
