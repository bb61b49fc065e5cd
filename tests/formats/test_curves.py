# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplified curves: within the tolerance, and with the fewest keyframes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.formats.signals.curves import Curve, simplified

SHARES = st.floats(0.0, 1.0, width=32)


def deviation(original, second):
    """Return the largest difference at any time; both are straight between keyframes."""
    times = np.union1d(original.times_s, second.times_s)
    after = np.abs(original.at(times) - second.at(times))
    return max(after.max(), np.abs(original.before(times) - second.before(times)).max())


def curve_of(values, rate_hz=100.0):
    return Curve.of(np.arange(len(values)) / rate_hz, values)


def least_count(curve, tolerance):
    """Return the least number of keyframes at sample rows within a tolerance, by exhaustive search.

    A linear programme per choice of rows decides whether suitable values exist.
    """
    from scipy.optimize import linprog

    times, values = curve.times_s, curve.values
    rows = range(1, len(times) - 1)
    for count in range(len(times) - 1):
        for inner in combinations(rows, count):
            knots = times[[0, *inner, len(times) - 1]]
            hats = np.array([np.interp(times, knots, unit) for unit in np.eye(len(knots))]).T
            actual = linprog(
                np.zeros(len(knots)),
                A_ub=np.vstack([hats, -hats]),
                b_ub=np.concatenate([values + tolerance, tolerance - values]),
                bounds=(None, None),
            )
            if actual.status == 0:
                return count + 2
    return len(times)


@pytest.mark.parametrize("seed", range(14))
def test_no_curve_that_turns_at_rows_has_fewer_keyframes(seed):
    random = np.random.default_rng(seed)
    smooth = np.cumsum(random.normal(0, 0.05, 8))
    curve = curve_of(smooth if seed % 2 else random.random(8))
    for tolerance in (0.02, 0.1):
        actual = simplified(curve, tolerance)
        assert len(actual) <= least_count(curve, tolerance)


def test_the_fewest_keyframes_of_simple_curves():
    assert least_count(curve_of([0, 1, 2, 3, 4]), 0.01) == 2
    assert least_count(curve_of([0, 1, 2, 1, 0]), 0.01) == 3
    assert least_count(curve_of([0, 0, 1, 0, 0]), 0.01) == 5
    assert least_count(curve_of([0, 0, 1, 0, 0]), 0.5) == 2


@given(st.lists(SHARES, min_size=1, max_size=60), st.floats(1e-3, 0.5))
def test_the_error_is_at_most_the_tolerance(values, tolerance):
    curve = curve_of(values)
    actual = simplified(curve, tolerance, lowest=0.0, highest=1.0)
    assert deviation(curve, actual) <= tolerance * (1 + 1e-9)
    assert len(actual) <= max(len(values), 2)
    assert actual.times_s[0] == 0.0
    assert actual.times_s[-1] == pytest.approx(curve.times_s[-1], abs=1e-5)
    assert 0.0 <= actual.values.min() and actual.values.max() <= 1.0


@given(st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.004, 0.5, 1.0]), min_size=2, max_size=40))
def test_silence_stays_silent(values):
    curve = curve_of(values)
    actual = simplified(curve, 0.01, lowest=0.0, highest=1.0, keeps_silence=True)
    assert deviation(curve, actual) <= 0.01 * (1 + 1e-9)
    rows = curve.times_s[curve.values == 0.0]
    assert np.all(actual.at(rows) <= 1.1e-4)  # a hundredth of the tolerance
    row = np.searchsorted(curve.times_s, actual.times_s, side="right") - 1
    is_silent = np.append(curve.values, 0.0) == 0.0
    within = is_silent[row] & is_silent[row + 1]  # between two silent rows
    assert np.all(actual.values[within] == 0.0)


@pytest.mark.parametrize("kind", ["constant", "ramp", "sine", "noise", "pulses"])
def test_a_hundred_thousand_points(kind):
    times = np.arange(100_000) / 1000.0
    values = {
        "constant": np.full(len(times), 0.3),
        "ramp": times / times[-1],
        "sine": 0.5 + 0.5 * np.sin(times),
        "noise": np.random.default_rng(1).random(len(times)),
        "pulses": (np.arange(len(times)) // 50 % 2).astype(float),
    }[kind]
    curve = Curve(times, values)
    actual = simplified(curve, 0.01, lowest=0.0, highest=1.0, keeps_silence=True)
    assert deviation(curve, actual) <= 0.01
    if kind in ("constant", "ramp"):
        assert len(actual) <= 3
    if kind == "sine":  # arcs of curvature A have an error of A h^2 / 16 at best
        ideal = sum(np.sqrt(np.abs(0.5 * np.sin(times)) / 0.16)) / 1000.0
        assert len(actual) <= 1.2 * ideal + 10
    if kind == "pulses":
        assert len(actual) <= 4 * 1000 + 2


def test_free_stretches_need_no_keyframes():
    values = np.where(np.arange(100) % 10 == 0, 1.0, np.random.default_rng(2).random(100))
    is_free = np.arange(100) % 10 != 0
    actual = simplified(curve_of(values), 0.01, is_free=is_free)
    assert len(actual) == 2


def test_a_step_is_kept():
    curve = Curve.of([0.0, 0.5, 0.5, 1.0], [0.0, 0.0, 1.0, 1.0])
    actual = simplified(curve, 0.01)
    assert actual.at(0.499) <= 0.01 and actual.at(0.501) >= 0.99


def test_values_at_a_step():
    curve = Curve.of([0.0, 0.5, 0.5, 1.0], [0.0, 1.0, 3.0, 3.0])
    assert curve.at([0.25, 0.5, 2.0]).tolist() == [0.5, 3.0, 3.0]
    assert curve.before([0.25, 0.5, 2.0]).tolist() == [0.5, 1.0, 3.0]


@pytest.mark.parametrize(
    ("times", "values"), [([], []), ([0.0], [np.nan]), ([1.0, 0.0], [0, 0]), ([0.0, 1.0], [0.0])]
)
def test_an_invalid_curve_is_refused(times, values):
    with pytest.raises(ValueError):
        Curve.of(times, values)
