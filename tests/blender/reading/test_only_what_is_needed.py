# SPDX-License-Identifier: GPL-3.0-or-later
"""A model is loaded, a body posed and a frame evaluated only for an active effect."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.body import model as body_model
from hfx_blender.reading.stepped import stepping

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")


@pytest.fixture
def body(scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 1, 24
    body = oracle.add_avatar()
    oracle.add_walk(body, [(0, 0, 0), (0, -0.5, 0)], 1, 24)
    return body


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list of stems of perceptual model files, appended at each read after this call."""
    names: list[str] = []
    real = body_model.load

    def load(kind: Any, path: Path) -> Any:
        if kind is body_model.PerceptualModel:
            names.append(path.stem)
        return real(kind, path)

    monkeypatch.setattr(body_model, "load", load)
    body_model.load_model.cache_clear()
    return names


@pytest.fixture
def frames_set(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Frames evaluated from now on."""
    frames: list[float] = []
    real = stepping.Stepper.set_frame

    def set_frame(self: stepping.Stepper, frame: Any) -> None:
        frames.append(float(frame))
        real(self, frame)

    monkeypatch.setattr(stepping.Stepper, "set_frame", set_frame)
    return frames


def _blocks_have_poses(reader: Any) -> bool:
    return any(pose.valid.any() for block in reader.blocks() for pose in block.poses)


def test_vibration_alone_loads_nothing_else(body: Any, loaded: list[str]) -> None:
    oracle.add_volume("Ball", "vibration", "SPHERE", (0.0, 0.0, 1.0), radius=0.3)
    evaluation = oracle.evaluate(bpy.context.scene)
    assert evaluation.samples["Ball"]
    assert loaded == ["vibration"]
    assert evaluation.counters.models_loaded == ["hfx-vibration-1"]


def test_wind_is_felt_on_the_pressure_model(body: Any, loaded: list[str]) -> None:
    oracle.add_volume("Gust", "wind", "CUBOID", (0.0, 0.0, 1.0))
    assert oracle.evaluate(bpy.context.scene).samples["Gust"]
    assert loaded == ["pressure"]


def test_an_effect_that_is_off_costs_nothing(
    body: Any, loaded: list[str], frames_set: list[float]
) -> None:
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (0.0, 0.0, 1.0))
    oracle.add_clip(ball, 3, 8).mute = True
    evaluation = oracle.evaluate(bpy.context.scene)
    assert (loaded, frames_set, evaluation.samples) == ([], [], {})
    assert evaluation.counters.as_dict() == type(evaluation.counters)().as_dict()


def test_an_effect_whose_curve_is_zero_costs_nothing(
    body: Any, loaded: list[str], frames_set: list[float]
) -> None:
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (0.0, 0.0, 1.0))
    oracle.key(ball, "hfx.activation", [(1, 0.0), (24, 0.0)])
    evaluation = oracle.evaluate(bpy.context.scene)
    counters = evaluation.counters
    assert (loaded, frames_set, evaluation.samples) == ([], [], {})
    assert counters.as_dict() == type(counters)().as_dict()


def test_only_the_times_are_posed_at_which_a_curve_is_not_zero(body: Any) -> None:
    """Also if unclear from the keys alone: between keys a sample is 0."""
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.0))
    oracle.key(ball, "hfx.activation", [(5, 0.0), (9, 1.0), (13, 0.0), (20, 0.0)])
    for point in compat.fcurves(ball)[0].keyframe_points:
        point.interpolation = "LINEAR"
    reader = oracle.evaluate(bpy.context.scene, rate_hz=24).reader
    assert reader.sample_indices.tolist() == list(range(4, 13))
    posed = [
        index
        for block in reader.blocks()
        for index, valid in zip(block.indices.tolist(), block.poses[0].valid, strict=True)
        if valid
    ]
    assert posed == list(range(5, 12))


def test_frames_outside_clips_are_not_evaluated(body: Any, frames_set: list[float]) -> None:
    ball = oracle.add_volume("Ball", "vibration", "SPHERE", (0.0, 0.0, 1.0))
    oracle.add_clip(ball, 5, 8)
    oracle.add_clip(ball, 15, 16)
    evaluation = oracle.evaluate(bpy.context.scene, rate_hz=24)
    assert sorted(evaluation.samples["Ball"]) == [4, 5, 6, 7, 14, 15]
    assert set(frames_set) <= {5.0, 6.0, 7.0, 8.0, 15.0, 16.0}
    assert evaluation.counters.times_evaluated == 6


def test_painted_effects_pose_nothing(body: Any) -> None:
    oracle.add_painted("Felt", "pressure", body)
    evaluation = oracle.evaluate(bpy.context.scene)
    counters = evaluation.counters
    assert len(evaluation.samples["Felt"]) == evaluation.reader.time.sample_count
    assert (counters.models_loaded, counters.vertices_posed, counters.volume_tests) == ([], 0, 0)
    assert not _blocks_have_poses(evaluation.reader)


def test_a_painted_effect_beside_a_clip_of_a_volume(body: Any) -> None:
    """Only the volume's times are posed."""
    oracle.add_painted("Felt", "pressure", body)
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.0))
    oracle.add_clip(ball, 5, 8)
    reader = oracle.evaluate(bpy.context.scene, rate_hz=24).reader
    posed = [
        index
        for block in reader.blocks()
        for index, valid in zip(block.indices.tolist(), block.poses[0].valid, strict=True)
        if valid
    ]
    assert posed == [4, 5, 6, 7]


def test_a_volume_far_away_poses_no_vertex(body: Any) -> None:
    oracle.add_volume("Far", "vibration", "SPHERE", (40.0, 0.0, 1.0), radius=2.0)
    evaluation = oracle.evaluate(bpy.context.scene)
    counters = evaluation.counters
    assert counters.volume_tests == evaluation.reader.time.sample_count
    assert (counters.vertices_posed, counters.contacts, evaluation.samples) == (0, 0, {})


def test_a_small_volume_poses_its_neighbourhood(body: Any) -> None:
    oracle.add_volume("Coin", "vibration", "SPHERE", (0.0, -0.1, 1.3), radius=0.02)
    evaluation = oracle.evaluate(bpy.context.scene)
    size = len(oracle.load_model("hfx-vibration-1")) * evaluation.counters.volume_tests
    assert 0 < evaluation.counters.vertices_posed < 0.2 * size


def test_a_volume_around_everything_poses_no_vertex(body: Any) -> None:
    """Clusters wholly inside a convex volume need no vertex test."""
    oracle.add_volume("World", "vibration", "SPHERE", (0.0, 0.0, 0.9), radius=30.0)
    evaluation = oracle.evaluate(bpy.context.scene)
    model = oracle.load_model("hfx-vibration-1")
    assert {len(sample.vertices) for sample in evaluation.samples["World"].values()} == {len(model)}
    assert evaluation.counters.vertices_posed == 0
