# SPDX-License-Identifier: GPL-3.0-or-later
"""An actuator with latency gets values earlier."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_synthetic import MODELS, at, make_device, make_header, make_run

from hfx_blender.engine.rendering.conditioning.actuator_limits import advanced, rows_of
from hfx_blender.engine.rendering.renderer import Renderer

RATE = Fraction(100)


@pytest.mark.parametrize(
    ("latency_ms", "rows"), [(0.0, 0), (4.9, 0), (5.0, 1), (10.0, 1), (14.9, 1), (1500.0, 150)]
)
def test_a_latency_is_rounded_to_the_nearest_row(latency_ms, rows):
    assert rows_of(RATE, latency_ms) == rows


@given(st.integers(1, 60), st.floats(0.0, 60_000.0))
def test_rows_move_as_they_are_and_the_end_is_neutral(count, latency_ms):
    values = np.arange(2.0 * count).reshape(count, 2)
    actual = advanced(values, np.array([-1.0, -2.0]), rows_of(RATE, latency_ms))
    rows = min(rows_of(RATE, latency_ms), count)
    assert actual[: count - rows].tolist() == values[rows:].tolist()
    free = max(count - rows, rows)  # no early or late row from here on
    assert actual[free:].tolist() == [[-1.0, -2.0]] * (count - free)


def test_early_values_of_a_late_actuator_are_delayed_not_lost():
    values = np.zeros((100, 1))
    values[2:5], values[40:45], values[60] = 1.0, 2.0, 3.0
    actual = advanced(values, np.zeros(1), rows_of(RATE, 300.0))
    expected = np.zeros(100)
    expected[2:5], expected[10:15], expected[30] = 1.0, 2.0, 3.0
    assert actual[:, 0].tolist() == expected.tolist()


def rasters(interval_ms=10.0, *, compensates_latency=True):
    header = make_header({"tap": "vibration"}, 40)
    device = make_device({"m": ("vibration", at(3)), "late": ("vibration", at(3))})
    slow = replace(device.actuators[1].type, latency_ms=40.0, update_interval_ms=interval_ms)
    device = replace(
        device, actuators=(device.actuators[0], replace(device.actuators[1], type=slow))
    )
    renderer = Renderer(
        header, device, lambda name: MODELS[name], compensates_latency=compensates_latency
    )
    renderer.add([make_run(header, "tap", {i: {3: 1.0} for i in (20, 21)}, [5.0, 80.0])])
    return renderer.raster().values


def test_each_actuator_is_early_by_its_own_latency():
    values = rasters()
    assert np.flatnonzero(values[:, 0]).tolist() == [20, 21]
    assert np.flatnonzero(values[:, 2]).tolist() == [16, 17]


def test_live_values_are_not_shifted():
    values = rasters(compensates_latency=False)
    assert np.flatnonzero(values[:, 2]).tolist() == [20, 21]


def test_updates_are_held_after_the_compensation_of_latency():
    assert np.flatnonzero(rasters(50.0)[:, 2]).tolist() == [15, 16, 17, 18, 19]
