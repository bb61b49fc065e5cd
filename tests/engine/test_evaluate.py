# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine on synthetic scenes: output, warnings, and unused data."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from engine_synthetic import BONES, model, pose, skinned

from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.shape import Falloff

TIMES = 5
RADIUS_M = 0.9
MODELS = {f"test-{m}": model(modality=m, seed=k) for k, m in enumerate(("vibration", "pressure"))}
IDS = np.array([2, 5, 9], np.int32)
SHARES = np.array([0.5, 1.0, 0.25], np.float32)


def _painted(name: str = "paint", body: str = "anna") -> EffectDescription:
    area = PaintedArea(body, IDS, SHARES)
    return EffectDescription(name, name, "vibration", "test-vibration", area)


def _ball(name: str = "ball", modality: str = "pressure") -> EffectDescription:
    return EffectDescription(name, name, modality, f"test-{modality}", HapticVolume(Falloff()))


def _scene(*effects: EffectDescription, bodies: tuple[str, ...] = ("anna",)) -> SceneDescription:
    return SceneDescription(
        TimeBase(Fraction(24), Fraction(100), 1, 1, 48),
        tuple(BodyDescription(body, body.title(), SkinBinding(BONES)) for body in bodies),
        effects,
    )


def _animated(effect: EffectDescription, levels: Any = 1.0, value: float = 7.0) -> EffectBlock:
    count = 2 if effect.modality == "vibration" else 1
    levels = np.broadcast_to(np.asarray(levels, float), TIMES).copy()
    parameters = np.full((TIMES, count), value)
    if effect.kind == "painted":
        return EffectBlock(levels, parameters)
    matrices = np.tile(np.diag([RADIUS_M] * 3 + [1.0]), (TIMES, 1, 1))
    matrices[:, 2, 3] = 1.0 + 0.05 * np.arange(TIMES)
    return EffectBlock(levels, parameters, matrices, (Sphere(),))


def _block(effects: list[EffectBlock], *poses: PoseBlock, history: int = 0) -> AnimationBlock:
    return AnimationBlock(np.arange(20, 20 + TIMES), tuple(effects), poses, history)


class _Loader:
    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, model_id: str) -> PerceptualModel:
        self.asked.append(model_id)
        return MODELS[model_id]


def test_a_painted_effect_yields_its_area() -> None:
    effect, loader = _painted(), _Loader()
    engine = Engine(_scene(effect), models=loader)
    levels = [0.0, 0.5, 1.0, 0.0, 0.25]
    unread = PoseBlock(np.zeros(TIMES, bool), np.zeros((TIMES, 4, 4)))
    (run,) = engine.evaluate(_block([_animated(effect, levels)], unread))
    assert run.stream.effect_id == "paint" and run.stream.body_id == "anna"
    assert run.indices.tolist() == [21, 22, 24]
    assert run.times_s.tolist() == [0.21, 0.22, 0.24]
    assert run.levels.tolist() == [0.5, 1.0, 0.25]
    for sample in run:
        assert sample.vertices.tolist() == IDS.tolist()
        assert sample.weights.tolist() == SHARES.tolist()
        assert sample.parameters.tolist() == [7.0, 7.0]
    assert len(run.vertices) == len(IDS), "a set that stays is held once"
    assert loader.asked == [] and engine.counters.vertices_posed == 0
    assert engine.counters.contacts == 3 * len(IDS)
    assert (engine.counters.times_evaluated, engine.counters.times_skipped) == (3, 2)


def test_a_volume_touches_every_body_at_its_position() -> None:
    effect, loader = _ball(), _Loader()
    poses = [pose(TIMES, seed=2), pose(TIMES, seed=3)]
    engine = Engine(_scene(effect, bodies=("anna", "bert")), models=loader, tolerance=PAPER)
    runs = engine.evaluate(_block([_animated(effect)], *poses))
    assert [run.stream.body_id for run in runs] == ["anna", "bert"]
    assert loader.asked == ["test-pressure"], "one model, loaded once, for both"
    matrices = _animated(effect).matrices
    for run, posed in zip(runs, poses, strict=True):
        actual = {index - 20: sample for index, sample in zip(run.indices, run, strict=True)}
        for row in range(TIMES):
            world = skinned(MODELS["test-pressure"], posed, row)
            inside = np.linalg.norm(world - matrices[row, :3, 3], axis=1) <= RADIUS_M
            vertices = actual[row].vertices.tolist() if row in actual else []
            assert vertices == np.flatnonzero(inside).tolist()
        assert len(run) >= 3


