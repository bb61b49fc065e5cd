# SPDX-License-Identifier: GPL-3.0-or-later
"""Forces of volumes: textbook formulas by hand, and bodies and volumes in known motion."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from engine_synthetic import BONES, model

from hfx_blender.engine.contact.contact_force import force
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.response_filters.controls import (
    CONTROLS,
    WIDTH,
    ContactLaw,
    Filter,
    FilterKind,
)
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.volume.analytic import Cuboid, Sphere
from hfx_blender.engine.volume.shape import Falloff, Shape

MODEL = model(modality="pressure", seed=1)
ROWS = 5
RADIUS_M = 0.9
LAW = ContactLaw(400.0, 30.0, 0.5)
UP = np.array([[0.0], [0.0], [1.0]])


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 5.0)),  # Hooke: 1000 N/m times 5 mm
        ((0.0, 0.0, -0.1), (0.0, 0.0, 7.0)),  # and 20 N s/m times 0.1 m/s inwards
        ((0.0, 0.0, 0.1), (0.0, 0.0, 3.0)),
        ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),  # leaves faster than the spring follows: no pull
        ((0.2, 0.0, 0.0), (-2.5, 0.0, 5.0)),  # Coulomb: half of the normal force
        ((0.3, -0.4, -0.1), (-2.1, 2.8, 7.0)),
        ((0.0, 0.5e-3, 0.0), (0.0, -1.25, 5.0)),  # half of the sliding speed
    ],
)
def test_a_force_is_that_of_the_textbook(velocity: Any, expected: Any) -> None:
    law = ContactLaw(1000.0, 20.0, 0.5)
    actual = force(law, np.array([0.005]), np.array(velocity)[:, None], UP)
    assert actual[:, 0] == pytest.approx(expected, abs=1e-12)


def evaluated(
    matrices: Any,
    *,
    body_step: Any = (0.0, 0.0, 0.0),
    shape: Shape | None = None,
    law: ContactLaw | None = LAW,
    cuts: tuple[int, ...] = (0, ROWS),
    filters: tuple[Filter, ...] = (),
    levels: Any = 1.0,
) -> list[SampleRun]:
    """Runs of a volume and a rigid body that moves by ``body_step`` a row, cut into blocks with a
    row of history."""
    area = HapticVolume(Falloff(), filters, law)
    effect = EffectDescription("wall", "Wall", "pressure", MODEL.id, area)
    scene = SceneDescription(
        TimeBase(Fraction(24), Fraction(100), 1, 1, 48),
        (BodyDescription("anna", "Anna", SkinBinding(BONES)),),
        (effect,),
    )
    engine = Engine(scene, models=lambda _: MODEL, tolerance=PAPER)
    runs = []
    for first, stop in pairwise(cuts):
        rows = np.arange(max(first - 1, 0), stop)
        to_world = np.tile(np.eye(4), (len(rows), 1, 1))
        to_world[:, :3, 3] = rows[:, None] * np.array(body_step)
        bones = np.tile(np.eye(4)[:3], (len(rows), len(BONES), 1, 1))
        controls = np.tile([_defaults(item) for item in filters], (len(rows), 1, 1))
        block = EffectBlock(
            np.broadcast_to(np.asarray(levels, float), ROWS)[rows],
            np.full((len(rows), 1), 7.0),
            np.asarray(matrices)[rows],
            (shape or Sphere(),),
            response=controls if filters else None,
        )
        pose = PoseBlock(np.ones(len(rows), bool), to_world, bones)
        animation = AnimationBlock(20 + rows, (block,), (pose,), history=int(first > 0))
        runs += engine.evaluate(animation)
    return runs


def _defaults(item: Filter) -> list[float]:
    values = [control.default for control in CONTROLS[item.kind]]
    return values + [0.0] * (WIDTH - len(values))


def balls(step: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrices = np.tile(np.diag([RADIUS_M] * 3 + [1.0]), (ROWS, 1, 1))
    matrices[:, :3, 3] = [0.0, 0.0, 1.0] + np.arange(ROWS)[:, None] * np.array(step)
    return matrices


def expected_in_a_ball(positions: np.ndarray, centre: Any, velocity: Any) -> np.ndarray:
    """Kelvin-Voigt and Coulomb at each position, written out vector by vector."""
    forces = []
    for place in positions:
        arm = place - centre
        normal = arm / np.linalg.norm(arm)
        depth, outward = RADIUS_M - np.linalg.norm(arm), np.dot(velocity, normal)
        pushed = max(0.0, LAW.stiffness_n_m * depth - LAW.damping_n_s_m * outward)
        slide = velocity - outward * normal
        speed = np.linalg.norm(slide)
        friction = LAW.friction * pushed * slide / speed if speed > 1e-3 else np.zeros(3)
        forces.append(pushed * normal - friction)
    return np.array(forces)


@pytest.mark.parametrize(
    ("body_step", "ball_step"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.01, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.004, 0.0, -0.002), (0.004, 0.0, -0.002)),
        ((0.0, 0.003, 0.0), (0.0, 0.0, 0.005)),
    ],
)
def test_a_ball_pushes_by_depth_speed_and_friction(body_step: Any, ball_step: Any) -> None:
    (run,) = evaluated(balls(ball_step), body_step=body_step)
    relative = 100.0 * (np.array(body_step) - np.array(ball_step))  # 100 rows a second
    assert len(run) == ROWS and run.sets is None
    for k, sample in enumerate(run):
        positions = MODEL.vertices[sample.vertices] + k * np.array(body_step)
        centre = [0.0, 0.0, 1.0] + k * np.array(ball_step)
        # The first row has no row before: no speed.
        velocity = relative if k else np.zeros(3)
        expected = expected_in_a_ball(positions, centre, velocity)
        assert sample.forces_n == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_a_turning_volume_drags_the_skin_along() -> None:
    """A box that turns about Z at 1 rad/s: friction is along omega x r."""
    matrices = np.tile(np.eye(4), (ROWS, 1, 1))
    for k in range(ROWS):
        cosine, sine = np.cos(0.01 * k), np.sin(0.01 * k)
        matrices[k, :2, :2] = [[cosine, -sine], [sine, cosine]]
    matrices[:, :3, :3] *= 3.0
    (run,) = evaluated(matrices, shape=Cuboid(), law=ContactLaw(400.0, 0.0, 0.5))
    sample = list(run)[2]
    places = MODEL.vertices[sample.vertices].astype(float)
    carried = np.cross([0.0, 0.0, 1.0], places)
    # Only faces across Z: there the motion is along the face.
    forces = sample.forces_n.astype(float)
    is_cap = np.abs(forces[:, 2]) > 1e-6
    assert is_cap.any()
    speeds = np.linalg.norm(carried[is_cap], axis=1, keepdims=True)
    pushed = np.abs(forces[is_cap, 2:])
    expected = 0.5 * pushed * carried[is_cap] / speeds
    # A backward difference is behind by half a step of 0.01 rad.
    np.testing.assert_allclose(forces[is_cap, :2], expected[:, :2], atol=0.01 * pushed.max())


def test_forces_do_not_depend_on_the_cut_into_blocks() -> None:
    whole = evaluated(balls((0.0, 0.0, 0.01)), body_step=(0.002, 0.0, 0.0))
    parts = evaluated(balls((0.0, 0.0, 0.01)), body_step=(0.002, 0.0, 0.0), cuts=(0, 2, ROWS))
    assert len(parts) == 2
    joined = np.concatenate([run.forces_n for run in parts])
    assert joined.tolist() == whole[0].forces_n.tolist()


def test_a_force_fades_with_the_clip_and_starts_without_speed() -> None:
    levels = [0.0, 0.25, 1.0, 1.0, 1.0]
    (run,) = evaluated(balls(), body_step=(0.01, 0.0, 0.0), levels=levels)
    first, second = list(run)[:2]
    expected = expected_in_a_ball(
        MODEL.vertices[first.vertices] + [0.01, 0.0, 0.0], [0.0, 0.0, 1.0], np.zeros(3)
    )
    assert first.forces_n == pytest.approx(0.25 * expected, abs=2e-2)
    assert np.abs(second.forces_n[:, 0]).max() > 0.0


def test_a_volume_without_a_law_has_no_forces_and_shares_its_sets() -> None:
    (run,) = evaluated(balls(), law=None)
    assert run.forces_n is None and run.sets is not None
    (lawful,) = evaluated(balls())
    assert [s.vertices.tolist() for s in run] == [s.vertices.tolist() for s in lawful]


def test_a_contact_response_keeps_the_forces() -> None:
    item = Filter(FilterKind.SPEED)
    (run,) = evaluated(balls(), body_step=(0.01, 0.0, 0.0), filters=(item,))
    (plain,) = evaluated(balls(), body_step=(0.01, 0.0, 0.0))
    by_index = {int(i): s for i, s in zip(plain.indices, plain, strict=True)}
    assert len(run) > 1
    for index, sample in zip(run.indices, run, strict=True):
        known = by_index[int(index)]
        chosen = np.isin(known.vertices, sample.vertices)
        assert sample.forces_n.tolist() == known.forces_n[chosen].tolist()
