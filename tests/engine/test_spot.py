# SPDX-License-Identifier: GPL-3.0-or-later
"""Spots on the skin: weights, motion along a path, and the engine's samples."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from skin_plane import plane

from hfx_blender.engine.areas.spot import SpotSkin, half_radius_m, places_on
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SpotArea,
    TimeBase,
)
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

SIDE = 0.02
MODEL = plane(SIDE)
MIDDLE = len(MODEL) // 2
FLAT = Falloff()
PATH = np.array([[-0.05, 0.0, 0.0], [0.05, 0.0, 0.0]])


def test_equal_shares_of_a_path_are_equal_ways() -> None:
    bent = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.1, 0.0]])
    actual = places_on(bent, np.array([-1.0, 0.0, 0.5, 0.75, 0.875, 1.0, 2.0]))
    x, y = [0.0, 0.0, 0.2, 0.3, 0.3, 0.3, 0.3], [0.0, 0.0, 0.0, 0.0, 0.05, 0.1, 0.1]
    assert actual[:, 0] == pytest.approx(x) and actual[:, 1] == pytest.approx(y)
    assert places_on(bent[:1], np.array([0.0, 0.7])) == pytest.approx(bent[[0, 0]])


def test_a_point_on_a_vertex_touches_only_that_vertex() -> None:
    vertices, weights = SpotSkin(MODEL).weights(np.zeros(3), 0.0, FLAT)
    assert vertices.tolist() == [MIDDLE] and weights == pytest.approx([1.0])


def test_a_point_between_two_vertices_has_half_strength_at_each() -> None:
    vertices, weights = SpotSkin(MODEL).weights(np.array([SIDE / 2, 0.0, 0.0]), 0.0, FLAT)
    samples = dict(zip(vertices.tolist(), weights.tolist(), strict=True))
    assert samples[MIDDLE] == pytest.approx(0.5, abs=1e-5)
    assert samples[MIDDLE + 1] == pytest.approx(0.5, abs=1e-5)
    # The other two vertices of the triangle are sqrt(3) / 2 of a side away: 1 - 0.866.
    assert sorted(samples.values())[:2] == pytest.approx([1 - np.sqrt(0.75)] * 2, abs=1e-5)


def test_a_disc_covers_half_of_the_cells_at_its_rim() -> None:
    """Radius of two sides: weight (2 + 0.5 - d) in 0..1, with d in sides."""
    vertices, weights = SpotSkin(MODEL).weights(np.zeros(3), 2 * SIDE, FLAT)
    distance = np.linalg.norm(MODEL.vertices[vertices], axis=1) / SIDE
    assert weights == pytest.approx(np.clip(2.5 - distance, 0.0, 1.0), abs=1e-4)
    assert len(vertices) == 19 and weights[vertices == MIDDLE + 2] == pytest.approx(0.5, abs=1e-4)


def test_a_falloff_is_strongest_in_the_middle() -> None:
    """Linear over the whole radius of four sides: weight (4.5 - d) / 4, at most 1."""
    disc = Falloff(FalloffKind.LINEAR, 1.0)
    vertices, weights = SpotSkin(MODEL).weights(np.zeros(3), 4 * SIDE, disc)
    distance = np.linalg.norm(MODEL.vertices[vertices], axis=1) / SIDE
    inside = distance <= 3.5
    expected = np.minimum((4.5 - distance) / 4.0, 1.0)
    assert weights[inside] == pytest.approx(expected[inside], abs=1e-4)
    assert half_radius_m(0.08, disc) == pytest.approx(0.04)
    assert half_radius_m(0.08, FLAT) == 0.08


def test_a_moving_disc_keeps_its_strength_and_its_middle() -> None:
    skin = SpotSkin(MODEL)
    for x in np.linspace(-0.03, 0.03, 25):
        vertices, weights = skin.weights(np.array([x, 0.004, 0.0]), 0.05, FLAT)
        middle = weights @ MODEL.vertices[vertices] / weights.sum()
        assert middle[:2] == pytest.approx([x, 0.004], abs=1e-3)
        assert weights.sum() == pytest.approx(np.pi * 0.05**2 / MODEL.areas_m2[0], rel=0.06)


def _scene(falloff: Falloff = FLAT) -> SceneDescription:
    area = SpotArea("anna", PATH, falloff)
    effect = EffectDescription("spot", "Spot", "vibration", MODEL.id, area)
    body = BodyDescription("anna", "Anna", SkinBinding(("root",)))
    return SceneDescription(TimeBase(Fraction(25), Fraction(100), 0, 0, 24), (body,), (effect,))


def _block(along: np.ndarray, radius: float = 0.0, level: float = 1.0) -> AnimationBlock:
    count = len(along)
    effect = EffectBlock(
        np.full(count, level),
        np.tile([5.0, 100.0], (count, 1)),
        place=np.stack([along, np.full(count, radius)], axis=1),
    )
    poses = np.tile(np.eye(4)[:3], (count, 1, 1, 1))
    world = np.tile(np.eye(4), (count, 1, 1))
    world[:, 2, 3] = 2.0
    pose = PoseBlock(np.ones(count, bool), world, poses)
    return AnimationBlock(np.arange(count), (effect,), (pose,))


def _load(_: str) -> PerceptualModel:
    return MODEL


def test_the_engine_says_where_the_spot_is_at_each_time() -> None:
    along = np.linspace(0.0, 1.0, 11)
    (run,) = Engine(_scene(), models=_load).evaluate(_block(along, level=0.5))
    assert run.focus is not None
    assert run.focus[:, 0] == pytest.approx(-0.05 + 0.1 * along, abs=1e-7)
    assert run.levels == pytest.approx(0.5) and len(run) == 11
    for sample, x in zip(run, run.focus[:, 0], strict=True):
        nearest = np.argmin(np.linalg.norm(MODEL.vertices - [x, 0, 0], axis=1))
        assert sample.vertices[np.argmax(sample.weights)] == nearest
        assert sample.focus is not None and sample.focus[0] == x


def test_a_resting_spot_has_one_set() -> None:
    (run,) = Engine(_scene(), models=_load).evaluate(_block(np.full(6, 0.5)))
    assert run.sets is not None and run.sets.tolist() == [0] * 6 and len(run.offsets) == 2


def test_the_pose_does_not_matter_to_a_spot_but_is_known_on_demand() -> None:
    engine = Engine(_scene(), models=_load, record=("positions",))
    (run,) = engine.evaluate(_block(np.array([0.5, 0.5])))
    assert run.sets is None and run.positions is not None and len(run.offsets) == 3
    assert run.positions == pytest.approx(MODEL.vertices[run.vertices] + [0, 0, 2], abs=1e-6)


def test_a_nan_position_is_silent_and_reported() -> None:
    engine = Engine(_scene(), models=_load)
    (run,) = engine.evaluate(_block(np.array([0.0, np.nan, 1.0])))
    assert run.indices.tolist() == [0, 2]
    assert any("place or radius" in text for text in engine.counters.warnings)
