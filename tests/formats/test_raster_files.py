# SPDX-License-Identifier: GPL-3.0-or-later
"""Rasters as NPZ (exact) and as CSV: round trips, and refusal of damaged files."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from format_cases import raster_for
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.raster import Column, FeltStream, Raster, Shortfall
from hfx_blender.engine.samples import Stream
from hfx_blender.errors import InputError
from hfx_blender.formats.rasters import csv_raster, npz_raster
from hfx_tools.formats import csv_reader, npz_reader

EXTREME = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(max_size=12)


def made(values, names, felt):
    columns = tuple(Column(name, "own", "kPa") for name in names)
    return Raster(
        device_id="vest Zoë",
        body_id="手",
        actuators=tuple(names),
        columns=columns,
        times_s=np.arange(len(values)) / 24.0,
        rate_hz=Fraction(24_000, 1001),
        values=values,
        neutral=np.zeros(len(names)),
        shortfalls=(Shortfall("e", "b", "wind", "modality", 3, 0.1, 0.3),),
        felt=felt,
    )


def same(one, second):
    for name, value in vars(one).items():
        actual = getattr(second, name)
        if isinstance(value, np.ndarray):
            assert value.dtype == actual.dtype and value.tobytes() == actual.tobytes(), name
        elif name != "felt":
            assert value == actual, name
    assert [stream.stream for stream in one.felt] == [stream.stream for stream in second.felt]
    for a, b in zip(one.felt, second.felt, strict=True):
        assert all(
            (getattr(a, n) == getattr(b, n)).all() for n in ("indices", "strengths", "is_rendered")
        )


@given(st.data())
@settings(max_examples=30, deadline=None)
def test_an_npz_keeps_every_bit(tmp_path_factory, data):
    names = data.draw(st.lists(NAMES, max_size=4, unique=True))
    rows = data.draw(st.integers(1, 4))
    values = data.draw(hnp.arrays(np.float64, (rows, len(names)), elements=EXTREME))
    felt_stream = FeltStream(
        Stream("e", "b", "wind", "m"), np.arange(rows), np.ones(rows), np.ones(rows, bool)
    )
    raster = made(values, names, (felt_stream,) * data.draw(st.integers(0, 2)))
    path = tmp_path_factory.mktemp("npz") / "x.raster.npz"
    npz_raster.write(raster, path)
    same(raster, npz_reader.read(path))


@pytest.mark.parametrize("shape", [(100_000, 3), (10, 2000)])
def test_large_rasters(tmp_path, shape):
    values = np.random.default_rng(1).uniform(0, 40, shape)
    raster = made(values, [f"a{k}" for k in range(shape[1])], ())
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    same(raster, npz_reader.read(tmp_path / "x.raster.npz"))
    npz_raster.write(raster, tmp_path / "y.raster.npz")
    assert (tmp_path / "x.raster.npz").read_bytes() == (tmp_path / "y.raster.npz").read_bytes()


def test_numpy_reads_raster_files(tmp_path):
    raster = raster_for(load_device("back_pad"))
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    with np.load(tmp_path / "x.raster.npz", allow_pickle=False) as actual:
        np.testing.assert_array_equal(actual["values"], raster.values)


def test_a_csv_is_read_back_to_nine_digits(tmp_path):
    raster = raster_for(load_device("back_pad"))
    csv_raster.write(raster, tmp_path / "x.csv")
    actual = csv_reader.read(tmp_path / "x.csv")
    np.testing.assert_allclose(actual.values, raster.values, rtol=5e-9)
    assert actual.columns == raster.columns and actual.actuators == raster.actuators
    assert actual.rate_hz == raster.rate_hz


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"time_s\r\n",
        b"t,a.x [m]\r\n0,1\r\n",
        b"time_s,a.x [m]\r\n0,1,2\r\n",
        b"time_s,a.x [m]\r\n0,nan\r\n",
        b"time_s,a.x [m]\r\n0,1e999\r\n",
        b"time_s,a.x [m]\r\n1,1\r\n0,1\r\n",
        b"time_s,a.x [m]\r\n0,1\r\n1,1\r\n5,1\r\n",
        b"time_s,a.x [m]\r\n0,1\r\n5e-324,1\r\n",
        b"time_s,a.x [m]\r\n-1.7e308,1\r\n1.7e308,1\r\n",
        b"time_s,a.x [m]\r\n0,one\r\n",
        b"time_s,\xff.x [m]\r\n0,1\r\n",
    ],
)
def test_an_invalid_table_is_refused(content):
    with pytest.raises(InputError, match=r"^x: "):
        csv_reader.decode(content, "x")


def archive(**arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def test_damaged_archives_are_refused(tmp_path):
    raster = raster_for(load_device("back_pad"), rows=5)
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    data = (tmp_path / "x.raster.npz").read_bytes()
    with np.load(io.BytesIO(data)) as actual:
        arrays = dict(actual)
    for name in arrays:
        with pytest.raises(InputError):
            npz_reader.decode(archive(**{k: v for k, v in arrays.items() if k != name}), "x")
    broken = {
        "values": arrays["values"][:, 1:],
        "times_s": arrays["times_s"].astype(np.float32),
        "neutral": np.full_like(arrays["neutral"], np.nan),
        "meta": arrays["meta"][:-1],
    }
    for name, value in broken.items():
        with pytest.raises(InputError):
            npz_reader.decode(archive(**{**arrays, name: value}), "x")
    for cut in (0, 10, len(data) // 2, len(data) - 1):
        with pytest.raises(InputError):
            npz_reader.decode(data[:cut], "x")
    with pytest.raises(InputError):
        npz_reader.decode(archive(**arrays, pickled=np.array([{}], object)), "x")


def test_an_array_whose_header_ends_in_the_middle_is_refused():
    header = b"{'descr': '<f8', 'shape': (3,).  \n"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(24)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as one:
        one.writestr("values.npy", content)
    with pytest.raises(InputError, match="damaged"):
        npz_reader.decode(file.getvalue(), "x")


def test_an_archive_that_would_fill_the_memory_is_refused():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as one:
        one.writestr("values.npy", b"\0" * (64 << 20))
    small = bytearray(file.getvalue())
    at = small.rfind(b"PK\x01\x02")
    small[at + 24 : at + 28] = (2**32 - 2).to_bytes(4, "little")  # the claimed size
    with pytest.raises(InputError, match="would take"):
        npz_reader.decode(bytes(small), "x")


def test_an_npz_in_fortran_order_is_read_and_one_without_columns_is_warned_of(tmp_path):
    raster = made(np.arange(6.0).reshape(3, 2), ["a", "b"], ())
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    with np.load(tmp_path / "x.raster.npz") as arrays:
        turned = {name: np.asfortranarray(array) for name, array in arrays.items()}
    file = io.BytesIO()
    np.savez_compressed(file, **turned)
    same(npz_reader.decode(file.getvalue(), "x"), raster)
    npz_raster.write(made(np.zeros((3, 0)), [], ()), tmp_path / "y.raster.npz")
    (finding,) = npz_reader.validate((tmp_path / "y.raster.npz").read_bytes(), "y")
    assert (finding.code, finding.severity) == ("NPZ-COLUMNS", "warning")


@pytest.mark.filterwarnings("error")
def test_times_at_the_ends_of_all_numbers_are_refused_without_a_warning():
    text = b"time_s,a.pressure_kpa [kPa]\n-1.7e308,1\n0,1\n1.7e308,1\n"
    with pytest.raises(InputError, match="evenly"):
        csv_reader.decode(text, "x")


@pytest.mark.parametrize("indices", [[0, 3], [1, 0], [1, 1], [-1, 0]])
def test_felt_samples_are_ascending_rows(tmp_path, indices):
    stream = FeltStream(
        Stream("e", "b", "wind", "m"), np.array(indices), np.ones(2), np.ones(2, bool)
    )
    npz_raster.write(made(np.zeros((3, 1)), ["a"], (stream,)), tmp_path / "x.raster.npz")
    with pytest.raises(InputError, match=r"'felt.0.indices' is .*, allowed are .* 0 to 2"):
        npz_reader.read(tmp_path / "x.raster.npz")
    stream = replace(stream, indices=np.array([0, 2]))
    npz_raster.write(made(np.zeros((3, 1)), ["a"], (stream,)), tmp_path / "x.raster.npz")
    assert len(npz_reader.read(tmp_path / "x.raster.npz").felt) == 1


def test_an_archive_without_an_actuator_of_a_column_is_refused(tmp_path):
    raster = replace(made(np.zeros((3, 1)), ["a"], ()), actuators=("b",))
    npz_raster.write(raster, tmp_path / "x.raster.npz")
    with pytest.raises(
        InputError, match=r"'a.own \[kPa\]' is of an actuator that 'actuators' lacks"
    ):
        npz_reader.read(tmp_path / "x.raster.npz")
