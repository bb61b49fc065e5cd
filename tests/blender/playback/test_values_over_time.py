# SPDX-License-Identifier: GPL-3.0-or-later
"""Values over time, and glowing actuators: equal to an export, cached while valid."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_avatar
from hfx_blender.engine.colouring import PALETTES
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.preview import drawing
from hfx_blender.playback.preview.actuator_glow import Discs
from hfx_blender.playback.preview.preview import preview
from hfx_blender.playback.preview.preview_layers import Preview
from hfx_blender.playback.timeline import timeline_recorder, value_chart
from hfx_blender.playback.timeline.timeline_record import NeedsSteppingError, TimelineRecord, record
from hfx_blender.playback.timeline.timeline_recorder import TimelineRecorder, recorder
from hfx_blender.reading.stepped import stepping

PAPER = PALETTES["PAPER"]


@pytest.fixture
def squeeze(scene: Any) -> Any:
    """A clip of pressure on the whole body from frame 10 to 20 at 6 kPa, 24 frames a second."""
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Squeeze")
    bpy.ops.hfx.fill_part(part="all")
    effect = bpy.context.object
    effect.hfx.pressure = 6.0
    clips.add_clip(effect, 10, 20)
    scene.frame_start, scene.frame_end = 0, 47
    scene.render.fps = 24
    scene.hfx.rate = 24.0
    scene.hfx.devices.add().name = "pressure_vest"
    return effect


def whole(scene: Any, may_step: bool = False) -> TimelineRecord:
    *_, actual = record(scene, may_step=may_step)
    assert actual is not None
    return actual


def test_an_effects_curve_is_its_strength_while_its_clip_lasts(squeeze: Any, scene: Any) -> None:
    actual = whole(scene)
    (effect,) = actual.effects
    assert (effect.name, effect.unit, len(effect.values)) == ("Squeeze", "kPa", 48)
    on = (actual.frames >= 10) & (actual.frames < 20)
    assert effect.values[on] == pytest.approx(6.0)
    assert not effect.values[~on & (actual.frames != 20)].any()


def test_recording_leaves_the_frame_alone(squeeze: Any, scene: Any) -> None:
    scene.frame_set(31)
    whole(scene)
    assert scene.frame_current == 31
    assert [item.name for item in bpy.data.scenes] == [scene.name]


def test_a_record_gives_what_is_felt_as_the_engine_does_at_that_moment(
    squeeze: Any, scene: Any
) -> None:
    actual = whole(scene)
    scene.frame_set(15)
    preview = Preview()
    preview.describe(bpy.context)
    ((sample,),) = actual.runs(actual.index(15) or 0) or ()
    ((live,),) = evaluation.runs()
    assert np.array_equal(sample.vertices, live.vertices)
    assert sample.level == pytest.approx(live.level)
    assert actual.runs(actual.index(30) or 0) == []
    assert actual.index(60) is None, "the timeline has ended"


def shares(preview: Preview, *now: Any) -> np.ndarray:
    """Strength of the actuators' glow."""
    preview.invalidate()
    (discs,) = preview.discs("PAPER", *now)
    return discs.rows[: len(discs.looks.radii), 0, 3]


def test_actuators_glow_with_their_share_of_what_they_may_get(squeeze: Any, scene: Any) -> None:
    scene.frame_set(15)
    preview = Preview()
    preview.describe(bpy.context)
    live = shares(preview)
    assert preview.fault == ""
    assert live == pytest.approx(shares(preview, whole(scene), 15), abs=1e-6)
    strongest = load_device("pressure_vest").actuators[0].type.strength.highest
    assert live == pytest.approx(6.0 / strongest), "all of the skin is squeezed"
    scene.frame_set(30)
    assert not shares(preview).any()


