# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking ahead for actuators that answer late: what is read of what comes, and when."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.devices.live.playhead import Playhead
from hfx_blender.devices.workers.messages import MessageError
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.keyed_scene import KeyedBlock, KeyedScene
from hfx_blender.engine.response_filters.controls import Filter, FilterKind
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import HapticSurface, HapticVolume
from hfx_blender.engine.serialization import decode_object
from hfx_blender.engine.volume.shape import Falloff
from hfx_blender.playback.live import lookahead_scheduler
from hfx_blender.playback.live.lookahead_scheduler import LookaheadScheduler, PlaybackDirection
from hfx_blender.reading.curves import keyframe_reader
from hfx_blender.reading.description.scene_tolerance import scene_tolerance
from hfx_blender.reading.live.live_scene import LiveScene

LATE_MS = (20.0, 80.0)


@pytest.fixture
def ball(scene: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A volume that goes through an avatar, at frames 1 to 24; nothing has to settle."""
    monkeypatch.setattr(lookahead_scheduler, "SETTLE_S", 0.0)
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 24, 24
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name="Ball", radius=0.3)
    found = bpy.context.object
    for frame, x in ((1, -1.0), (24, 1.0)):
        found.location = x, 0.0, 1.2
        found.keyframe_insert("location", frame=frame)
    return found


class Reading:
    """Record of the messages of a reader, slice after slice."""

    def __init__(self) -> None:
        self.lookahead = LookaheadScheduler()
        self.lookahead.set_latencies(LATE_MS)
        self.scenes: list[KeyedScene] = []
        self.blocks: list[KeyedBlock] = []
        self.describe()

    def describe(self) -> None:
        scene, layer = bpy.context.scene, bpy.context.view_layer
        layer.update()
        self.live = LiveScene(scene, layer, scene_tolerance(scene))

    def tell(self, body: bytes, is_scene: bool) -> None:
        found = decode_object(body)
        (self.scenes if is_scene else self.blocks).append(found)

    def slices(self, count: int, is_playing: bool = False) -> None:
        for _ in range(count):
            playhead = self.lookahead.playhead(bpy.context.scene, is_playing)
            self.lookahead.work(playhead, self.live, self.tell)

    @property
    def frames(self) -> list[float]:
        return [frame for block in self.blocks for frame in block.frames.tolist()]


def test_what_comes_is_felt_as_it_is_when_the_scene_stands_there(ball: Any) -> None:
    reading = Reading()
    reading.slices(30)
    (described,) = reading.scenes
    engine = Engine(described.description, record=described.record, tolerance=described.tolerance)
    coming = [
        (frame, block, row)
        for block in reading.blocks
        for row, frame in enumerate(block.frames.tolist())
    ]
    touched = 0
    for frame, block, row in sorted(coming, key=lambda each: each[0])[::5]:
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1.0)
        there = reading.live.runs()
        ahead = engine.evaluate(block.at(row, described))
        assert [run.stream for run in ahead] == [run.stream for run in there]
        for one, other in zip(ahead, there, strict=True):
            touched += len(one.vertices)
            # Blender's matrices have 32 bits: a point of skin on the very edge is in or out.
            assert np.abs(felt(one) - felt(other)).sum() < 0.002 * felt(other).sum() + 0.1
            assert one.parameters.tolist() == other.parameters.tolist()
    assert touched


def felt(run: SampleRun) -> np.ndarray:
    """Strength at each vertex."""
    found = np.zeros(100_000)
    found[run.vertices] = run.weights
    return found


def test_every_frame_that_is_wanted_is_read_once_and_what_comes_first_first(ball: Any) -> None:
    bpy.context.scene.frame_set(10)
    reading = Reading()
    reading.slices(40)
    frames = reading.frames
    assert len(frames) == len(set(frames))
    for frame in range(1, 25):
        for ms in LATE_MS:
            wanted = Playhead(frame, 1, 24, 24.0, True).after(ms)
            assert any(abs(wanted - read) < 1e-4 for read in frames), (frame, ms)
    assert 10.0 <= frames[0] < 12.0
    before = len(frames)
    reading.slices(3)
    assert len(reading.frames) == before


def test_nothing_is_read_if_nothing_answers_late(ball: Any) -> None:
    reading = Reading()
    reading.lookahead.set_latencies(())
    reading.slices(3)
    assert not reading.scenes and not reading.blocks


def test_an_edit_is_another_edition_that_is_read_anew_when_it_has_settled(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading = Reading()
    reading.slices(3)
    first = reading.lookahead.edition
    monkeypatch.setattr(lookahead_scheduler, "SETTLE_S", 1000.0)
    ball.location.z = 0.9
    ball.keyframe_insert("location", frame=12)
    reading.lookahead.edited([("Action", ball.animation_data.action.name)])
    reading.slices(3)
    assert len(reading.scenes) == 1 and reading.lookahead.edition > first
    reading.lookahead._due_s = 0.0
    reading.blocks.clear()
    reading.slices(30)
    assert reading.scenes[-1].edition == reading.blocks[0].edition == reading.lookahead.edition
    (at_12,) = (
        block.effects[0].matrices[row]
        for block in reading.blocks
        for row, frame in enumerate(block.frames.tolist())
        if frame == 12.0 and block.effects[0].matrices is not None
    )
    assert at_12[2, 3] == pytest.approx(0.9)


def test_bodies_are_read_anew_only_if_something_that_they_follow_changed(ball: Any) -> None:
    reading = Reading()
    reading.slices(1)
    before = reading.lookahead._reader
    assert before is not None
    reading.lookahead.edited([("Object", ball.name)])
    reading.slices(1)
    kept = reading.lookahead._reader
    assert kept is not None and kept is not before and kept._bodies is before._bodies
    body = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    reading.lookahead.edited([("Object", ball.name)])
    reading.lookahead.edited([("Object", body.name)])
    reading.slices(1)
    anew = reading.lookahead._reader
    assert anew is not None and anew._bodies is not before._bodies


def test_long_scenes_are_read_a_stretch_at_a_time(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lookahead_scheduler, "_STRETCH_S", 0.1)
    monkeypatch.setattr(lookahead_scheduler, "_COUNTS", (1, 1))
    reading = Reading()
    reading.lookahead._count = 1
    reading.slices(2)
    first = reading.lookahead._bytes  # of one frame
    monkeypatch.setattr(lookahead_scheduler, "MOST_BYTES", 12 * first)
    reading.slices(12)
    assert len(reading.scenes) == 1
    assert max(reading.frames) < 1 + 24 * 0.3  # nothing far ahead was read
    monkeypatch.setattr(lookahead_scheduler, "MOST_BYTES", first)
    reading.slices(3)
    assert len(reading.scenes) > 1  # what lies behind is dropped


def test_what_is_moved_otherwise_says_why(ball: Any) -> None:
    ball.constraints.new("COPY_LOCATION")
    reading = Reading()
    reading.slices(3)
    assert "constraints" in reading.lookahead.reason and not reading.scenes


def area_of(kind: str) -> Any:
    if kind == "a surface":
        return HapticSurface.__new__(HapticSurface)
    return HapticVolume(Falloff(), response=(Filter(FilterKind.IMPACT),))


@pytest.mark.parametrize("kind", ["a surface", "depends on what was before"])
def test_what_depends_on_what_was_before_is_not_known_ahead(kind: str) -> None:
    effect = SimpleNamespace(area=area_of(kind), name="Ball")
    live = SimpleNamespace(
        description=SimpleNamespace(effects=(effect,)), objects=SimpleNamespace(effects=[1])
    )
    assert kind in keyframe_reader._why_not(live)  # type: ignore[arg-type]
    live.objects.effects = []
    assert "instances" in keyframe_reader._why_not(live)  # type: ignore[arg-type]


def test_what_a_handler_of_others_may_do_is_not_known_ahead(ball: Any) -> None:
    def mine(*_: object) -> None: ...

    bpy.app.handlers.frame_change_pre.append(mine)
    try:
        reading = Reading()
        reading.slices(3)
    finally:
        bpy.app.handlers.frame_change_pre.remove(mine)
    assert "handler 'mine'" in reading.lookahead.reason and not reading.scenes


def test_what_cannot_be_told_is_a_reason_and_no_fault(
    ball: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> bytes:
        raise MessageError("a message of 17000000 bytes")

    monkeypatch.setattr(lookahead_scheduler, "encode_object", refused)
    reading = Reading()
    reading.slices(3)
    assert "17000000 bytes" in reading.lookahead.reason


def test_another_playback_range_is_read_too(ball: Any) -> None:
    reading = Reading()
    reading.slices(40)
    bpy.context.scene.frame_end = 30
    reading.slices(40)
    assert any(frame > 29.0 for frame in reading.frames)


def test_the_way_of_playback_is_seen_in_its_frames() -> None:
    way = PlaybackDirection()
    assert [way.at(k, 24, True) for k in (1, 2, 3, 23, 24, 1, 2)] == [1] * 7
    assert [way.at(k, 24, True) for k in (20, 21, 5, 6, 7)] == [1] * 5  # jumps
    assert [way.at(k, 24, True) for k in (6, 5, 4, 3, 1, 24, 23)] == [1, -1, -1, -1, -1, -1, -1]
    assert way.at(22, 24, False) == 1  # scrubbing


def test_a_selection_is_no_edit(ball: Any) -> None:
    class Update:
        def __init__(self, of: Any) -> None:
            self.id = of

    class Graph:
        updates = (Update(bpy.context.scene),)

    assert not lookahead_scheduler.changed_by(Graph())  # type: ignore[arg-type]
    Graph.updates = (*Graph.updates, Update(ball))
    assert list(lookahead_scheduler.changed_by(Graph())) == [("Object", ball.name)]  # type: ignore[arg-type]


def test_reading_a_slice_does_not_move_the_scene(ball: Any) -> None:
    bpy.context.scene.frame_set(7)
    where = np.array(ball.matrix_world)
    Reading().slices(5)
    assert bpy.context.scene.frame_current == 7
    assert np.array(ball.matrix_world).tolist() == where.tolist()
