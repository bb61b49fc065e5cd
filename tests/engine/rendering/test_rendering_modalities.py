# SPDX-License-Identifier: GPL-3.0-or-later
"""Combination of effects of one modality, against arithmetic by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.rendering.conditioning.mixing import Contribution, combine_vibration, mix


def strengths(modality, *effects):
    """Return strengths of effects: (shares at the A actuators, parameters, neutral values)."""
    contributions = [
        Contribution(np.array([shares]), np.array([parameters]), neutral_c)
        for shares, parameters, neutral_c in effects
    ]
    return mix(modality, contributions).strengths[0]


@pytest.mark.parametrize(
    ("amplitudes", "frequencies", "amplitude", "frequency"),
    [
        ([3.0], [80.0], 3.0, 80.0),
        ([3.0, 4.0], [80.0, 80.0], 7.0, 80.0),  # equal: add
        ([3.0, 4.0], [80.0, 80.9], 7.0, 80.0),  # within 1 Hz counts as equal
        ([3.0, 4.0], [80.0, 250.0], 5.0, 250.0),  # unequal: 3-4-5
        ([3.0, 4.0, 2.0], [80.0, 250.0, 80.5], np.hypot(5.0, 4.0), 80.0),
        ([3.0, 3.0], [250.0, 80.0], np.hypot(3.0, 3.0), 80.0),  # a tie: the lower frequency
        (
            [0.0, 4.0],
            [99.5, 100.0],
            4.0,
            100.0,
        ),  # without the silent effect's Hz
        (
            [1.0, 1.0, 1.0],
            [10.0, 10.8, 11.6],
            np.hypot(2.0, 1.0),
            10.0,
        ),  # no chains
        ([0.0, 0.0], [80.0, 90.0], 0.0, 0.0),
    ],
)
def test_vibration(amplitudes, frequencies, amplitude, frequency):
    actual = combine_vibration(np.array(amplitudes), np.array(frequencies))
    assert actual[0] == pytest.approx(amplitude, rel=1e-15)
    assert actual[1] == frequency


def test_vibration_of_many_places_at_once_is_that_of_each_alone():
    random = np.random.default_rng(1)
    amplitudes = random.choice([0.0, 1.0, 2.0, 3.5], (4, 5, 3))
    frequencies = random.choice([80.0, 80.5, 100.0, 250.0], (4, 5, 1))
    amplitude, frequency = combine_vibration(amplitudes, frequencies)
    for t in range(5):
        for a in range(3):
            alone = combine_vibration(amplitudes[:, t, a], frequencies[:, t, 0])
            assert (amplitude[t, a], frequency[t, a]) == alone


@given(st.lists(st.tuples(st.floats(0, 100), st.floats(1, 500)), min_size=1, max_size=6))
def test_vibration_does_not_depend_on_the_order_and_is_bounded(pairs):
    amplitudes, frequencies = np.array(pairs).T
    forward = combine_vibration(amplitudes, frequencies)
    assert combine_vibration(amplitudes[::-1], frequencies[::-1])[0] == pytest.approx(forward[0])
    # Between adding as powers and adding in phase.
    assert np.sqrt(np.sum(amplitudes**2)) <= forward[0] * (1 + 1e-12) + 1e-300
    assert forward[0] <= amplitudes.sum() * (1 + 1e-12) + 1e-150  # squares of less have few digits


def test_pressures_add():
    actual = strengths("pressure", ([0.5, 1.0], [2.0], 0.0), ([0.25, 1.0], [4.0], 0.0))
    np.testing.assert_array_equal(actual, [2.0, 6.0])


def test_winds_add_as_vectors():
    along_x = [1.0, 0.5], [3.0, 1.0, 0.0, 0.0], 0.0
    along_y = [1.0, 0.0], [4.0, 0.0, 1.0, 0.0], 0.0
    np.testing.assert_allclose(strengths("wind", along_x, along_y), [5.0, 1.5])
    back = [1.0, 0.5], [3.0, -1.0, 0.0, 0.0], 0.0
    np.testing.assert_array_equal(strengths("wind", along_x, back), [0.0, 0.0])


def test_temperature_deviates_from_each_effects_own_neutral():
    # Air of 30 degC warms by 6 K at full strength; an object of 30 degC cools by 1.5 K at half.
    actual = strengths("temperature", ([1.0], [30.0], 24.0), ([0.5], [30.0], 33.0))
    assert actual == [4.5]
