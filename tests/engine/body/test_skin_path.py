# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths drawn on the skin."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skin_plane import plane

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.skin_path import OFF_SKIN_M, STEP_M, SkinPaths
from hfx_blender.errors import InputError

PLANE = plane()
FLAT = SkinPaths(PLANE.vertices, PLANE.triangles)
_COORDINATE = st.floats(-0.1, 0.1)


def _length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@settings(max_examples=15, deadline=None)
@given(a=st.tuples(_COORDINATE, _COORDINATE), b=st.tuples(_COORDINATE, _COORDINATE))
def test_on_a_flat_patch_the_shortest_way_is_straight(
    a: tuple[float, float], b: tuple[float, float]
) -> None:
    knots = np.array([[*a, 0.0], [*b, 0.0]])
    path = FLAT.straight(knots)
    straight = float(np.linalg.norm(knots[1] - knots[0]))
    same_m = 1.1e-7  # knots merge below this distance
    assert straight - same_m <= _length(path) <= straight * 1.001 + same_m
    if straight > 0.01:
        way = (knots[1] - knots[0]) / straight
        beside = np.linalg.norm(np.cross(path - knots[0], way), axis=1)
        assert beside.max() < 1e-3
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 1.5 * STEP_M
        assert path[0] == pytest.approx(knots[0]) and path[-1] == pytest.approx(knots[1])


def test_round_a_tube_the_shortest_way_is_a_helix() -> None:
    radius, around, along = 0.05, 60, 40
    angle, height = np.meshgrid(
        np.arange(around) * 2 * np.pi / around, np.arange(along) * 0.006, indexing="ij"
    )
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1).reshape(-1, 3)
    a, b = np.meshgrid(np.arange(around), np.arange(along - 1), indexing="ij")
    at = [((a + i) % around * along + b + j).ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    triangles = np.concatenate([np.stack(at[:3], 1), np.stack([at[0], at[2], at[3]], 1)])
    tube = SkinPaths(points, triangles)
    knots = points[[5, 20 * along + 30]]  # a third of a turn, 15 cm up
    path = tube.straight(knots)
    helix = np.hypot(radius * 2 * np.pi / 3, 25 * 0.006)
    assert _length(path) == pytest.approx(helix, rel=0.005)
    turn = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
    assert turn == pytest.approx((path[:, 2] - 0.03) / 0.15 * 2.0944, abs=0.03)


def test_a_path_through_several_places_visits_them() -> None:
    knots = np.array([[-0.1, 0, 0], [0, 0.08, 0], [0.1, 0, 0]])
    for path in (FLAT.straight(knots), FLAT.curve(knots)):
        for knot in knots:
            assert np.linalg.norm(path - knot, axis=1).min() < 1e-3
    closed = FLAT.straight(knots, closed=True)
    assert _length(closed) == pytest.approx(_length(FLAT.straight(knots)) + 0.2, rel=1e-3)
    assert closed[0] == pytest.approx(closed[-1])


def test_one_place_is_a_path_that_does_not_move() -> None:
    point = np.array([[0.01, 0.02, 0.0]])
    for path in (FLAT.straight(point), FLAT.curve(point), FLAT.traced(point)[0]):
        assert path == pytest.approx(point)
    assert FLAT.traced(point)[1] == pytest.approx([0.0])


def test_a_traced_path_knows_where_each_place_is() -> None:
    places = np.array([[0.0, 0, 0], [0.03, 0, 0], [0.03, 0, 0], [0.03, 0.01, 0]])
    path, shares = FLAT.traced(places)
    assert shares == pytest.approx([0.0, 0.75, 0.75, 1.0])
    assert _length(path) == pytest.approx(0.04)


def test_points_off_the_body_are_refused() -> None:
    for places, message in (
        ([[0.0, 0.0, OFF_SKIN_M + 0.01]], "from the skin"),
        ([[np.nan, 0.0, 0.0]], "not a finite number"),
        ([], "at least one place"),
    ):
        with pytest.raises(InputError, match=message):
            FLAT.on_skin(np.array(places))


def test_a_way_round_the_body_stays_on_the_skin() -> None:
    model = load_model("hfx-pressure-1")
    skin = SkinPaths(model.vertices, model.triangles)
    knots = skin.on_skin([[0.0, -0.15, 1.25], [0.0, 0.05, 1.25]])
    path = skin.straight(knots)
    assert skin.on_skin(path) == pytest.approx(path, abs=1e-6)
    assert (
        0.35 < _length(path) < 0.45 and np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.01
    )


def test_a_traced_path_needs_no_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    places = np.array([[0.0, -0.15, 1.25], [0.05, -0.13, 1.2], [0.1, -0.1, 1.3]])
    model = load_model("hfx-pressure-1")
    with_it, without = (SkinPaths(model.vertices, model.triangles) for _ in range(2))
    expected, shares = with_it.traced(with_it.on_skin(places))
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    path, actual = without.traced(without.on_skin(places))
    assert path == pytest.approx(expected, abs=1e-12) and actual == pytest.approx(shares)
