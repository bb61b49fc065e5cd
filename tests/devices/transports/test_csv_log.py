# SPDX-License-Identifier: GPL-3.0-or-later
"""CSV log as a substitute for hardware."""

import csv

import numpy as np
import pytest
from bench_devices import device, heat, vibration

from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import log_outputs


def test_a_log_has_a_row_for_each_thing_that_was_sent(tmp_path):
    path = tmp_path / "log.csv"
    output = open_output(device(vibration(), heat()), {"kind": "csv", "path": str(path)})
    output.send(np.array([2.5, 80.0, 99.0]))
    output.stop()
    output.close()
    output.stop()
    header, row, stop = csv.reader(path.open())
    assert header == ["time_s", "event", "a0.amplitude_m_s2", "a0.frequency_hz", "a1.temperature_c"]
    assert row[1:] == ["values", "2.5", "80", "40"]
    assert stop[1:] == ["stop", "0", "100", "29"]
    assert 0.0 <= float(row[0]) <= float(stop[0])


@pytest.mark.parametrize("path", [None, "", "a\0b", "missing/folder/x.csv"])
def test_a_log_needs_a_path_that_can_be_written(path):
    with pytest.raises(OutputLostError):
        open_output(device(heat()), {"kind": "csv", "path": path})


def test_a_log_overwrites_nothing_and_ends_before_the_disk_is_full(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("mine")
    with pytest.raises(OutputLostError, match="exists already"):
        open_output(device(heat()), {"kind": "csv", "path": path})
    assert path.read_text() == "mine"
    monkeypatch.setattr(log_outputs, "CSV_BYTES", 200)
    output = open_output(device(heat()), {"kind": "csv", "path": tmp_path / "other.csv"})
    with pytest.raises(OutputLostError, match="full"):
        for _ in range(100):
            output.send(np.array([29.0]))
    assert (tmp_path / "other.csv").stat().st_size <= 200
