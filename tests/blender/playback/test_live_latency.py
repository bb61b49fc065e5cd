# SPDX-License-Identifier: GPL-3.0-or-later
"""Slow actuators start early, by their latency, with the recorded values of a later moment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.effects import effects
from hfx_blender.engine.rendering.moment import moment_header
from hfx_blender.engine.samples import SampleRun
from hfx_blender.playback.live.latency import Playback, recorded_runs, uncompensated
from hfx_blender.playback.live.live_sources import SceneSource
from hfx_blender.playback.timeline import timeline_record, timeline_recorder
from hfx_blender.playback.timeline.timeline_recorder import recorder
from hfx_blender.reading.description.scene_settings import scene_tolerance
from hfx_blender.reading.live_scene import LiveScene


@pytest.fixture
def recorded_scene(scene: Any) -> Iterator[Any]:
    """A scene with an avatar, frames 1 to 24 at 24 frames a second; nothing is recorded yet."""
    recorder.forget()
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 24, 24
    scene.hfx.rate = 48.0
    bpy.ops.hfx.add_avatar()
    yield scene
    recorder.forget()


@pytest.fixture
def ball(recorded_scene: Any) -> Any:
    """A volume moving through the avatar."""
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name="Ball", radius=0.3)
    actual = bpy.context.object
    for frame, x in ((1, -1.0), (24, 1.0)):
        actual.location = x, 0.0, 1.2
        actual.keyframe_insert("location", frame=frame)
    return actual


def live_scene() -> LiveScene:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.update()
    return LiveScene(scene, layer, scene_tolerance(scene))


def felt(run: SampleRun) -> np.ndarray:
    """Strength at each vertex."""
    expected = np.zeros(100_000)
    expected[run.vertices] = run.weights
    return expected


def test_recorded_samples_are_those_of_the_scene_when_it_stands_there(ball: Any) -> None:
    recorder.update_now(bpy.context.scene)
    live, touched = live_scene(), 0
    streams = moment_header(live.description).streams
    for frame in (5.0, 10.5, 12.0, 14.5):
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1.0)
        (ahead,), there = recorded_runs({100.0: frame}, streams).values(), live.runs()
        assert [run.stream for run in ahead] == [run.stream for run in there]
        for one, second in zip(ahead, there, strict=True):
            touched += len(one.vertices)
            # Blender's matrices have 32 bits: a point of skin on the very edge is in or out.
            assert np.abs(felt(one) - felt(second)).sum() < 0.002 * felt(second).sum() + 0.1
            assert one.parameters.tolist() == second.parameters.tolist()
    assert touched


def test_recorded_instances_are_put_into_the_slots_of_the_live_scene(recorded_scene: Any) -> None:
    ball = effects.add_volume(recorded_scene, "vibration", "SPHERE", "Ball")
    ball.hfx.radius = 0.04
    for collection in list(ball.users_collection):
        collection.objects.unlink(ball)
    bpy.data.collections.new("Source").objects.link(ball)
    for k, y in enumerate((-0.15, 0.06)):
        empty = bpy.data.objects.new(f"Here {k}", None)
        empty.instance_type = "COLLECTION"
        empty.instance_collection = bpy.data.collections["Source"]
        empty.location = 0.0, y, 1.08
        recorded_scene.collection.objects.link(empty)
    bpy.context.view_layer.update()
    recorder.update_now(recorded_scene)
    live = live_scene()
    streams = moment_header(live.description).streams
    (ahead,) = recorded_runs({100.0: 7.0}, streams).values()
    assert {run.stream for run in ahead} == {run.stream for run in live.runs()} <= set(streams)
    assert len(ahead) == 2


def test_after_an_edit_nothing_is_compensated(ball: Any) -> None:
    recorder.update_now(bpy.context.scene)
    streams = moment_header(live_scene().description).streams
    assert recorded_runs({100.0: 12.0}, streams)
    recorder.invalidate()
    assert recorded_runs({100.0: 12.0}, streams) == {}


@pytest.mark.parametrize(
    ("name", "value"), [("rate", 24.0), ("live_tolerance", "PREVIEW"), ("tolerance", "EXACT")]
)
def test_a_record_with_other_settings_is_outdated(ball: Any, name: str, value: object) -> None:
    recorder.update_now(bpy.context.scene)
    SceneSource().open(bpy.context)
    assert recorder.valid is not None
    setattr(bpy.context.scene.hfx, name, value)
    SceneSource().open(bpy.context)
    assert recorder.valid is None


def test_the_panel_tells_where_latency_is_not_compensated_and_the_cure(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = bpy.context.scene
    assert "while nothing is edited or played" in uncompensated(scene)
    recorder.update_now(scene)
    assert uncompensated(scene) == ""
    scene.use_preview_range = True
    scene.frame_preview_start, scene.frame_preview_end = 20, 30
    assert "in frames 25 to 30. Extend" in uncompensated(scene)
    scene.use_preview_range = False
    monkeypatch.setattr(timeline_record, "MOST_BYTES", 0)  # the ball reaches skin half way
    recorder.update_now(scene)
    record = recorder.valid
    assert record is not None and record.is_cut
    _, last = record.kept_range
    assert 1 <= last < 24
    assert f"in frames {last + 1} to 24. The record" in uncompensated(scene)
    streams = moment_header(live_scene().description).streams
    assert list(recorded_runs({1.0: float(last), 2.0: 24.0}, streams)) == [1.0]


def test_a_scene_that_must_be_stepped_is_compensated_after_update_values(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timeline_recorder, "QUIET_S", 0.0)
    ball.constraints.new("COPY_LOCATION")
    bpy.context.view_layer.update()
    scene = bpy.context.scene
    recorder.invalidate()
    while recorder.has_work:
        recorder.work(scene)
    assert recorder.valid is None and "Press Update Values" in uncompensated(scene)
    assert bpy.ops.hfx.update_values() == {"FINISHED"}
    assert recorder.valid is not None and uncompensated(scene) == ""


def test_what_a_device_in_the_room_needs_is_recorded(ball: Any) -> None:
    *_, actual = timeline_record.record(bpy.context.scene, may_step=True, with_positions=True)
    assert actual is not None
    index = actual.index(12.0)
    assert index is not None
    for run in actual.runs(index) or ():
        assert run.positions is not None and len(run.positions) == len(run.vertices) > 0


def test_frames_ahead_are_those_that_playback_shows(recorded_scene: Any) -> None:
    playback = Playback()

    def after(frame: float, is_playing: bool = True) -> float | None:
        recorded_scene.frame_set(int(frame), subframe=frame % 1.0)
        frames = playback.frames_after(recorded_scene, [100.0], is_playing=is_playing)
        return frames.get(100.0)

    # 100 ms are 2.4 frames; after 24 comes 1.
    assert [after(k) for k in (5, 6, 7)] == pytest.approx([7.4, 8.4, 9.4])
    assert after(22) == pytest.approx(24.4)  # the last frame lasts a whole frame
    assert [after(k) for k in (23, 24, 1)] == pytest.approx([1.4, 2.4, 3.4])
    assert after(20) == pytest.approx(22.4)
    assert after(5) == pytest.approx(7.4)  # a jump back does not reverse the direction
    assert after(6) == pytest.approx(8.4)
    # In reverse, known from the second frame on; before 1 comes 24.
    assert [after(k) for k in (5, 4, 3)] == pytest.approx([7.4, 1.6, 0.6])
    assert after(2, is_playing=False) is None
    assert after(3) == pytest.approx(5.4)
