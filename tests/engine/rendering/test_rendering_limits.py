# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits: only finite values in range. Updates: peaks are held."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from hfx_blender.engine.rendering.conditioning.actuator_limits import held, limited

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ([5, 100], [5, 100]),
        ([-1, 10], [0, 60]),
        ([1e308, 1e308], [15, 250]),
        ([NAN, 100], [0, 80]),  # silent, not full power
        ([5, NAN], [0, 80]),  # a NaN frequency silences, too
        ([INF, 100], [0, 80]),
        ([-INF, 100], [0, 80]),
        ([5, INF], [0, 80]),
    ],
)
def test_limits_by_hand(value, expected):
    assert limited(value, [0, 60], [15, 250], [0, 80]).tolist() == expected


any_bits = npst.arrays(np.uint64, st.tuples(st.integers(0, 50), st.just(2)))


@settings(max_examples=300)
@given(any_bits)
def test_no_bit_pattern_gets_out_of_range(bits):
    values = bits.view(np.float64)
    actual = limited(values, [0, 60], [15, 250], [0, 80])
    assert np.isfinite(actual).all()
    assert (actual >= [0, 60]).all() and (actual <= [15, 250]).all()
    is_broken = ~np.isfinite(values).all(axis=1)
    assert (actual[is_broken] == [0, 80]).all()


def rows(*strengths):
    """Return rows (T, 2); the second column numbers the rows."""
    return np.column_stack([strengths, np.arange(float(len(strengths)))])


def test_fast_actuators_are_left_alone():
    values = rows(1, 2, 3)
    assert held(values, np.zeros(2), Fraction(100), 10.0) is values
    assert held(values, np.zeros(2), Fraction(60), 10.0) is values


def test_a_short_contact_keeps_its_peak_for_one_interval():
    values = rows(0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 1, 2)
    actual = held(values, np.zeros(2), Fraction(100), 50.0)
    assert actual[:, 0].tolist() == [7] * 5 + [0] * 5 + [2] * 2
    assert actual[:, 1].tolist() == [2] * 5 + [5] * 5 + [11] * 2  # all of the row is taken


def test_strong_means_far_from_neutral():
    actual = held(rows(24, 20, 26, 24), np.array([24.0, 0.0]), Fraction(100), 40.0)
    assert actual.tolist() == [[20, 1]] * 4


def test_intervals_that_are_not_whole_rows():
    # 15 ms at 100 Hz: rows at 0, 10 | 20 | 30, 40 | 50 ms ...
    actual = held(rows(1, 2, 3, 4, 5, 6, 7), np.zeros(2), Fraction(100), 15.0)
    assert actual[:, 0].tolist() == [2, 2, 3, 5, 5, 6, 7]


@given(
    st.lists(st.floats(0, 10), min_size=1, max_size=60),
    st.sampled_from([7.0, 10.0, 15.0, 33.3, 50.0, 1000.0]),
    st.sampled_from([Fraction(60), Fraction(100), Fraction(30000, 1001), Fraction(1000)]),
)
def test_hold_is_that_of_a_slow_twin(strengths, interval_ms, rate_hz):
    actual = held(rows(*strengths), np.zeros(2), rate_hz, interval_ms)
    bins = [int(i / rate_hz / (Fraction(str(interval_ms)) / 1000)) for i in range(len(strengths))]
    for i, value in enumerate(actual[:, 0]):
        assert value == max(s for s, b in zip(strengths, bins, strict=True) if b == bins[i])


def test_hold_silences_the_interval_of_a_value_that_is_no_number():
    actual = held(rows(1, NAN, 2, 3), np.zeros(2), Fraction(100), 20.0)
    out = limited(actual, [0, 0], [10, 99], [0, 0])
    assert np.isfinite(out).all()
    assert out[2:, 0].tolist() == [3, 3]
