# SPDX-License-Identifier: GPL-3.0-or-later
"""Ring, line, vector-base panning and splatting: constant power, neighbours only, no jumps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.rendering.panning.constant_power import (
    LinePanning,
    RingPanning,
    VectorBasePanning,
)
from hfx_blender.engine.rendering.panning.positional import GaussianSplatting, NearestPanning

BELT = np.arange(8) * 2 * np.pi / 8
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
DOME = np.vstack([CUBE[CUBE[:, 2] > 0], [[0, 0, 1]]])
angle = st.floats(-20.0, 20.0)
layouts = st.lists(angle, min_size=1, max_size=6, unique=True)


def unit(values: tuple[float, float, float]) -> np.ndarray:
    return np.array(values) / np.linalg.norm(values)


direction = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.01).map(unit)


def test_the_belts_formula_by_hand():
    quarter = BELT[2] + 0.25 * (BELT[3] - BELT[2])
    gains = RingPanning(BELT).gains(np.array([[quarter]]))[0]
    expected = np.zeros(8)
    expected[2], expected[3] = np.sqrt(0.75), np.sqrt(0.25)
    assert gains == pytest.approx(expected)


def test_the_ring_closes_over_its_seam():
    gains = RingPanning(BELT).gains(np.array([[BELT[7] + np.pi / 8], [-np.pi / 8]]))
    expected = np.zeros(8)
    expected[[7, 0]] = np.sqrt(0.5)
    assert gains == pytest.approx(np.array([expected, expected]))


@given(layouts, angle)
@settings(deadline=None)
def test_power_round_a_ring_is_constant(angles, source_angle):
    gains = RingPanning(np.array(angles)).gains(np.array([[source_angle]]))
    assert np.sum(gains**2) == pytest.approx(1.0)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=6), st.floats(-3, 3))
@settings(deadline=None)
def test_power_along_a_line_is_constant_and_ends_hold(positions, position):
    gains = LinePanning(np.array(positions)).gains(np.array([[position]]))[0]
    assert np.sum(gains**2) == pytest.approx(1.0)
    if position >= max(positions):
        assert gains[np.array(positions) < max(positions) - 1e-6].max(initial=0.0) == 0.0


def test_vector_base_panning_follows_the_tangent_law():
    """Pulkki 1997: tan(phi) / tan(phi_0) = (g1 - g2) / (g1 + g2) between two sources."""
    half = np.radians(30.0)
    pair = np.array([[np.cos(half), np.sin(half)], [np.cos(half), -np.sin(half)]])
    for phi in np.radians([-30.0, -12.0, 0.0, 7.0, 29.0]):
        g = VectorBasePanning(pair).gains(np.array([[np.cos(phi), np.sin(phi)]]))[0]
        assert (g[0] - g[1]) / (g[0] + g[1]) == pytest.approx(np.tan(phi) / np.tan(half))


@pytest.mark.parametrize("layout", [CUBE, DOME], ids=["cube", "dome"])
@given(position=direction)
@settings(max_examples=100, deadline=None)
def test_power_in_space_is_constant(layout, position):
    gains = VectorBasePanning(layout).gains(position[None])[0]
    assert np.sum(gains**2) == pytest.approx(1.0)
    assert gains.min() >= 0.0
    assert np.count_nonzero(gains > 1e-9) <= 3


@given(position=direction)
@settings(deadline=None)
def test_inside_the_hull_gains_point_where_the_source_is(position):
    gains = VectorBasePanning(CUBE).gains(position[None])[0]
    samples = gains @ (CUBE / np.sqrt(3.0))
    assert samples / np.linalg.norm(samples) == pytest.approx(position, abs=1e-6)


@pytest.mark.parametrize("layout", [CUBE, DOME], ids=["cube", "dome"])
def test_a_path_over_the_sphere_never_jumps(layout):
    """The path includes the rim of a dome."""
    turn = np.linspace(0.0, 2.0 * np.pi, 20001)
    for tilt in (0.3, 0.9, 1.4):
        path = np.column_stack(
            (np.cos(turn), np.sin(turn) * np.cos(tilt), np.sin(turn) * np.sin(tilt))
        )
        path = path[path[:, 2] > -0.6]
        gains = VectorBasePanning(layout).gains(path)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        jumps = np.abs(np.diff(gains, axis=0)).max(axis=1)
        assert jumps[steps < 0.01].max() < 0.02


@given(layouts, angle)
@settings(max_examples=200, deadline=None)
def test_any_layout_in_the_plane_has_constant_power(angles, position):
    layout = np.column_stack((np.cos(angles), np.sin(angles)))
    gains = VectorBasePanning(layout).gains(np.array([[np.cos(position), np.sin(position)]]))
    assert np.sum(gains**2) == pytest.approx(1.0)


def test_two_opposite_sources_hand_over_by_the_angle():
    scheme = VectorBasePanning(np.array([[1.0, 0.0], [-1.0, 0.0]]))
    gains = scheme.gains(np.array([[0.0, 1.0], [1.0, 1.0]]))
    assert gains == pytest.approx(np.sqrt(np.array([[0.5, 0.5], [0.75, 0.25]])))


def test_layouts_in_a_plane_with_the_centre_are_refused_in_space():
    flat = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
    with pytest.raises(ValueError, match="one plane"):
        VectorBasePanning(flat)


def test_a_direction_of_no_length_drives_nothing():
    gains = VectorBasePanning(CUBE).gains(np.array([[0.0, 0, 0], [np.nan, 0, 1]]))
    assert not gains.any()


def test_splatting_by_hand():
    scheme = GaussianSplatting(np.array([[0.0, 0.0], [0.02, 0.0]]), 0.01)
    floor = np.exp(-8.0)
    expected = (np.exp([-0.5, -0.5]) - floor) / (1 - floor)
    assert scheme.gains(np.array([[0.01, 0.0]]))[0] == pytest.approx(expected)
    assert scheme.gains(np.array([[0.0, 0.0], [0.0, 0.041]]))[:, 0] == pytest.approx([1.0, 0.0])
    assert not scheme.gains(np.array([[np.nan, 0.0]])).any()
    with pytest.raises(ValueError, match="sigma_m"):
        GaussianSplatting(np.zeros((1, 2)), 0.0)


def test_the_nearest_actuator_plays_alone():
    scheme = NearestPanning(np.array([[0.0, 0.0], [1.0, 0.0]]))
    gains = scheme.gains(np.array([[0.4, 5.0], [0.6, 0.0], [np.nan, 0.0]]))
    assert gains.tolist() == [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
