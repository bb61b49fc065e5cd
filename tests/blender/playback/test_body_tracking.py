# SPDX-License-Identifier: GPL-3.0-or-later
"""A body follows a tracked person; every end gives back the pose before."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest
from mathutils import Quaternion, Vector

from hfx_blender.avatars.tracked_rig import POSE_BEFORE, HumanPose
from hfx_blender.blender import compat, events
from hfx_blender.files import resources
from hfx_blender.playback.live import body_tracking as module
from hfx_blender.playback.live import live as live_module
from hfx_blender.playback.live.body_tracking import body_tracking
from hfx_blender.playback.live.live import live

pytestmark = pytest.mark.usefixtures("patient_devices")

PAD = "back_pad"
LOWERED = HumanPose({"LeftUpperArm": Quaternion((0, 1, 0), math.pi / 2)})


class Person:
    """Stand-in for a receiver: poses in a list, each given once."""

    title = "Person"

    def __init__(self, *poses: HumanPose | Exception) -> None:
        self.poses = list(poses)
        self.is_closed = False

    def pose(self) -> HumanPose | None:
        pose = self.poses.pop(0) if self.poses else None
        if isinstance(pose, Exception):
            raise pose
        return pose

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def avatar(scene: Any) -> Iterator[bpy.types.Object]:
    bpy.ops.hfx.add_avatar()
    yield bpy.context.object
    body_tracking.stop_all()


def tracked(avatar: bpy.types.Object, *poses: HumanPose | Exception) -> Person:
    person = Person(*poses)
    body_tracking.start(avatar, person)
    return person


def arm(avatar: bpy.types.Object) -> Vector:
    """Unit direction of the posed left upper arm."""
    bpy.context.view_layer.update()
    bones = avatar.pose.bones
    return (bones["lowerarm01.L"].head - bones["upperarm01.L"].head).normalized()


def test_a_body_follows_until_the_end(avatar: Any) -> None:
    before = arm(avatar)
    person = tracked(avatar, LOWERED)
    body_tracking.step()
    assert (arm(avatar) - Vector((0, 0, -1))).length < 1e-3
    assert body_tracking.step() == module.STEP_S  # nothing new: stays
    assert (arm(avatar) - Vector((0, 0, -1))).length < 1e-3
    body_tracking.stop_all()
    assert (arm(avatar) - before).length < 1e-6 and person.is_closed
    assert body_tracking.step() is None
    assert not events.is_waiting(body_tracking.step)


def test_a_playing_animation_is_not_disturbed(avatar: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    before = arm(avatar)
    tracked(avatar, LOWERED)
    monkeypatch.setattr(module, "is_playing", lambda: True)
    body_tracking.step()
    assert (arm(avatar) - before).length < 1e-6


@pytest.mark.parametrize("ending", ["undo_pre", "redo_pre", "load_pre"])
def test_undo_and_another_file_end_the_tracking(avatar: Any, ending: str) -> None:
    before = arm(avatar)
    person = tracked(avatar, LOWERED)
    body_tracking.step()
    arm(avatar)
    for handler in list(getattr(bpy.app.handlers, ending)):
        handler(bpy.context.scene, None)
    assert person.is_closed and not body_tracking.trackers
    assert (arm(avatar) - before).length < 1e-6


def test_a_file_saved_while_tracked_opens_with_the_pose_before(avatar: Any, tmp_path: Path) -> None:
    before = arm(avatar)
    name = avatar.name
    tracked(avatar, LOWERED)
    body_tracking.step()
    assert (arm(avatar) - before).length > 0.1
    path = tmp_path / "tracked.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    opened = bpy.data.objects[name]
    assert (arm(opened) - before).length < 1e-6 and POSE_BEFORE not in opened


def test_an_undo_step_pushed_while_tracked_has_the_pose_before(avatar: Any) -> None:
    before, name = arm(avatar), avatar.name
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.ed.undo_push(message="Start")
    tracked(avatar, LOWERED)
    body_tracking.step()
    arm(avatar)
    bpy.ops.ed.undo_push(message="Edit one")
    bpy.context.scene.frame_end = 77
    bpy.ops.ed.undo_push(message="Edit two")
    bpy.ops.ed.undo()
    assert bpy.context.scene.frame_end != 77
    assert (arm(bpy.data.objects[name]) - before).length < 1e-6
    assert not body_tracking.trackers


def test_errors_end_the_tracking_with_one_sentence(avatar: Any) -> None:
    before = arm(avatar)
    person = tracked(avatar, LOWERED, RuntimeError("socket"))
    body_tracking.step()
    assert body_tracking.step() is None
    assert person.is_closed and body_tracking.fault == "RuntimeError: socket"
    assert (arm(avatar) - before).length < 1e-6
    tracked(avatar, LOWERED)
    avatar.data.bones["upperarm01.L"].name = "renamed"
    body_tracking.step()
    assert "'upperarm01.L' is missing" in body_tracking.fault
    tracked(avatar, LOWERED)
    bpy.data.objects.remove(avatar)
    body_tracking.step()
    assert body_tracking.fault == "A tracked body was deleted." and not body_tracking.trackers


def test_an_error_stops_the_devices_before_anything_that_waits(
    avatar: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    person = tracked(avatar, RuntimeError("socket"))
    monkeypatch.setattr(person, "close", lambda: order.append("closed"))
    monkeypatch.setattr(live, "stop_all", lambda reason: order.append(f"stopped: {reason}"))
    monkeypatch.setattr(module._log, "error", lambda *_, **__: order.append("logged"))
    body_tracking.step()
    assert order == ["stopped: RuntimeError: socket", "closed", "logged"]


def test_a_recording_is_an_action_of_keys(avatar: Any) -> None:
    scene = bpy.context.scene
    scene.frame_set(5)
    person = tracked(avatar, LOWERED)
    tracker = body_tracking.of(avatar)
    assert tracker is not None
    body_tracking.record(tracker, scene)
    body_tracking.step()
    time.sleep(0.2)
    person.poses = [HumanPose({})]
    body_tracking.step()
    action = body_tracking.finish_recording(tracker, scene)
    assert person.is_closed and avatar.animation_data.action == action
    scene.frame_set(5)
    assert (arm(avatar) - Vector((0, 0, -1))).length < 1e-3
    curves = compat.fcurves(avatar)
    frames = [point.co[0] for point in curves[0].keyframe_points]
    # 0.2 s and a little more, 24 frames a second
    assert frames[:5] == [5.0, 6.0, 7.0, 8.0, 9.0] and len(frames) < 15


@pytest.fixture
def log(
    avatar: bpy.types.Object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    """Log of a pad that vibrates without a pause."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    monkeypatch.setattr(live_module, "HOLD_S", 600.0)
    live.close()
    bpy.ops.hfx.add_painted(modality="vibration", name="Rumble")
    bpy.ops.hfx.fill_part(part="torso", side="both")
    bpy.context.object.hfx.amplitude = 5.0
    bpy.ops.hfx.live_add(name=PAD)
    path = tmp_path / "pad.jsonl"
    bpy.ops.hfx.live_connect(name=PAD, kind="SIMULATOR", path=str(path))
    yield path
    live.close()