def test_models_are_loaded_at_the_first_need() -> None:
    effects, loader = [_ball("a", "vibration"), _ball("b", "pressure")], _Loader()
    engine = Engine(_scene(*effects), models=loader)
    engine.evaluate(_block([_animated(effects[0]), _animated(effects[1], 0.0)], pose(TIMES)))
    assert loader.asked == engine.counters.models_loaded == ["test-vibration"]
    engine.evaluate(_block([_animated(effects[0]), _animated(effects[1])], pose(TIMES)))
    assert loader.asked == ["test-vibration", "test-pressure"]


def test_values_that_are_not_numbers_are_silent_and_counted() -> None:
    effect, loader = _painted(), _Loader()
    engine = Engine(_scene(effect), models=loader)
    animated = _animated(effect, [np.nan, 1.0, 1.0, np.inf, 1.0])
    animated.parameters[1, 0] = np.nan
    (run,) = engine.evaluate(_block([animated], pose(TIMES)))
    assert run.indices.tolist() == [22, 24]
    ((message, count),) = engine.counters.warnings.items()
    assert "'paint'" in message and count == 3
    engine.evaluate(_block([animated], pose(TIMES)))
    assert engine.counters.warnings == {message: 6}, "one message, counted on"


@pytest.mark.parametrize("where", ["bones", "to_world", "valid"])
def test_a_body_without_a_pose_feels_no_volume(where: str) -> None:
    effects, posed = [_ball(), _painted()], pose(TIMES)
    if where == "valid":
        posed.valid[1] = False
    else:
        getattr(posed, where)[1] = np.nan
    engine = Engine(_scene(*effects), models=_Loader())
    ball, painted = engine.evaluate(_block([_animated(e) for e in effects], posed))
    assert ball.indices.tolist() == [20, 22, 23, 24]
    assert painted.indices.tolist() == [20, 21, 22, 23, 24]
    if where == "valid":
        assert not engine.counters.warnings, "a body that is disabled there is no fault"
        return
    ((message, count),) = engine.counters.warnings.items()
    assert "'Anna'" in message and count == 1


def test_levels_and_parameters_stay_in_their_ranges() -> None:
    effect = _painted()
    engine = Engine(_scene(effect), models=_Loader())
    (run,) = engine.evaluate(_block([_animated(effect, 3.0, 1e9)], pose(TIMES)))
    assert set(run.levels.tolist()) == {1.0}
    assert run.parameters.tolist() == [[1000.0, 1000.0]] * TIMES
    (run,) = engine.evaluate(_block([_animated(effect, 1.0, -1e9)], pose(TIMES)))
    assert run.parameters.tolist() == [[0.0, 0.1]] * TIMES
    assert engine.evaluate(_block([_animated(effect, -1.0)], pose(TIMES))) == []


def _moving() -> PoseBlock:
    """Return poses of a rigid body moving at 3 m/s along X."""
    to_world = np.tile(np.eye(4), (TIMES, 1, 1))
    to_world[:, 0, 3] = 0.03 * np.arange(TIMES)
    bones = np.tile(np.eye(4)[:3], (TIMES, len(BONES), 1, 1))
    return PoseBlock(np.ones(TIMES, bool), to_world, bones)


def test_motion_of_touched_vertices() -> None:
    effects = [_painted(), _ball()]
    engine = Engine(_scene(*effects), record=("positions", "velocities"), models=_Loader())
    runs = engine.evaluate(_block([_animated(e) for e in effects], _moving(), history=1))
    for run in runs:
        assert run.indices.tolist() == [21, 22, 23, 24], "the history is not felt again"
        rest = MODELS[run.stream.model_id].vertices
        for k, sample in enumerate(run):
            expected = rest[sample.vertices] + np.array([0.03 * (k + 1), 0.0, 0.0])
            assert np.abs(sample.positions - expected).max() < 1e-6
            assert np.abs(sample.velocities - [3.0, 0.0, 0.0]).max() < 1e-5
            assert sample.depth_m is None


