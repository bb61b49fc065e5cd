# SPDX-License-Identifier: GPL-3.0-or-later
"""Guard: safe finite output for every input."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.guard import Guard
from hfx_blender.engine.rendering.device_config import DeviceConfig

DEVICE = load_device("forearm_band_left")
STEP = 0.01


def limited_in_time(**limits: float) -> DeviceConfig:
    kinds = {name: replace(kind, **limits) for name, kind in DEVICE.actuator_types.items()}
    actuators = tuple(replace(a, type=kinds[a.type.name]) for a in DEVICE.actuators)
    return replace(DEVICE, actuator_types=kinds, actuators=actuators)


def strengths(values: np.ndarray) -> np.ndarray:
    return values[::2]  # amplitude, frequency, amplitude ...


def full(guard: Guard, amplitude: float = 15.0) -> np.ndarray:
    values = guard.neutral.copy()
    values[::2] = amplitude
    return values


anything = st.one_of(
    st.floats(), st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, -0.0, 5e-324])
)


@given(st.lists(anything, min_size=16, max_size=16), anything)
@settings(deadline=None, max_examples=300)
def test_every_limited_value_is_finite_and_in_range(requested, step_s):
    limited = Guard(DEVICE).limited(requested, step_s)
    controls = [c for a in DEVICE.actuators for c in a.type.controls]
    assert np.isfinite(limited).all()
    assert (limited >= [c.lowest for c in controls]).all()
    assert (limited <= [c.highest for c in controls]).all()


@pytest.mark.parametrize(
    "requested", [None, "full", [1.0], [[1.0] * 16], {"a": 1}, [object()] * 16, np.zeros((16, 2))]
)
def test_a_malformed_frame_is_silence(requested: Any):
    guard = Guard(DEVICE)
    guard.limited(full(guard), STEP)
    assert np.array_equal(guard.limited(requested, STEP), guard.neutral)


def test_not_a_number_silences_its_actuator_only():
    guard = Guard(DEVICE)
    expected = full(guard)
    expected[3] = math.nan  # the second motor's frequency
    limited = guard.limited(expected, STEP)
    assert limited[2] == 0.0
    assert strengths(limited)[[0, 2, 3, 4, 5, 6, 7]].tolist() == [15.0] * 7


def test_rises_are_slowed_and_falls_are_not():
    guard = Guard(limited_in_time(slew_per_s=100.0))
    for k in range(1, 16):
        assert strengths(guard.limited(full(guard), STEP)) == pytest.approx(min(k * 1.0, 15.0))
    assert strengths(guard.limited(guard.neutral, STEP)).tolist() == [0.0] * 8


def test_a_clock_that_stands_or_runs_backwards_lets_nothing_rise():
    for step in (0.0, -1.0, math.nan, math.inf):
        guard = Guard(limited_in_time(slew_per_s=100.0))
        assert not strengths(guard.limited(full(guard), step)).any()


def test_a_set_point_on_the_other_side_of_neutral_rises_from_neutral():
    heater = load_device("fan_heater")
    kinds = {n: replace(k, slew_per_s=100.0) for n, k in heater.actuator_types.items()}
    device = replace(
        heater,
        actuator_types=kinds,
        actuators=tuple(replace(a, type=kinds[a.type.name]) for a in heater.actuators),
    )
    guard = Guard(device)
    (column,) = [i for i, a in enumerate(device.actuators) if a.type.modality == "temperature"]
    expected = guard.neutral.copy()
    neutral = guard.neutral[column]
    expected[column] = neutral + 5.0
    for _ in range(10):
        warm = guard.limited(expected, STEP)[column]
    assert warm == neutral + 5.0
    expected[column] = neutral - 5.0
    assert guard.limited(expected, STEP)[column] == pytest.approx(neutral - 1.0)


def test_an_actuator_on_too_long_rests():
    guard = Guard(limited_in_time(maximum_on_s=0.05, rest_s=0.03))
    on = [bool(strengths(guard.limited(full(guard), STEP)).any()) for _ in range(20)]
    # Five steps on, then silence: the step over the limit and three steps of rest; and again.
    assert on == ([True] * 5 + [False] * 4) * 2 + [True] * 2


def test_short_pauses_do_not_cheat_the_rest():
    guard = Guard(limited_in_time(maximum_on_s=0.05, rest_s=1.0))
    for _ in range(6):
        guard.limited(full(guard), STEP)
    guard.limited(guard.neutral, STEP)
    assert not strengths(guard.limited(full(guard), STEP)).any()


def test_after_a_reset_the_guard_starts_from_silence():
    guard = Guard(limited_in_time(slew_per_s=100.0))
    for _ in range(10):
        guard.limited(full(guard), STEP)
    guard.reset()
    assert strengths(guard.limited(full(guard), STEP)) == pytest.approx(1.0)


def test_wild_values_of_a_whole_minute_stay_in_range():
    rng = np.random.default_rng(3)
    guard = Guard(limited_in_time(slew_per_s=500.0, maximum_on_s=0.5))
    controls = [c for a in DEVICE.actuators for c in a.type.controls]
    low, high = np.array([c.lowest for c in controls]), np.array([c.highest for c in controls])
    wild = rng.normal(0, 200, (3000, 16))
    wild[rng.random(wild.shape) < 0.02] = np.nan
    actual = np.array([guard.limited(row, STEP) for row in wild])
    assert np.isfinite(actual).all() and (actual >= low).all() and (actual <= high).all()