def test_where_the_record_ends_actuators_glow_with_what_is_felt(squeeze: Any, scene: Any) -> None:
    actual = whole(scene)
    clips.add_clip(squeeze, 60, 70)
    scene.frame_set(65)
    preview = Preview()
    preview.describe(bpy.context)
    assert shares(preview, actual, 65).all()


def test_actuators_are_drawn_anew_only_if_something_moved(squeeze: Any, scene: Any) -> None:
    preview = Preview()
    preview.describe(bpy.context)
    first = preview.discs("PAPER")
    assert preview.discs("PAPER") is first, "what is on the graphics card is drawn again"
    preview.invalidate()
    assert preview.discs("PAPER") is not first


def test_actuators_lie_on_the_skin_and_go_where_the_body_goes(squeeze: Any, scene: Any) -> None:
    preview = Preview()
    preview.describe(bpy.context)
    first = preview.discs("PAPER")
    body = squeeze.hfx.body
    body.location.x = 3.0
    bpy.context.view_layer.update()
    preview.invalidate()
    (before,), (after,) = first, preview.discs("PAPER")
    assert len(places(before)) == 32, "the vest has 32 bladders"
    assert places(after) - places(before) == pytest.approx(np.tile([3.0, 0, 0], (32, 1)), abs=1e-4)
    skin = load_avatar().vertices
    nearest = [np.linalg.norm(skin - position, axis=1).min() for position in places(before)]
    assert max(nearest) < 1e-5, "each on a vertex of the skin"
    outward = before.rows[:32, 1, :3]
    assert np.linalg.norm(outward, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert before.above * before.scale == pytest.approx(0.004)


def test_discs_of_a_scaled_body_keep_their_size_and_height(squeeze: Any, scene: Any) -> None:
    preview = Preview()
    preview.describe(bpy.context)
    squeeze.hfx.body.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    preview.invalidate()
    (discs,) = preview.discs("PAPER")
    assert discs.scale == pytest.approx(2.0)
    assert discs.above * discs.scale == pytest.approx(0.004)
    assert discs.looks.radii.min() >= 0.006 and discs.looks.radii.max() <= 0.02


def places(discs: Discs) -> np.ndarray:
    """World positions of the discs."""
    matrix = np.array(discs.matrix)
    actual: np.ndarray = (
        discs.rows[: len(discs.looks.radii), 0, :3] @ matrix[:3, :3].T + matrix[:3, 3]
    )
    return actual


def test_a_device_that_is_not_known_is_told_and_the_others_glow(squeeze: Any, scene: Any) -> None:
    scene.hfx.devices.add().name = "no_such_device"
    preview = Preview()
    preview.describe(bpy.context)
    assert len(preview.discs("PAPER")) == 1
    assert "no_such_device" in preview.fault
    assert any("no_such_device" in fault for fault in whole(scene).faults)


def test_a_chart_has_a_row_for_each_effect_and_actuator_that_fits(squeeze: Any, scene: Any) -> None:
    actual = whole(scene)
    wide = value_chart.chart(actual, PAPER, 600.0, 400.0)
    assert wide.labels[0].text == "Squeeze"
    assert wide.hidden == 0 and wide.height <= 400.0
    assert wide.positions[:, 0].max() <= 600.0 and wide.positions[:, 1].min() >= 0.0
    first, last = wide.frames
    assert (first, last) == (scene.frame_start, scene.frame_end + 1)
    assert (wide.x_of(first), wide.x_of(last)) == (0.0, 600.0)
    squeeze.hfx.group = "Hug"
    second = effects.duplicate(squeeze)
    second.hfx.group, second.hfx.pressure = "Hug", 2.0 * squeeze.hfx.pressure
    hug, *rest = whole(scene).rows()
    assert (hug.name, rest) == ("Hug", [])
    assert hug.values.max() == 2.0 * squeeze.hfx.pressure, "the stronger of both"
    small = value_chart.chart(actual, PAPER, 600.0, 60.0)
    assert small.hidden == 32  # the axis, the effect and the name of the device fill 60 pixels
    # Box of the curve: from frame 10 to frame 20, as high as the curve's share of full scale.
    green = np.isclose(wide.colours[:, 1], PAPER["pressure"][1], atol=0.01)
    curve = wide.positions[green & (wide.positions[:, 1] > wide.height - 30)]
    assert curve[:, 0].min() == pytest.approx(wide.x_of(10), abs=wide.width / 48)
    assert curve[:, 0].max() == pytest.approx(wide.x_of(21), abs=wide.width / 48)


def test_the_time_axis_of_the_chart_is_that_of_the_timeline(squeeze: Any, scene: Any) -> None:
    # 10 pixels a frame, of frames -2 to 22: the curve begins at frame 10, as far as it is seen.
    chart = value_chart.chart(whole(scene), PAPER, 240.0, 400.0, frames=(-2.0, 22.0))
    green = np.isclose(chart.colours[:, 1], PAPER["pressure"][1], atol=0.01)
    curve = chart.positions[green & (chart.positions[:, 1] > chart.height - 30)]
    assert (curve[:, 0].min(), curve[:, 0].max()) == (120.0, pytest.approx(230.0, abs=1.0))
    # The scene begins at frame 0: no row of an actuator is drawn before.
    rows = chart.positions[6:, 0][chart.positions[6:, 1] < chart.height - 30]
    assert rows.min() == 20.0
    # No two marks are nearer than 80 pixels: every tenth frame.
    assert value_chart.ticks(scene, chart) == [(20.0, "0"), (120.0, "10"), (220.0, "20")]
    scene.hfx.time_unit, scene.frame_start, scene.render.fps = "SECONDS", 1, 24
    # 12 frames are half a second; the scene's first frame is 0 s.
    marks = [(30.0, "0 s"), (150.0, "0.5 s")]
    assert value_chart.ticks(scene, chart) == [pytest.approx(mark) for mark in marks]


def _at_timeline(x: int, width: int, first: float, last: float, frame: float) -> Any:
    """Context of a timeline from window pixel ``x`` that shows two frames at its ends, and of a
    wider other editor; ``frame``: of the playhead."""

    def region_to_view(at: float, _y: float) -> tuple[float, float]:
        return first + (last - first) * at / width, 0.0

    view = SimpleNamespace(region_to_view=region_to_view)
    region = SimpleNamespace(type="WINDOW", x=x, width=width, view2d=view)
    area = SimpleNamespace(type="DOPESHEET_EDITOR", ui_type="TIMELINE", width=width)
    area.regions = [SimpleNamespace(type="HEADER"), region]
    other = SimpleNamespace(type="VIEW_3D", ui_type="VIEW_3D", width=5000, regions=[])
    screen = SimpleNamespace(areas=[area, other])
    return SimpleNamespace(screen=screen, scene=SimpleNamespace(frame_current_final=frame))


def test_the_chart_shows_all_frames_of_the_timeline_and_the_playhead(
    squeeze: Any, scene: Any
) -> None:
    actual, frames = whole(scene), drawing._chart_frames  # frames 0 to 48
    # Above a timeline of 600 pixels and frames -6 to 54, 10 pixels a frame: equal positions.
    assert frames(_at_timeline(0, 600, -6, 54, 20), actual, 50, 590) == pytest.approx((-1, 53))
    # The toolbar hides two of 48 frames: equal positions. Three are too many.
    assert frames(_at_timeline(0, 600, -6, 54, 20), actual, 80, 590) == pytest.approx((2, 53))
    assert frames(_at_timeline(0, 600, -6, 54, 20), actual, 90, 590) == (0, 48)
    # A sidebar over the last frames, a timeline beside the viewport, a wider timeline.
    assert frames(_at_timeline(0, 600, -6, 54, 20), actual, 50, 400) == (0, 48)
    assert frames(_at_timeline(0, 600, -6, 54, 20), actual, 610, 1200) == (0, 48)
    assert frames(_at_timeline(0, 1200, -6, 54, 20), actual, 610, 1200) == (0, 48)
    # A part of the scene in the view, with and without the playhead.
    assert frames(_at_timeline(0, 600, 12, 24, 20), actual, 610, 1200) == pytest.approx((12, 24))
    assert frames(_at_timeline(0, 600, 12, 24, 30), actual, 50, 590) == (0, 48)
    assert frames(_at_timeline(0, 600, -6, 54, 90), actual, 50, 590) == (0, 90)
    bare = _at_timeline(0, 600, -6, 54, 20)
    bare.screen.areas.pop(0)
    assert frames(bare, actual, 50, 590) == (0, 48)


def test_an_impact_between_columns_of_the_chart_stays_visible() -> None:
    values = np.array([0.0, 0.0, 0.0, -5.0, 0.0, 2.0])
    columns = value_chart._columns(values, np.array([-2.0, 0.0, 3.0, 5.0, 6.0, 9.0]))
    assert columns.tolist() == [0.0, 0.0, -5.0, 2.0, 0.0]
    # Half a sample in each column.
    halves = value_chart._columns(values, np.array([4.5, 5.0, 5.5]))
    assert halves.tolist() == [0.0, 2.0]


def test_what_follows_from_no_curve_is_stepped_only_when_asked_for(
    squeeze: Any, scene: Any
) -> None:
    driver = squeeze.driver_add("hfx.intensity").driver
    driver.expression = "0.5 + 0.0 * frame"
    bpy.context.view_layer.update()
    with pytest.raises(NeedsSteppingError):
        whole(scene)
    assert whole(scene, may_step=True).effects[0].values.max() == pytest.approx(3.0, rel=1e-3)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline_recorder, "QUIET_S", 0.0)