def test_motion_of_painted_vertices_needs_poses() -> None:
    effect, posed = _painted(), _moving()
    posed.valid[2] = False
    engine = Engine(_scene(effect), record=("positions",), models=_Loader())
    with pytest.raises(ValueError, match="with_positions"):
        engine.evaluate(_block([_animated(effect)], posed))


def test_velocities_are_central_where_both_neighbours_are_known() -> None:
    """x = t^2 every 10 ms: 2 t in the middle, one-sided at both ends of the known rows."""
    effect, posed = _painted(), _moving()
    times = 0.01 * np.arange(TIMES)
    posed.to_world[:, 0, 3] = times**2
    engine = Engine(_scene(effect), record=("velocities",), models=_Loader())
    (run,) = engine.evaluate(_block([_animated(effect)], posed))
    speeds = [float(np.median(sample.velocities[:, 0])) for sample in run]
    ends = [0.01, 2 * times[-1] - 0.01]
    assert speeds == pytest.approx([ends[0], *(2 * times[1:-1]), ends[1]], abs=1e-4)
    cut = replace(_block([_animated(effect)], posed, history=1), future=1)
    (run,) = engine.evaluate(cut)
    assert run.indices.tolist() == cut.own_indices.tolist() == [21, 22, 23]
    speeds = [float(np.median(sample.velocities[:, 0])) for sample in run]
    assert speeds == pytest.approx(2 * times[1:-1], abs=1e-4)


def test_a_sample_without_neighbours_has_no_velocity() -> None:
    """After a gap, or next to a NaN pose."""
    effect, posed = _painted(), _moving()
    posed.to_world[3, 0, 3] = np.nan
    block = AnimationBlock(np.array([20, 21, 30, 31, 32]), (_animated(effect),), (posed,))
    engine = Engine(_scene(effect), record=("velocities",), models=_Loader())
    (run,) = engine.evaluate(block)
    assert run.indices.tolist() == [20, 21, 30, 32]
    speeds = [float(np.abs(sample.velocities).max()) for sample in run]
    assert speeds == pytest.approx([3.0, 3.0, 0.0, 0.0], abs=1e-5)
    assert run.positions is None


def test_depth_in_a_ball() -> None:
    effect = _ball()
    engine = Engine(_scene(effect), record=("depth",), models=_Loader(), tolerance=PAPER)
    animated, posed = _animated(effect), pose(TIMES)
    (run,) = engine.evaluate(_block([animated], posed))
    assert run.positions is None and run.velocities is None
    for index, sample in zip(run.indices, run, strict=True):
        world = skinned(MODELS["test-pressure"], posed, index - 20)[sample.vertices]
        expected = RADIUS_M - np.linalg.norm(world - animated.matrices[index - 20, :3, 3], axis=1)
        assert np.abs(sample.depth_m - expected).max() < 1e-6


def test_blocks_may_be_cut_anywhere() -> None:
    effects, posed = [_painted(), _ball()], pose(TIMES)
    animated = [_animated(e) for e in effects]
    engine = Engine(_scene(*effects), models=_Loader(), tolerance=PAPER)
    whole = engine.evaluate(_block(animated, posed))
    engine = Engine(_scene(*effects), models=_Loader(), tolerance=PAPER)
    pieces = []
    for part in (slice(0, 2), slice(2, 5)):
        cut = [
            EffectBlock(
                e.levels[part],
                e.parameters[part],
                None if e.matrices is None else e.matrices[part],
                e.shapes,
            )
            for e in animated
        ]
        piece = PoseBlock(posed.valid[part], posed.to_world[part], posed.bones[part])
        pieces.append(
            engine.evaluate(AnimationBlock(np.arange(20, 25)[part], tuple(cut), (piece,)))
        )
    for k, run in enumerate(whole):
        samples = [sample for piece in pieces for sample in piece[k]]
        for one, two in zip(run, samples, strict=True):
            assert one.time_s == two.time_s
            assert one.vertices.tolist() == two.vertices.tolist()
            assert one.weights.tolist() == two.weights.tolist()


def test_an_unknown_column_is_a_programming_error() -> None:
    with pytest.raises(ValueError, match="record"):
        Engine(_scene(_painted()), record=("colour",))
