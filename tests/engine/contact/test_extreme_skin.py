# SPDX-License-Identifier: GPL-3.0-or-later
"""Covered skin at the extremes: far away, tiny, huge, stretched, flat, broken, tiny bodies."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from coverage_synthetic import _skin, ball, evaluated, moved_along, placed, rigid, sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.tolerance import EXACT, PREVIEW, STANDARD
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

SHAPES = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "capsule": Capsule(0.75),
}
TOLERANCES = {"preview": PREVIEW, "standard": STANDARD, "exact": EXACT}
FALLOFFS = (Falloff(), Falloff(FalloffKind.SMOOTH, 1.0), Falloff(FalloffKind.LINEAR, 0.3))
LARGEST = float(np.finfo(np.float32).max)
BALL = ball(0.1, 2)
PLACE = (0.06, 0.03, 0.05)


def turn(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("falloff", FALLOFFS, ids=lambda f: f.kind.value)
@pytest.mark.parametrize("tolerance", TOLERANCES.values(), ids=TOLERANCES)
@settings(max_examples=4, deadline=None)
@given(
    name=st.sampled_from(list(SHAPES)),
    distance=st.floats(-6.0, 7.0),
    scale=st.floats(-6.0, 6.0),
    mirrored=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_coverage_is_independent_of_position_and_size(
    tolerance, falloff, name, distance, scale, mirrored, seed
):
    """Body and volume have the same parent matrix."""
    around = placed((0.05, 0.04, 0.06), PLACE, turn(seed))
    options = {"tolerance": tolerance, "falloff": falloff}
    here, _, _ = evaluated(BALL, SHAPES[name], around[None], **options)
    size, away = 10.0**scale, 10.0**distance
    parent = placed(size, away * turn(seed + 1)[0], turn(seed + 2))
    if mirrored:
        parent[:3, 0] *= -1.0
    there, _, engine = evaluated(
        BALL, SHAPES[name], (parent @ around)[None], posed=rigid(1, parent), **options
    )
    assert engine.counters.warnings == engine.counters.flattened == {} and here.any()
    # Positions are exact to 1e-16 of the distance: judged are bodies within that bound, or near.
    if away * 1e-16 < 1e-8 * size:
        assert np.abs(there - here).max() < 0.05
        assert np.abs(there - here).mean() < 1e-3


KINDS = {
    "sheared": np.array([[1.0, 1.5, -0.7], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]),
    "mirrored": np.diag([-1.0, 1.0, 1.0]),
    "turned inside out": -np.eye(3),
    "240 to 1": np.diag([24.0, 0.1, 0.1]),
    "1 to 240": np.diag([24.0, 24.0, 0.1]),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("of", ["volume", "body"])
def test_cells_away_from_the_boundary_are_wholly_inside_or_outside(of, name, kind):
    """Interior vertices, by position alone, have all neighbours on the same side."""
    shape, linear = SHAPES[name], turn(3) @ KINDS[kind]
    skin = sheet(24)
    around, to_world = placed(0.08, (0.01, 0.02, 0.0), turn(4)), np.eye(4)
    if of == "volume":
        around[:3, :3] = 0.08 * linear
    else:
        to_world[:3, :3] = linear
    weights, _, _ = evaluated(skin, shape, around[None], posed=rigid(1, to_world))
    points = to_world[:3, :3] @ skin.vertices.T.astype(float)
    inside = shape.contains(np.linalg.inv(around)[:3] @ np.vstack([points, np.ones(len(skin))]))
    ends = skin.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ends = np.concatenate([ends, ends[:, ::-1]])
    count = np.bincount(ends[:, 0], minlength=len(skin))
    around_it = np.bincount(ends[:, 0], inside[ends[:, 1]], len(skin))
    deep = inside & (around_it == count)
    assert (weights[0, deep] > 0.999).all()
    # A volume may be thinner than the sheet's triangles: only then outer cells have contacts.
    if kind in ("mirrored", "turned inside out", "sheared"):
        outer = ~inside & (around_it == 0)
        assert outer.any() and (weights[0, outer] < 0.25).all()
    assert weights.any() and not weights.all()


@pytest.mark.parametrize("tolerance", TOLERANCES.values(), ids=TOLERANCES)
@pytest.mark.parametrize("where", ["levels", "matrices", "to_world", "bones"])
@settings(max_examples=5, deadline=None)
@given(
    value=st.sampled_from((np.nan, np.inf, -np.inf, LARGEST, -LARGEST)),
    row=st.integers(0, 5),
    entry=st.integers(0, 11),
    falloff=st.sampled_from(FALLOFFS),
    speed=st.sampled_from([0.0, 0.05, 3.0]),
    record=st.sampled_from([(), ("positions", "velocities", "depth", "surface", "impact")]),
)
def test_one_value_that_is_no_number_is_silent_at_its_own_time(
    where, tolerance, value, row, entry, falloff, speed, record
):
    """The next sample has no motion history; all other samples are unchanged."""
    matrices = moved_along(placed(0.05, PLACE), (0.0, speed, 0.0), 6)
    poses, levels = rigid(6), np.ones(6)
    options = {"tolerance": tolerance, "falloff": falloff, "record": record}
    sound, _, _ = evaluated(BALL, Sphere(), matrices, posed=poses, levels=levels, **options)
    broken = {
        "levels": levels,
        "matrices": matrices,
        "to_world": poses.to_world,
        "bones": poses.bones,
    }[where]
    flat = broken[row : row + 1].reshape(-1)
    flat[entry % flat.size] = value
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        actual, runs, engine = evaluated(
            BALL, Sphere(), matrices, posed=poses, levels=levels, **options
        )
    others = np.setdiff1d(np.arange(6), [row, row + 1])
    np.testing.assert_array_equal(actual[others], sound[others])
    if not np.isfinite(value):
        assert not actual[row].any()
        counters = engine.counters
        assert [*counters.warnings.values(), *counters.flattened.values()] == [1]
    for run in runs:
        for column in (run.weights, run.positions, run.velocities, run.depth_m, run.surface):
            assert column is None or np.isfinite(column).all()


FLAT = {
    "zero": np.zeros((3, 3)),
    "a plane": np.diag([1.0, 1.0, 0.0]),
    "a line": np.diag([0.0, 1.0, 0.0]),
    "nearly a plane": np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1e-9]]),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("tolerance", TOLERANCES.values(), ids=TOLERANCES)
@pytest.mark.parametrize("kind", FLAT)
def test_flat_volumes_are_silent_and_flat_skin_is_where_its_vertices_are(kind, tolerance):
    around = placed(0.08, (0.0, 0.0, 0.0))
    matrices = np.stack([around, around])
    matrices[1, :3, :3] = 0.08 * turn(6) @ FLAT[kind]
    weights, _, engine = evaluated(BALL, Sphere(), matrices, tolerance=tolerance)
    assert not weights.any(), "the ball is inside the skin"
    assert list(engine.counters.flattened.values()) == [1]
    body = np.eye(4)
    body[:3, :3] = turn(7) @ FLAT[kind]
    for falloff in FALLOFFS:
        weights, _, engine = evaluated(
            BALL, Sphere(), around[None], tolerance=tolerance, falloff=falloff, posed=rigid(1, body)
        )
        length = np.linalg.norm(BALL.vertices @ body[:3, :3].T, axis=1)
        assert list(engine.counters.warnings.values()) == ([1] if kind == "zero" else [])
        assert (weights[0, length < 0.05] > 0.0).all()
        assert not weights[0, length > 0.16].any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("tolerance", TOLERANCES.values(), ids=TOLERANCES)
@pytest.mark.parametrize("falloff", FALLOFFS, ids=lambda f: f.kind.value)
@pytest.mark.parametrize("side_m", [0.0, 1e-9, 0.01, 1e3])
def test_a_body_of_three_vertices_and_one_triangle(side_m, falloff, tolerance):
    corners = side_m * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    body = _skin(corners, np.array([[0, 1, 2]]), np.tile([0.0, 0.0, 1.0], (3, 1)))
    matrices = np.stack([placed(10.0 * max(side_m, 0.1), 0.0), placed(0.05, (0.0, 0.0, 9e3))])
    weights, _, engine = evaluated(body, Sphere(), matrices, tolerance=tolerance, falloff=falloff)
    assert (weights[0] > 0.5).all() and not weights[1].any()
    assert engine.counters.warnings == engine.counters.flattened == {}


def test_a_body_of_200_000_vertices_of_skin():
    body = sheet(446)
    assert 198_000 < len(body) < 200_000
    weights, _, engine = evaluated(body, Sphere(), placed(0.01, (0.02, 0.03, 0.0))[None])
    area = float(weights[0] @ body.areas_m2.astype(float))
    assert area == pytest.approx(np.pi * 1e-4, rel=0.01)
    assert engine.counters.vertices_posed < 20_000, "only what the volume can reach"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("falloff", FALLOFFS, ids=lambda f: f.kind.value)
def test_skin_that_has_no_area_at_all(falloff):
    """All vertices at one point, with zero normals and areas."""
    body = replace(
        BALL,
        vertices=np.zeros_like(BALL.vertices),
        normals=np.zeros_like(BALL.normals),
        areas_m2=np.zeros_like(BALL.areas_m2),
    )
    weights, _, _ = evaluated(body, Sphere(), placed(0.05, (0.0, 0.0, 0.0))[None], falloff=falloff)
    assert (weights == 1.0).all()
