# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths along the skin near a point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.skin_distance import SkinDistances


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), x=st.floats(0.15, 0.3), y=st.floats(0.15, 0.3))
def test_on_a_flat_patch_the_way_is_straight(seed: int, x: float, y: float) -> None:
    points = np.random.default_rng(seed).uniform(0.0, 0.45, (500, 3)) * [1, 1, 0]
    skin = SkinDistances(points, Delaunay(points[:, :2]).simplices)
    spot = skin.nearest(np.array([x, y, 0.03]))
    vertices, distances = skin.around(spot, 0.1)
    assert spot.point == pytest.approx([x, y, 0.0], abs=1e-12)
    assert spot.weights @ points[spot.corners] == pytest.approx(spot.point)
    straight = np.linalg.norm(points - spot.point, axis=1)
    # Slivers of a random triangulation make a detour now and then.
    assert set(vertices) <= set(np.flatnonzero(straight <= 0.1))
    assert np.median(np.abs(distances - straight[vertices])) < 1e-9
    assert (distances <= 1.05 * straight[vertices] + 1e-9).all()


def test_round_a_tube_the_way_is_the_arc() -> None:
    radius, around, along = 0.05, 40, 30
    angle, height = np.meshgrid(
        np.arange(around) * 2 * np.pi / around, np.arange(along) * 0.008, indexing="ij"
    )
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1).reshape(-1, 3)
    a, b = np.meshgrid(np.arange(around), np.arange(along - 1), indexing="ij")
    corner = [((a + da) % around * along + b + db).ravel() for da, db in ((0, 0), (1, 0), (0, 1))]
    last = ((a + 1) % around * along + b + 1).ravel()
    triangles = np.concatenate([np.stack(corner, 1), np.stack([corner[1], last, corner[2]], 1)])
    skin = SkinDistances(points, triangles)
    vertices, distances = skin.around(skin.nearest(points[along // 2]), 0.14)
    turn = np.arctan2(points[vertices, 1], points[vertices, 0])
    arc = np.hypot(radius * turn, points[vertices, 2] - points[along // 2, 2])
    assert distances == pytest.approx(arc, rel=0.02, abs=1e-6)
    assert len(vertices) > 800 and distances.max() > 0.13


def test_the_way_does_not_jump_from_finger_to_finger() -> None:
    model = load_model("hfx-pressure-1")
    fingers = np.flatnonzero((model.part == PARTS.index("fingers")) & (model.side == 1))
    tip = fingers[np.argmin(model.vertices[fingers, 2])]
    skin = SkinDistances(model.vertices, model.triangles)
    tip_point = model.vertices[tip].astype(np.float64)
    vertices, distances = skin.around(skin.nearest(tip_point), 0.04)
    near = np.flatnonzero(np.linalg.norm(model.vertices - tip_point, axis=1) <= 0.04)
    assert set(vertices) < set(near) and len(near) > 1.2 * len(vertices)
    assert (distances >= np.linalg.norm(model.vertices[vertices] - tip_point, axis=1) - 1e-6).all()


def test_results_do_not_depend_on_earlier_queries() -> None:
    model = load_model("hfx-temperature-1")
    used = SkinDistances(model.vertices, model.triangles)
    for point in ([0.0, 0.1, 1.2], [0.02, 0.1, 1.2], [0.1, 0.1, 1.3], [0.0, 0.1, 1.2]):
        fresh = SkinDistances(model.vertices, model.triangles)
        places = [item.nearest(np.array(point)) for item in (used, fresh)]
        assert (places[0].corners == places[1].corners).all()
        first, second = used.around(places[0], 0.1), fresh.around(places[1], 0.1)
        assert (first[0] == second[0]).all() and first[1] == pytest.approx(second[1], abs=1e-12)
