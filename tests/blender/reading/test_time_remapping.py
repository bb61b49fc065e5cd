# SPDX-License-Identifier: GPL-3.0-or-later
"""Time remapping: contacts at a played frame equal Blender's evaluation there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.scene import TimeBase
from hfx_blender.playback.timeline.timeline_record import record
from hfx_blender.reading.description.scene_settings import scene_tolerance
from hfx_blender.reading.live_scene import LiveScene

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

MAPS = [(100, 50), (100, 80), (30, 75)]


@pytest.fixture(params=MAPS)
def ball(request: Any, scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 1, 20
    scene.render.frame_map_old, scene.render.frame_map_new = request.param
    oracle.add_avatar()
    return oracle.add_volume("Ball", "vibration", "SPHERE", (0, 0, 1.1), radius=0.3)


def _levels(scene: Any, ball: Any, time: TimeBase) -> dict[int, float]:
    """Level evaluated by Blender at each sample."""
    actual = {}
    for index in range(time.sample_count):
        oracle.set_time(scene, time.frame(index))
        hfx = ball.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx
        if hfx.activation * hfx.intensity > 0.0:
            actual[index] = hfx.activation * hfx.intensity
    return actual


def _by_clip(ball: Any) -> None:
    oracle.add_clip(ball, 4, 7, fade_in=2)


def _by_keys(ball: Any) -> None:
    oracle.key(ball, "hfx.activation", [(3, 0.0), (5, 1.0), (8, 0.0)])


@pytest.mark.parametrize("how", [_by_clip, _by_keys])
def test_clips_and_keys_are_on_when_blender_has_them_on(scene: Any, ball: Any, how: Any) -> None:
    how(ball)
    oracle.key(ball, "location", [(1, (0, 0, 1.1)), (12, (0, 0, 1.3))])
    samples = oracle.evaluate(scene, rate_hz=96)
    assert samples.reader.stepping_note == "sampled F-curves, stepped no scene"
    truth = _levels(scene, ball, samples.reader.time)
    assert samples.levels("Ball") == pytest.approx(truth, abs=1e-5) and truth


def test_motion_of_volumes_and_bodies_is_that_of_remapped_frames(scene: Any, ball: Any) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.key(ball, "location", [(1, (0, 0, 0.2)), (10, (0, 0, 1.3)), (40, (0, 0, 0.5))])
    oracle.key(body, "location", [(1, (0, 0, 0)), (30, (0.1, 0, 0))])
    target = oracle.empty(scene, "Target")
    body.pose.bones["head"].constraints.new("DAMPED_TRACK").target = target
    oracle.key(body, 'pose.bones["spine01"].rotation_quaternion', [(1, (1, 0, 0, 0))])
    reader = oracle.SceneReader(scene, rate_hz=oracle.Fraction(48))
    for block in reader.blocks():
        (pose,) = block.poses
        for row, index in enumerate(block.indices.tolist()):
            oracle.set_time(scene, reader.time.frame(index))
            here = oracle.world_matrix(scene, ball)[:3, 3]
            np.testing.assert_allclose(block.effects[0].matrices[row, :3, 3], here, atol=1e-5)
            if pose.valid[row]:
                stands = oracle.world_matrix(scene, body)
                np.testing.assert_allclose(pose.to_world[row], stands, atol=1e-5)


def test_a_second_is_a_second_of_playing_and_clips_are_told_so(scene: Any, ball: Any) -> None:
    oracle.add_clip(ball, 4, 7)
    reader = oracle.SceneReader(scene)
    render = scene.render
    length = render.frame_map_old / render.frame_map_new
    (clip,) = reader.description.effects[0].clips
    assert (clip.frame_start, clip.frame_end) == pytest.approx((4 / length, 7 / length))
    assert reader.time.sample_count == round(
        20 / scene.render.fps * float(reader.time.rate_hz) + 0.4
    )


def test_recorded_values_are_those_of_remapped_frames(scene: Any, ball: Any) -> None:
    oracle.key(ball, "location", [(1, (0, 0, 0.2)), (40, (0, 0, 1.3))])
    *_, actual = record(scene, may_step=True)
    assert actual is not None
    live = LiveScene(scene, bpy.context.view_layer, scene_tolerance(scene))
    touched = 0
    for frame in (6.0, 9.5):
        index = actual.index(frame)
        assert index is not None
        oracle.set_time(scene, oracle.Fraction(actual.frames[index]))
        for one, second in zip(actual.runs(index) or (), live.runs(), strict=True):
            touched += len(one.vertices)
            assert one.vertices.tolist() == second.vertices.tolist()
            np.testing.assert_allclose(one.weights, second.weights, atol=1e-4)
    assert touched
