# SPDX-License-Identifier: GPL-3.0-or-later
"""Barycentric rendering on a flat pad, against hand arithmetic and the papers' promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.rendering.panning.complex import LAWS, gain
from hfx_blender.engine.rendering.panning.positional import PlanarPanning

EDGE = 0.0635  # Schneider et al. 2015: tactors 6.35 cm apart, in rows of 3, 4, 3


def pad() -> np.ndarray:
    rows = []
    for row, count in enumerate((3, 4, 3)):
        x = (np.arange(count) - (count - 1) / 2) * EDGE
        rows.append(np.column_stack((x, np.full(count, (row - 1) * EDGE * np.sqrt(3) / 2))))
    return np.concatenate(rows)


PAD = pad()
coordinate = st.floats(-0.3, 0.3)


def inside_pad(draw_weights: list[float]) -> np.ndarray:
    """Results are convex combinations of the tactors, always in the hull."""
    weights = np.array(draw_weights) + 1e-9
    return (weights / weights.sum()) @ PAD


hull_point = st.lists(st.floats(0.0, 1.0), min_size=10, max_size=10).map(inside_pad)


def test_the_middle_of_a_triangle_by_hand():
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    middle = np.array([[1 / 3, 1 / 3]])
    assert PlanarPanning(triangle, "linear").gains(middle) == pytest.approx(np.full((1, 3), 1 / 3))
    assert PlanarPanning(triangle, "log").gains(middle) == pytest.approx(
        np.full((1, 3), np.log2(4 / 3))
    )
    assert PlanarPanning(triangle, "power").gains(middle) == pytest.approx(np.full((1, 3), 3**-0.5))


@pytest.mark.parametrize("law", LAWS)
def test_at_an_actuator_only_that_actuator_plays(law):
    assert PlanarPanning(PAD, law).gains(PAD) == pytest.approx(np.eye(10), abs=1e-9)


@given(hull_point)
@settings(deadline=None)
def test_the_centroid_of_linear_gains_is_the_place(point):
    gains = PlanarPanning(PAD, "linear").gains(point[None])[0]
    assert gains.min() >= 0.0
    assert gains.sum() == pytest.approx(1.0)
    assert np.linalg.norm(gains @ PAD - point) < 1e-9


@given(hull_point)
@settings(deadline=None)
def test_power_gains_keep_the_power(point):
    gains = PlanarPanning(PAD, "power").gains(point[None])[0]
    assert np.sum(gains**2) == pytest.approx(1.0)


@given(hull_point)
@settings(deadline=None)
def test_log_gains_follow_the_formula_from_linear_ones(point):
    shares = PlanarPanning(PAD, "linear").gains(point[None])[0]
    gains = PlanarPanning(PAD, "log").gains(point[None])[0]
    assert gains == pytest.approx(np.log2(1.0 + shares))


@given(st.tuples(coordinate, coordinate), st.tuples(coordinate, coordinate))
@settings(max_examples=200, deadline=None)
def test_shares_never_change_faster_than_the_place(a, b):
    """In an equilateral triangle of height h, a share changes by at most 1 / h per metre."""
    scheme = PlanarPanning(PAD, "linear")
    first, second = scheme.gains(np.array([a, b]))
    steepest = 1.0 / (EDGE * np.sqrt(3) / 2)
    step = float(np.linalg.norm(np.subtract(a, b)))
    assert np.abs(first - second).max() <= steepest * step * (1 + 1e-6) + 1e-9


def test_beyond_the_hull_its_nearest_place_is_shown():
    scheme = PlanarPanning(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), "linear")
    gains = scheme.gains(np.array([[0.25, -3.0], [-2.0, -2.0], [2.0, 2.0]]))
    assert gains == pytest.approx(np.array([[0.75, 0.25, 0], [1, 0, 0], [0, 0.5, 0.5]]))


def test_few_and_degenerate_layouts_play():
    point = np.array([[0.25, 0.5]])
    one = PlanarPanning(np.array([[3.0, 3.0]]), "linear")
    assert one.gains(point).tolist() == [[1.0]]
    two = PlanarPanning(np.array([[0.0, 0.0], [1.0, 0.0]]), "linear")
    assert two.gains(point) == pytest.approx(np.array([[0.75, 0.25]]))
    line = PlanarPanning(np.array([[1.0, 0.0], [0.0, 0.0], [0.5, 0.0]]), "linear")
    assert line.gains(point) == pytest.approx(np.array([[0.0, 0.5, 0.5]]))
    twins = PlanarPanning(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]), "linear")
    assert twins.gains(point) == pytest.approx(np.array([[0.75, 0.125, 0.125]]))
    same = PlanarPanning(np.zeros((3, 2)), "power")
    assert np.sum(same.gains(point) ** 2) == pytest.approx(1.0)


def test_a_thousand_actuators_play():
    grid = np.stack(np.meshgrid(np.arange(40.0), np.arange(25.0)), axis=-1).reshape(-1, 2)
    points = np.random.default_rng(0).uniform((0, 0), (39, 24), (50, 2))
    gains = PlanarPanning(grid, "linear").gains(points)
    assert np.abs(gains @ grid - points).max() < 1e-9
    assert (np.count_nonzero(gains, axis=1) <= 3).all()


def test_a_place_that_is_not_a_number_drives_nothing():
    gains = PlanarPanning(PAD).gains(np.array([[np.nan, 0.0], [np.inf, 0.0]]))
    assert not gains.any()


def test_an_unknown_law_is_refused():
    with pytest.raises(ValueError, match="linear, log, power"):
        gain(np.zeros((1, 1)), "square")  # type: ignore[arg-type]


def test_positions_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="finite"):
        PlanarPanning(np.array([[0.0, np.nan]]))
