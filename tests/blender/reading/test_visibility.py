# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects disabled at a time are silent at that time, for each current frame."""

from __future__ import annotations

from typing import Any

import pytest

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

HIDDEN = [(1, False), (5, True), (9, False)]


@pytest.fixture
def ball(scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    return oracle.add_volume("Ball", "vibration", "SPHERE", (0, 0, 1.2), radius=0.3)


def _by_key(ball: Any) -> None:
    oracle.key(ball, "hide_viewport", HIDDEN)


def _by_clip(ball: Any) -> None:
    _by_key(ball)
    data = ball.animation_data
    action, data.action = data.action, None
    strip = data.nla_tracks.new().strips.new("Hidden", 1, action)
    strip.extrapolation = "HOLD"


def _by_driver(ball: Any) -> None:
    ball.driver_add("hide_viewport").driver.expression = "frame >= 5 and frame < 9"


@pytest.mark.parametrize("how", [_by_key, _by_clip, _by_driver])
@pytest.mark.parametrize("current", [2, 6])
def test_a_volume_that_is_hidden_at_times(scene: Any, ball: Any, how: Any, current: int) -> None:
    how(ball)
    oracle.key(ball, "location", [(1, (0, 0, 1.2)), (12, (0, 0, 1.0))])
    scene.frame_set(current)
    samples = oracle.evaluate(scene, rate_hz=24)
    assert sorted(samples.samples["Ball"]) == [0, 1, 2, 3, 8, 9, 10, 11]
    assert scene.frame_current == current and not samples.reader.description.warnings


@pytest.mark.parametrize("current", [2, 6])
def test_a_mesh_that_is_hidden_at_times(scene: Any, ball: Any, current: int) -> None:
    bpy.data.objects.remove(ball)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=1, radius=0.3)
    source = bpy.context.object
    mesh = oracle.add_mesh_volume("Mesh", "vibration", source)
    mesh.parent, mesh.location = None, (0, 0, 1.2)
    mesh.modifiers.new("Finer", "SUBSURF")
    _by_key(mesh)
    scene.frame_set(current)
    samples = oracle.evaluate(scene, rate_hz=24)
    assert sorted(samples.samples["Mesh"]) == [0, 1, 2, 3, 8, 9, 10, 11]
    assert len({len(sample.vertices) for sample in samples.samples["Mesh"].values()}) == 1


@pytest.mark.parametrize("current", [2, 6])
def test_a_body_that_is_hidden_at_times_feels_nothing_then(
    scene: Any, ball: Any, current: int
) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.add_painted("Touch", "pressure", body, "hand_palm")
    oracle.key(body, "hide_viewport", HIDDEN)
    scene.frame_set(current)
    samples = oracle.evaluate(scene, rate_hz=24)
    for name in ("Ball", "Touch"):
        assert sorted(samples.samples[name]) == [0, 1, 2, 3, 8, 9, 10, 11]
    assert not samples.counters.warnings


def test_the_eye_and_the_camera_do_not_matter(scene: Any, ball: Any) -> None:
    ball.hide_set(True)
    oracle.key(ball, "hide_render", HIDDEN)
    samples = oracle.evaluate(scene, rate_hz=24)
    assert len(samples.samples["Ball"]) == 12
    assert samples.reader.stepping_note == "sampled F-curves, stepped no scene"


def test_live_feels_nothing_of_what_is_hidden_now(scene: Any, ball: Any) -> None:
    from hfx_blender.engine.tolerance import STANDARD
    from hfx_blender.reading.live_scene import LiveScene, signature_of

    _by_key(ball)
    live = LiveScene(scene, bpy.context.view_layer, STANDARD)
    samples = []
    for frame in (2, 6, 10):
        scene.frame_set(frame)
        samples.append(len(live.runs()))
        assert signature_of(scene) == live.signature
    assert samples == [1, 0, 1]