def until_done(updates: TimelineRecorder, scene: Any) -> None:
    end = time.monotonic() + 30.0
    while updates.has_work and time.monotonic() < end:
        updates.work(scene)


def test_values_are_recorded_once_and_anew_after_a_change(
    squeeze: Any, scene: Any, soon: None
) -> None:
    updates = TimelineRecorder()
    updates.check_settings(scene)
    until_done(updates, scene)
    assert updates.is_fresh and updates.count == 1
    updates.check_settings(scene)
    until_done(updates, scene)
    assert updates.count == 1, "nothing has changed"
    scene.frame_end = 60
    updates.check_settings(scene)
    assert not updates.is_fresh and updates.result is not None, "the old one is shown meanwhile"
    until_done(updates, scene)
    assert updates.count == 2 and len(updates.result.frames) == 61


def test_a_scene_that_has_to_be_stepped_through_waits_for_the_button(
    squeeze: Any, scene: Any, soon: None
) -> None:
    squeeze.driver_add("hfx.intensity").driver.expression = "0.5 + 0.0 * frame"
    updates = TimelineRecorder()
    updates.invalidate()
    until_done(updates, scene)
    assert updates.must_step and not updates.is_fresh
    updates.update_now(scene)
    assert updates.is_fresh and not updates.must_step


