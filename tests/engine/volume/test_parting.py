# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that a separating plane parts from a volume are all outside of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.parting import parted
from hfx_blender.engine.volume.shape import Shape

_WEDGE = MeshVolume(
    np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 2.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32),
    "wedge",
)
SHAPES = (Cuboid(), Sphere(), Cylinder(), Capsule(0.0), Capsule(1.5), _WEDGE)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(SHAPES),
    st.integers(0, 2**32 - 1),
    st.sampled_from([2, 3, 6]),
    st.floats(0.01, 3.0),
    st.floats(0.0, 0.3),
)
def test_nothing_of_a_hull_that_is_parted_is_inside(
    shape: Shape, seed: int, count: int, size: float, margin: float
) -> None:
    rng = np.random.default_rng(seed)
    middles = rng.normal(size=(3, 400)) * 2.0
    corners = [middles + size * rng.normal(size=(3, 400)) for _ in range(count)]
    apart = parted(shape, corners, np.full(400, margin))
    shares = rng.dirichlet(np.full(count, 0.5), (64, 400)).transpose(2, 0, 1)
    places = sum(
        share * corner[:, None] for share, corner in zip(shares, corners, strict=True)
    )  # (3, 64, 400)
    out = rng.normal(size=(3, 64, 400))
    out *= margin / np.sqrt(np.square(out).sum(axis=0))
    inside = shape.contains((places + out).reshape(3, -1)).reshape(64, 400)
    assert not inside[:, apart].any()


@pytest.mark.parametrize(
    "shape, place",
    [
        (Cuboid(), (1.2, 1.2, 1.2)),
        (Sphere(), (0.7, 0.7, 0.7)),
        (Cylinder(), (0.8, 0.8, 0.0)),
        (Cylinder(), (0.8, 0.8, 1.2)),
        (Capsule(1.0), (0.6, 0.6, 1.6)),
        (Capsule(1.0), (0.8, 0.8, 0.5)),
    ],
)
def test_small_hulls_beside_edges_and_round_sides_are_parted(
    shape: Shape, place: tuple[float, float, float]
) -> None:
    corners = [np.array(place)[:, None] + 0.01 * np.eye(3)[:, [k]] for k in range(3)]
    assert parted(shape, corners, np.zeros(1)).all()
    assert not parted(shape, corners, np.full(1, 0.5)).any()  # too near for that


@pytest.mark.parametrize("shape", SHAPES)
def test_what_reaches_into_a_volume_or_is_no_number_is_not_parted(shape: Shape) -> None:
    inside = shape.bounds.mean(axis=0)[:, None]
    far = np.full((3, 1), 50.0)
    assert not parted(shape, [inside, far, far], np.zeros(1)).any()
    assert not parted(shape, [inside, inside, inside], np.zeros(1)).any()
    assert parted(shape, [far, far, far], np.zeros(1)).all()
    for broken in (np.nan, np.inf):
        assert not parted(shape, [far, far, np.full((3, 1), broken)], np.zeros(1)).any()
