# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses in Blender: stack, animation, export, and baking."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.effects import effects
from hfx_blender.blender import compat
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.response_filters.controls import FilterKind
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.scene_reader import SceneReader

FPS = 25
DECAY_S = 0.1


@pytest.fixture
def ball(scene: Any) -> Any:
    """A ball flying to the belly within half a second, and away again."""
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, 24
    bpy.ops.hfx.add_avatar()
    ball = effects.add_volume(scene, "vibration", "SPHERE", "Ball")
    ball.hfx.radius = 0.05
    ball.location = (0.0, -0.6, 1.08)
    for frame, y in ((0, -0.6), (12, -0.12), (24, -0.6)):
        ball.location[1] = y
        ball.keyframe_insert("location", frame=frame)
    for curve in compat.fcurves(ball):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    bpy.context.view_layer.objects.active = ball
    return ball


def _runs(**settings: Any) -> tuple[list[SampleRun], SceneReader]:
    reader = SceneReader(bpy.context.scene, **settings)
    engine = Engine(reader.description, tolerance=reader.tolerance)
    return [run for block in reader.blocks() for run in engine.evaluate(block)], reader


def _levels(runs: list[SampleRun]) -> np.ndarray:
    levels = np.zeros(100)
    for run in runs:
        levels[run.indices] = run.levels
    return levels


def test_filters_are_added_moved_muted_and_removed_with_their_animation(ball: Any) -> None:
    for kind in ("impact", "speed", "sine"):
        assert bpy.ops.hfx.add_response_filter(kind=kind) == {"FINISHED"}
    stack = ball.hfx.response
    assert [item.name for item in stack] == ["Impact", "Speed", "Sine"]
    stack[0].keyframe_insert("decay", frame=3)
    stack[2].driver_add("depth")
    ball.hfx.response_active = 0
    bpy.ops.hfx.move_response_filter(direction="DOWN")
    bpy.ops.hfx.move_response_filter(direction="DOWN")
    assert [item.name for item in stack] == ["Speed", "Sine", "Impact"]
    paths = {curve.data_path for curve in compat.fcurves(ball)}
    assert "hfx.response[2].decay" in paths
    assert ball.animation_data.drivers[0].data_path == "hfx.response[1].depth"
    ball.hfx.response_active = 1
    bpy.ops.hfx.remove_response_filter()
    assert [item.name for item in stack] == ["Speed", "Impact"]
    assert not len(ball.animation_data.drivers)
    assert "hfx.response[1].decay" in {curve.data_path for curve in compat.fcurves(ball)}


def test_an_impact_rings_on_after_the_ball_has_left(ball: Any) -> None:
    without, _ = _runs()
    bpy.ops.hfx.add_response_filter(kind="impact")
    item = ball.hfx.response[0]
    item.decay, item.full_speed = DECAY_S, 2.0
    runs, reader = _runs()
    assert reader.stepping_note == "sampled F-curves, stepped no scene"
    levels, contact = _levels(runs), _levels(without) > 0.0
    first, last = np.flatnonzero(contact)[[0, -1]]
    assert np.argmax(levels) == first and levels[last + 10] > 0.0
    # 0.48 m in 12 frames.
    assert levels[first] == pytest.approx(0.48 / (12 / FPS) / 2.0, rel=0.02)
    # The strongest moment may lie between two samples while the ball is inside, not afterwards.
    a_sample = np.exp(-0.01 / DECAY_S)
    after = levels[last + 1 : last + 11]
    np.testing.assert_allclose(after[1:] / after[:-1], a_sample)


def _skin_y() -> float:
    """Front of the belly, at the height of the ball."""
    model = load_model("hfx-vibration-1").vertices
    near = (np.abs(model[:, 0]) < 0.01) & (np.abs(model[:, 2] - 1.08) < 0.012)
    return float(model[near][:, 1].min())


