# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage against a slow twin, placement and mirroring on a body of dots."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendering_synthetic import MODELS, at, make_device

import hfx_blender.engine.rendering.coverage as coverage
from hfx_blender.engine.rendering.actuator_vertices import vertices_of
from hfx_blender.engine.rendering.coverage import ActuatorCells
from hfx_blender.engine.rendering.device_config import BodyPlace, RoomPlace, VertexPlace, VertexSet
from hfx_blender.engine.rendering.schemes import cells_of
from hfx_blender.errors import InputError

SIZE = 12
weight = st.floats(2**-10, 1.0, width=32)
samples_of = st.lists(st.dictionaries(st.integers(0, SIZE - 1), weight, max_size=SIZE), max_size=9)
rows_of = st.lists(st.sets(st.integers(0, SIZE - 1), max_size=SIZE), min_size=1, max_size=6)


def slow_gain(sample, row, statistic):
    shared = [np.float64(np.float32(sample[v])) for v in row if v in sample]
    if not shared:
        return 0.0
    return max(shared) if statistic == "strongest" else sum(shared) / len(row)


def fast_gains(samples, rows, statistic):
    cells = ActuatorCells([np.array(sorted(row), np.int32) for row in rows], SIZE)
    offsets = np.concatenate([[0], np.cumsum([len(s) for s in samples])]).astype(np.int64)
    vertices = np.array([v for s in samples for v in sorted(s)], np.int32)
    weights = np.array([s[v] for s in samples for v in sorted(s)], np.float32)
    return cells.gains(offsets, vertices, weights, statistic)


@pytest.mark.parametrize("dense_entries", [1, 30, 1 << 18])
@pytest.mark.parametrize("statistic", ["strongest", "mean"])
@settings(max_examples=150, deadline=None)
@given(samples=samples_of, rows=rows_of)
def test_gains_are_those_of_a_slow_twin(statistic, dense_entries, samples, rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "DENSE_ENTRIES", dense_entries)
        actual = fast_gains(samples, rows, statistic)
    expected = [[slow_gain(s, row, statistic) for row in rows] for s in samples]
    assert actual.shape == (len(samples), len(rows))
    np.testing.assert_allclose(actual, np.reshape(expected, actual.shape), rtol=1e-12)


def test_strongest_and_mean_by_hand():
    samples = [{0: 0.5, 1: 0.25}, {3: 1.0}]
    rows = [{0, 1}, {1, 2}, set(), {2, 3, 4, 5}]
    assert fast_gains(samples, rows, "strongest").tolist() == [[0.5, 0.25, 0, 0], [0, 0, 0, 1]]
    assert fast_gains(samples, rows, "mean").tolist() == [[0.375, 0.125, 0, 0], [0, 0, 0, 0.25]]


def test_samples_with_equal_first_and_last_sets_are_not_taken_for_one_set():
    samples = [{0: 0.5, 1: 0.25}, {2: 0.125, 3: 1.0}, {0: 0.75, 1: 0.25}]
    actual = fast_gains(samples, [{0}, {3}], "strongest")
    assert actual.tolist() == [[0.5, 0], [0, 1], [0.75, 0]]


MODEL = MODELS["dots-pressure"]  # x = -0.45 ... 0.45; even vertices forearm, odd torso


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        (BodyPlace(("forearm", "torso"), (0.0, 0.0, 0.0), 0.16), [3, 4, 5, 6]),
        (BodyPlace(("torso",), (0.0, 0.0, 0.0), 0.16), [3, 5]),
        (BodyPlace(("torso",), (0.0, 0.0, 0.0), 0.16, "left"), [5]),
        (BodyPlace(("torso",), (0.02, 0.0, 0.0), 0.0), [5]),  # between: the nearest at least
        (BodyPlace(("forearm",), (0.07, 0.0, 0.0), 0.0), [6]),  # nearest of the part
        (RoomPlace(("torso",)), [1, 3, 5, 7, 9]),
        (at(2, 7), [2, 7]),
        (VertexPlace((VertexSet("another", "0" * 64, (1,)),)), []),
    ],
)
def test_places(place, expected):
    assert vertices_of(place, MODEL).tolist() == expected


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (BodyPlace(("head",), (0.0, 0.0, 0.0), 0.1), "no vertex on head"),
        (BodyPlace(("torso",), (0.0, 0.0, 0.0), 0.1, "centre"), r"no vertex on torso \(centre\)"),
        (BodyPlace(("torso",), (0.0, 1.0, 0.0), 0.1), "1.00 m from the nearest"),
        (VertexPlace((VertexSet(MODEL.id, "0" * 64, (1,)),)), "chosen on another"),
        (VertexPlace((VertexSet(MODEL.id, MODEL.content_hash, (1, 10)),)), "vertex 10 is not on"),
    ],
)
def test_places_that_do_not_fit_name_device_and_actuator(place, message):
    device = make_device({"a": ("pressure", place)})
    with pytest.raises(InputError, match=f"^Device 'device', actuator 'a': .*{message}"):
        cells_of(device, device.actuators, MODEL)


def test_a_mirrored_device_reaches_the_mirrored_vertices():
    places = {"a": ("pressure", at(0, 1)), "b": ("pressure", RoomPlace(("torso",)))}
    device = make_device(places, is_mirrored=True)
    a, b = cells_of(device, device.actuators, MODEL).rows
    assert a.tolist() == [8, 9] and b.tolist() == [0, 2, 4, 6, 8]