def test_deleting_what_is_being_recorded_is_no_error(squeeze: Any, scene: Any, soon: None) -> None:
    scene.frame_end = 400
    updates = TimelineRecorder()
    updates.invalidate()
    updates.work(scene)
    bpy.data.objects.remove(squeeze)
    for _ in range(100):
        updates.work(scene)
        if not updates.has_work:
            break
    updates.invalidate()
    until_done(updates, scene)
    assert updates.result is None and not updates.is_fresh


def _constrain(scene: Any, ball: Any, guide: Any) -> None:
    effects.bodies_of(scene)[0].constraints.new("COPY_LOCATION").target = guide


def _beat(scene: Any, ball: Any, guide: Any) -> None:
    _constrain(scene, ball, guide)
    bpy.ops.hfx.add_painted(modality="vibration", name="Beat")
    bpy.ops.hfx.fill_part(part="all")
    bpy.context.object.hfx.intensity = 0.5
    bpy.context.object.keyframe_insert("hfx.intensity", frame=1)
    bpy.context.object.hfx.intensity = 1.0
    bpy.context.object.keyframe_insert("hfx.intensity", frame=6)
    bpy.ops.hfx.add_heartbeat()


def _drive(scene: Any, ball: Any, guide: Any) -> None:
    ball.driver_add("location", 2).driver.expression = "frame * 0.05"