@pytest.mark.parametrize("is_stepped", [False, True])
def test_an_impact_rings_alike_at_every_rate(ball: Any, is_stepped: bool) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].decay, ball.hfx.response[0].full_speed = DECAY_S, 1.0
    ball.animation_data_clear()
    # 1 m/s, 4 mm deep at 0.5 s: a time halfway between two samples at 99 Hz.
    deepest = _skin_y() - 0.05 + 0.004
    for frame, y in ((0.0, deepest - 0.5), (12.5, deepest), (25.0, deepest - 0.5)):
        ball.location = (0.0, y, 1.08)
        ball.keyframe_insert("location", frame=frame)
    for curve in compat.fcurves(ball):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    if is_stepped:
        ball.constraints.new("LIMIT_SCALE")
    actual = []
    for rate in (99, 200, 1000):
        runs, reader = _runs(rate_hz=Fraction(rate), tolerance=STANDARD)
        assert is_stepped == ("stepped no scene" not in reader.stepping_note)
        time_s, strongest = 0.0, 0.0
        for sample in (sample for run in runs for sample in run):
            if time_s < sample.time_s <= 0.6 + 1e-9:
                time_s, strongest = sample.time_s, sample.level * float(sample.weights.max())
        actual.append(strongest / np.exp(-(time_s - 0.496) / DECAY_S))
    assert min(actual) > 0.85 and min(actual) >= 0.97 * max(actual)


def test_an_export_that_begins_later_has_what_rings_from_before(ball: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].decay = 0.3
    samples = []
    for frames in (None, (15, 24)):  # contact begins at frame 11 and ends at frame 13
        settings = ExportSettings(("track",), frames=frames, full_precision=True)
        export_scene(bpy.context.scene, tmp_path, "ringing", settings)
        with TrackReader(tmp_path / "ringing.hfxtrack") as track:
            samples.append([track.samples_at(0.605 + 0.01 * k)[0] for k in range(38)])
    for whole, part in zip(*samples, strict=True):
        assert part.level == pytest.approx(whole.level, rel=1e-9)
        np.testing.assert_array_equal(part.vertices, whole.vertices)
        np.testing.assert_array_equal(part.weights, whole.weights)


def test_keyed_controls_are_read_alike_from_curves_and_by_stepping(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    bpy.ops.hfx.add_response_filter(kind="sine")
    impact, sine = ball.hfx.response
    for frame, decay, frequency in ((0, 0.05, 2.0), (24, 0.5, 6.0)):
        impact.decay, sine.frequency = decay, frequency
        impact.keyframe_insert("decay", frame=frame)
        sine.keyframe_insert("frequency", frame=frame)
    from_curves, reader = _runs()
    assert "no scene" in reader.stepping_note
    ball.constraints.new("LIMIT_SCALE")  # does nothing, but is not modelled
    stepped, reader = _runs()
    assert "stepped a scratch scene" in reader.stepping_note
    np.testing.assert_allclose(_levels(stepped), _levels(from_curves), atol=2e-3)
    assert _levels(stepped).any()


def test_a_sine_whose_frequency_is_keyed_turns_on_evenly(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="sine")
    sine = ball.hfx.response[0]
    for frame, frequency in ((0, 0.0), (25, 5.0)):
        sine.frequency = frequency
        sine.keyframe_insert("frequency", frame=frame)
    for curve in compat.fcurves(ball):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    reader = SceneReader(bpy.context.scene)
    for block in reader.blocks():
        controls = block.effects[0].response
        assert controls is not None
        times = reader.time.times_s(block.indices)
        turns = controls[:, 0, 1] * times + controls[:, 0, 3]
        # The frequency is 5 t, with the integral 2.5 t^2.
        np.testing.assert_allclose(turns, 2.5 * times**2, atol=1e-4)


def test_muted_filters_and_painted_effects_have_no_response(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].is_muted = True
    reader = SceneReader(bpy.context.scene)
    assert reader.description.effects[0].area.response == ()
    bpy.ops.hfx.add_painted(modality="pressure")
    assert not bpy.ops.hfx.add_response_filter.poll()


def test_lengths_follow_the_scene_s_unit(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="proximity")
    ball.hfx.response[0].reach = 20.0
    bpy.context.scene.unit_settings.scale_length = 0.01
    block = next(iter(SceneReader(bpy.context.scene).blocks()))
    assert block.effects[0].response[0, 0, 1] == pytest.approx(0.2)


def test_how_long_impacts_ring_is_bounded_by_their_keys(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    item = ball.hfx.response[0]

    def bound() -> float:
        (actual,) = SceneReader(bpy.context.scene).description.effects[0].area.response
        assert actual.kind is FilterKind.IMPACT
        return float(actual.rings_s)

    item.decay = 0.2
    assert bound() == pytest.approx(0.2 * np.log(1000.0))
    item.attack = 0.3
    assert bound() == pytest.approx(12 * 0.3)
    for frame, decay in ((0, 0.2), (10, 0.9)):
        item.decay = decay
        item.keyframe_insert("decay", frame=frame)
    assert bound() >= 12 * 0.9 - 1e-5


@pytest.mark.parametrize("target", ["ENVELOPE", "INTENSITY", "SPEAKER"])
def test_a_response_is_baked_to_keys(ball: Any, target: str) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].decay = 0.1
    speaker = bpy.data.objects.new("Speaker", bpy.data.speakers.new("Speaker"))
    bpy.context.scene.collection.objects.link(speaker)
    speaker.parent = ball
    levels = _levels(_runs()[0])
    assert bpy.ops.hfx.bake_response(target=target) == {"FINISHED"}
    owner, path = ball, f"hfx.{target.lower()}"
    if target == "SPEAKER":
        owner, path = speaker.data, "volume"
    (curve,) = (c for c in compat.fcurves(owner) if c.data_path == path)
    for frame in range(24):
        strongest = levels[frame * 4 : frame * 4 + 4].max()  # 100 samples a second, 25 frames
        assert curve.evaluate(frame) == pytest.approx(strongest, abs=1e-5)
    if target == "INTENSITY":
        assert ball.hfx.response[0].is_muted
        baked = _levels(_runs()[0])
        contact = np.flatnonzero(baked)
        peak = int(np.argmax(levels))
        assert baked[peak // 4 * 4 : peak // 4 * 4 + 4].max() == pytest.approx(
            levels[peak], rel=0.35
        )
        assert len(contact)


def test_baking_what_touches_nobody_is_told(ball: Any) -> None:
    ball.location = (5.0, 0.0, 0.0)
    ball.animation_data_clear()
    with pytest.raises(RuntimeError, match="'Ball' touches no body"):
        bpy.ops.hfx.bake_response()


def test_a_part_of_time_is_felt_as_in_the_whole(ball: Any) -> None:
    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].decay = 0.05
    reader = SceneReader(bpy.context.scene)
    engine = Engine(reader.description)
    runs = [r for b in reader.blocks() for r in engine.evaluate(b)]
    first = 64
    warm = first - 32 * int(np.ceil((engine.responses.memory_s * 100 + 1) / 32))
    later = Engine(reader.description)
    part = [r for b in reader.blocks((max(warm, 0), 100)) for r in later.evaluate(b)]

    def after(found: list[SampleRun]) -> list[tuple[Any, ...]]:
        return [
            (int(i), s.level, s.vertices.tobytes(), s.weights.tobytes())
            for run in found
            for i, s in zip(run.indices, run, strict=True)
            if i >= first
        ]

    assert after(part) == after(runs) != []


