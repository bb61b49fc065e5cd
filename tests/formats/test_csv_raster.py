# SPDX-License-Identifier: GPL-3.0-or-later
"""CSV rasters, read back with the csv module and with numpy."""

import csv
from fractions import Fraction

import numpy as np
import pytest

from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.errors import OutputError
from hfx_blender.formats.rasters import csv_raster


def make_raster(values, rate_hz=Fraction(100), start_s=0.0):
    values = np.asarray(values, np.float64)
    columns = [("a", "amplitude_m_s2", "m/s^2"), ("a", "frequency_hz", "Hz")]
    columns += [("t", "temperature_c", "degC")]
    return Raster(
        device_id="device",
        body_id="body",
        actuators=("a", "t"),
        columns=tuple(Column(*column) for column in columns),
        times_s=start_s + np.arange(len(values)) / float(rate_hz),
        rate_hz=rate_hz,
        values=values,
        neutral=np.array([0.0, 100.0, 24.0]),
        shortfalls=(),
        felt=(),
    )


def test_exact_bytes(tmp_path):
    path = tmp_path / "device.csv"
    csv_raster.write(make_raster([[0, 100, 24], [1 / 3, 80.5, -0.0], [2e-7, 1, 30]]), path)
    assert path.read_bytes() == (
        b"time_s,a.amplitude_m_s2 [m/s^2],a.frequency_hz [Hz],t.temperature_c [degC]\r\n"
        b"0,0,100,24\r\n"
        b"0.01,0.333333333,80.5,0\r\n"
        b"0.02,2e-07,1,30\r\n"
    )
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("rows", [1, 4096, 10_000])
def test_read_back_by_numpy_and_csv(tmp_path, rows):
    values = np.random.default_rng(3).uniform(0, 300, (rows, 3))
    raster = make_raster(values, Fraction(1000), start_s=2.5)
    path = tmp_path / "device.csv"
    csv_raster.write(raster, path)
    table = np.genfromtxt(path, delimiter=",", skip_header=1, ndmin=2)
    np.testing.assert_allclose(table[:, 1:], values, rtol=5e-9)  # half of the ninth digit
    np.testing.assert_allclose(table[:, 0], raster.times_s, rtol=0, atol=1e-9)
    with open(path, newline="", encoding="utf-8") as file:
        read = list(csv.reader(file))
    assert len(read) == rows + 1 and {len(row) for row in read} == {4}
    assert read[1][0] == "2.5" and (rows == 1 or read[2][0] == "2.501")


def test_the_same_raster_gives_the_same_bytes(tmp_path):
    raster = make_raster(np.random.default_rng(3).uniform(0, 300, (50, 3)))
    csv_raster.write(raster, tmp_path / "a.csv")
    csv_raster.write(raster, tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_an_unwritable_place(tmp_path):
    with pytest.raises(OutputError):
        csv_raster.write(make_raster([[0, 1, 2]]), tmp_path / "no" / "device.csv")