def level(log: Path) -> float:
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    rows = [json.loads(line) for line in lines]
    values = [row["values"][0] for row in rows if "values" in row]
    return float(values[-1]) if values else 0.0


def until(happened: Callable[[], object]) -> None:
    """Act as Blender's main loop: call the timers of the devices."""
    end = time.monotonic() + 120.0
    while not happened():
        assert time.monotonic() < end, f"never happened: {live.states} {live.fault}"
        live.handlers.beat()
        if events.is_waiting(live.handlers.describe):
            events.remove_timers(live.handlers.describe)
            live.handlers.describe()
        time.sleep(0.005)


def test_a_lost_sender_fades_the_devices_to_silence_and_back(log: Path, avatar: Any) -> None:
    until(lambda: live.is_armed)
    until(lambda: level(log) > 0.0)
    whole = level(log)
    person = tracked(avatar, HumanPose({}))
    body_tracking.step()
    tracker = body_tracking.of(avatar)
    assert tracker is not None
    tracker.begun_s = time.monotonic() - module.LOST_S - module.FADE_S / 2
    body_tracking.step()
    assert tracker.is_lost
    until(lambda: 0.3 * whole < level(log) < 0.6 * whole)
    tracker.begun_s -= module.FADE_S  # 2 s after the last pose in all
    body_tracking.step()
    until(lambda: level(log) == 0.0)
    person.poses = [HumanPose({})]
    body_tracking.step()
    assert not tracker.is_lost
    until(lambda: level(log) == pytest.approx(whole))