def test_a_touch_rings_on_live_while_nothing_moves(ball: Any) -> None:
    from hfx_blender.engine.tolerance import STANDARD
    from hfx_blender.reading.live_scene import LiveClock, LiveScene

    bpy.ops.hfx.add_response_filter(kind="impact")
    ball.hfx.response[0].decay, ball.hfx.response[0].full_speed = DECAY_S, 2.0
    scene, now = bpy.context.scene, [100.0]
    live = LiveScene(scene, bpy.context.view_layer, STANDARD)
    live.clock = LiveClock(scene, lambda: now[0])
    levels = []
    for frame in range(14):
        scene.frame_set(frame)
        now[0] += 1 / FPS
        runs = live.runs()
        levels.append(float(runs[0].levels[0]) if runs else 0.0)
        assert all(run.indices.tolist() == [0] for run in runs)
    hit = int(np.argmax(levels))
    assert levels[hit] == pytest.approx(0.5, rel=0.02) and not any(levels[:hit])
    assert live.rings
    now[0] += 0.05  # nothing moves but the clock
    (run,) = live.runs()
    assert run.levels[0] == pytest.approx(levels[-1] * np.exp(-0.05 / DECAY_S), rel=1e-6)
    now[0] += 2.0
    assert not live.rings


def test_live_moments_that_do_not_follow_each_other_do_not_hit(ball: Any) -> None:
    from hfx_blender.reading.live_scene import LiveClock

    scene, now = bpy.context.scene, [5.0]
    clock = LiveClock(scene, lambda: now[0])
    scene.frame_set(3)
    assert clock.tick() == (3 / FPS, None)
    scene.frame_set(4)
    time_s, step_s = clock.tick()
    assert time_s == pytest.approx(4 / FPS) and step_s == pytest.approx(1 / FPS)
    now[0] += 0.1  # dragged
    time_s, step_s = clock.tick()
    assert time_s == pytest.approx(4 / FPS + 0.1) and step_s == pytest.approx(0.1)
    for frame in (24, 2):  # scrubbed
        scene.frame_set(frame)
        assert clock.tick()[1] is None
    now[0] += 9.0
    assert clock.tick()[1] is None
