# SPDX-License-Identifier: GPL-3.0-or-later
"""Gathered contact weights, and reuse of the memory."""

import numpy as np
import pytest

from hfx_blender.engine.contact import compiled_contacts as gathering
from hfx_blender.engine.native import library

pytestmark = pytest.mark.skipif(not library.is_there(), reason="needs the compiled library")


class Table:
    """Stand-in for a skin table; gathering uses no members."""


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_weights_are_gathered_by_row_and_cleared_for_those_that_come_next(precision):
    table = Table()
    weights = gathering.no_weights(table, 5, 3, precision)
    weights[0, 1] = weights[1, 1] = 0.5  # the same set twice
    weights[2] = 0.25, 0.0, 1.0
    weights[3] = 1.0  # only there to be followed from
    is_reported = np.array([True, True, True, False, True])
    columns = np.array([7, 8, 9], np.int32)
    rows, sets, offsets, vertices, values = gathering.gathered(
        table, weights, columns, is_reported, False
    )
    assert rows.tolist() == [0, 1, 2] and sets.tolist() == [0, 0, 1]
    assert offsets.tolist() == [0, 1, 3]
    assert vertices.tolist() == [8, 7, 9] and values.tolist() == [0.5, 0.25, 1.0]
    again = gathering.no_weights(table, 2, 7, precision)
    assert np.shares_memory(weights, again) and again.shape == (2, 7)
    assert not weights.any()


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [1, 63, 64, 65, 200])
def test_weights_of_many_columns_are_those_of_numpy(columns, precision):
    rng = np.random.default_rng(columns)
    values = rng.random((40, columns)) * (rng.random((40, columns)) < 0.02)
    values = np.repeat(values, rng.integers(1, 4, 40), axis=0).astype(precision)  # some rows stay
    vertices = np.arange(columns, dtype=np.int32) * 3 + 1
    is_reported = rng.random(len(values)) < 0.9
    table = Table()
    weights = gathering.no_weights(table, *values.shape, precision)
    weights[:] = values
    gathered = gathering.gathered(table, weights, vertices, is_reported, False)
    assert not weights.any()
    felt = np.flatnonzero(values.any(axis=1) & is_reported)
    changed = np.array(
        [k == 0 or (values[felt[k]] != values[felt[k - 1]]).any() for k in range(len(felt))]
    )
    sets = values[felt[changed]] if len(felt) else values[:0]
    counts = np.count_nonzero(sets, axis=1)
    expected = (
        felt,
        np.cumsum(changed) - 1,
        np.cumsum([0, *counts]),
        vertices[np.nonzero(sets)[1]],
        sets[np.nonzero(sets)],
    )
    for actual, reference_value in zip(gathered, expected, strict=True):
        np.testing.assert_array_equal(actual, reference_value)


def test_weights_in_use_and_of_other_kinds_are_not_given_twice():
    table, other_table = Table(), Table()
    first = gathering.no_weights(table, 2, 2, np.float32)
    second = gathering.no_weights(table, 2, 2, np.float32)
    assert not np.shares_memory(first, second)
    gathering.gathered(table, first, np.zeros(2, np.int32), np.ones(2, np.bool_), False)
    for case in (
        (other_table, 2, 2, np.float32),
        (table, 2, 2, np.float64),
        (table, 3, 2, np.float32),
    ):
        assert not np.shares_memory(first, gathering.no_weights(*case))