def _chain_parents(scene: Any, ball: Any, guide: Any) -> None:
    ball.parent = guide
    guide.constraints.new("LIMIT_LOCATION")


def _simulate(scene: Any, ball: Any, guide: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(location=(0.0, 0.0, 3.0))
    bpy.ops.rigidbody.object_add()
    ball.parent = bpy.context.object


def _show_in_two_scenes(scene: Any, ball: Any, guide: Any) -> None:
    _constrain(scene, ball, guide)
    second = bpy.data.scenes.new("Second")
    second.collection.objects.link(ball)
    second.view_layers[0].update()


def _instance(scene: Any, ball: Any, guide: Any) -> None:
    hidden = bpy.data.collections.new("Not in the Scene")
    hidden.objects.link(ball)
    for collection in ball.users_collection:
        if collection != hidden:
            collection.objects.unlink(ball)
    guide.instance_type, guide.instance_collection = "COLLECTION", hidden


def _emit(scene: Any, ball: Any, guide: Any) -> None:
    bpy.ops.mesh.primitive_plane_add(location=(0.0, 0.0, 2.0))
    emitter = bpy.context.object
    emitter.modifiers.new("Drops", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.count, settings.frame_end = 5, 4
    settings.render_type, settings.instance_object = "OBJECT", ball


@pytest.fixture
def ball_and_guide(scene: Any, soon: None) -> Iterator[tuple[Any, Any]]:
    """A volume and a keyframed empty, with the handlers of a Blender with a window."""
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE")
    ball = bpy.context.object
    guide = bpy.data.objects.new("Guide", None)
    scene.collection.objects.link(guide)
    for frame, x in ((1, 0.0), (6, 0.3)):
        guide.location.x = x
        guide.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end, scene.hfx.rate = 1, 6, 24
    preview.listen()
    recorder.forget()
    yield ball, guide
    preview.stop_listening()
    preview.forget()


@pytest.mark.parametrize(
    "moved",
    [_constrain, _beat, _drive, _chain_parents, _simulate, _show_in_two_scenes, _instance, _emit],
)
def test_update_values_is_valid_until_an_edit(
    scene: Any, ball_and_guide: tuple[Any, Any], moved: Callable[[Any, Any, Any], None]
) -> None:
    moved(scene, *ball_and_guide)
    bpy.context.view_layer.update()
    scene.frame_set(3)
    recorder.invalidate()
    until_done(recorder, scene)
    assert recorder.must_step and recorder.valid is None, "idle time sets no frames"
    assert scene.frame_current == 3 and not stepping.is_stepping()
    assert bpy.ops.hfx.update_values() == {"FINISHED"}
    for frame in (3, 4, 1):
        scene.frame_set(frame)
        preview.check_scene()
        bpy.context.view_layer.update()
        assert recorder.valid is not None
    effects.bodies_of(scene)[0].location.z = 0.1
    bpy.context.view_layer.update()
    assert recorder.valid is None


def test_instances_alone_can_be_exported(ball_and_guide: tuple[Any, Any], scene: Any) -> None:
    assert bpy.ops.hfx.export.poll()
    _instance(scene, *ball_and_guide)
    assert not effects.effects_of(scene)
    assert bpy.ops.hfx.export.poll()
    bpy.data.objects.remove(ball_and_guide[0])
    assert not bpy.ops.hfx.export.poll()
