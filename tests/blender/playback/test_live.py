# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected devices follow the open scene; every end of playback silences the devices."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

import hfx_blender
from hfx_blender.authoring import clips
from hfx_blender.blender import compat, events
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations import person_profile
from hfx_blender.devices.live import discovery, live_settings
from hfx_blender.devices.live.discovery import FoundPort
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.track import SUFFIX, TrackReader
from hfx_blender.errors import DeviceError
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.files import resources
from hfx_blender.operators.live import connect_operators
from hfx_blender.operators.live.live_operators import HFX_OT_live_person
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.live import live as live_module
from hfx_blender.playback.live import live_handlers
from hfx_blender.playback.live.latency import uncompensated
from hfx_blender.playback.live.live import live
from hfx_blender.playback.preview.preview import preview as viewport_preview
from hfx_blender.playback.preview.preview_layers import Preview
from hfx_blender.playback.timeline.timeline_recorder import recorder
from hfx_blender.reading.description.scene_settings import scene_tolerance
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped import stepping
from hfx_tools.track_rendering import render_devices

pytestmark = pytest.mark.usefixtures("patient_devices")

PAD = "back_pad"
PATIENCE_S = 120.0


@pytest.fixture
def log(scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A vibrating back in the scene, and the log file of a connected simulated pad."""
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path / "data"))
    # On a busy machine rendering may take seconds to start; tests of a scene at rest wait for the
    # start.
    monkeypatch.setattr(live_module, "HOLD_S", 600.0)
    live.close()  # a connection of an earlier test was less patient
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="vibration", name="Rumble")
    bpy.ops.hfx.fill_part(part="torso", side="both")
    bpy.context.object.hfx.amplitude = 5.0
    clips.add_clip(bpy.context.object, 10, 20)
    bpy.ops.hfx.live_add(name=PAD)
    path = tmp_path / "pad.jsonl"
    bpy.ops.hfx.live_connect(name=PAD, kind="SIMULATOR", path=str(path))
    yield path
    live.close()


def rows(log: Path) -> list[dict[str, Any]]:
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    return [json.loads(line) for line in lines]


def is_loud(log: Path) -> bool:
    actual = rows(log)
    return bool(actual) and "values" in actual[-1] and actual[-1]["values"][0] > 0.0


def until(happened: Callable[[], object]) -> None:
    """Act as Blender's main loop: call the timers."""
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end, f"never happened: {live.states} {live.fault}"
        live.handlers.beat()
        if events.is_waiting(live.handlers.describe):
            events.remove_timers(live.handlers.describe)
            live.handlers.describe()
        time.sleep(0.005)


def test_a_device_plays_on_the_body_chosen_as_wearer(log: Path) -> None:
    play(log)
    bpy.ops.hfx.add_avatar()
    second = bpy.context.object
    item = bpy.context.scene.hfx.devices[PAD]
    item.body = second  # the effect is painted on the first body
    until(lambda: live.states[PAD].body_id == second.hfx.uid)
    until(lambda: not is_loud(log))
    item.body = None
    until(lambda: is_loud(log))


def test_a_device_on_a_copied_body_does_not_play_the_original(log: Path) -> None:
    play(log)
    (first,) = (obj for obj in bpy.context.scene.objects if obj.hfx.role == "BODY")
    copy = first.copy()  # as Shift D: with the id of the original
    bpy.context.scene.collection.objects.link(copy)
    item = bpy.context.scene.hfx.devices[PAD]
    item.body = copy
    until(lambda: live.states[PAD].body_id not in ("", first.hfx.uid))
    until(lambda: not is_loud(log))
    item.body = first
    until(lambda: is_loud(log))
    copy.hide_viewport = True
    item.body = copy  # a body that is left out feels nothing
    until(lambda: not is_loud(log))


def go(frame: int) -> None:
    bpy.context.scene.frame_set(frame)


def play(log: Path) -> None:
    pressed = time.monotonic()

    def plays() -> bool:
        """Presses Play again if Blender was too slow while a device was opened."""
        nonlocal pressed
        if not live.is_armed and time.monotonic() - pressed > 0.5:
            pressed = time.monotonic()
            live.arm()
        return live.is_armed

    until(plays)
    live.handlers.describe()
    go(15)
    until(lambda: is_loud(log))


def test_a_device_follows_the_frame(log: Path) -> None:
    play(log)
    go(5)
    until(lambda: not is_loud(log))
    go(15)
    until(lambda: is_loud(log))


def test_a_device_is_sent_what_an_export_renders(log: Path, tmp_path: Path) -> None:
    play(log)
    until(lambda: rows(log)[-1]["values"][0] == 5.0)
    live_scene = LiveScene(
        bpy.context.scene, bpy.context.view_layer, scene_tolerance(bpy.context.scene)
    )
    device = load_device(PAD)
    now = MomentRenderer(live_scene.description, device).values(live_scene.runs())
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 24
    export_scene(bpy.context.scene, tmp_path, "x", ExportSettings(full_precision=True))
    with TrackReader(tmp_path / f"x{SUFFIX}") as track:
        ((_, exported),) = render_devices(track, [device])
    at = int(np.argmin(np.abs(exported.times_s - 14 / 24)))
    assert now.any()
    assert now.tolist() == exported.values[at].tolist()


def test_a_blend_cannot_name_a_file(log: Path, tmp_path: Path) -> None:
    bpy.context.scene.hfx.devices.add().name = str(tmp_path / "evil.json")
    with pytest.raises(RuntimeError, match="never chooses files"):
        bpy.ops.hfx.live_connect(name=str(tmp_path / "evil.json"))


def test_dragging_is_felt_at_once(log: Path) -> None:
    play(log)
    go(5)
    until(lambda: not is_loud(log))
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.3, location=(5, 0, 1.2)
    )
    ball = bpy.context.object
    bpy.context.view_layer.update()
    until(lambda: not events.is_waiting(live.handlers.describe))
    ball.location.x = 0.0
    bpy.context.view_layer.update()
    until(lambda: is_loud(log))


def test_mute_and_gain_are_of_the_device(log: Path) -> None:
    play(log)
    item = bpy.context.scene.hfx.devices[PAD]
    item.gain = 0.5
    go(16)
    until(lambda: rows(log)[-1]["values"][0] == 2.5)
    item.is_muted = True  # and nothing else happens in Blender
    until(lambda: not is_loud(log))
    item.is_muted = False
    until(lambda: is_loud(log))


def test_what_stands_still_is_silent_after_a_while(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(log)
    monkeypatch.setattr(live_module, "HOLD_S", 0.0)
    until(lambda: not is_loud(log))
    assert live.is_armed
    monkeypatch.setattr(live_module, "HOLD_S", 60.0)
    go(16)
    until(lambda: is_loud(log))


STOPS = {
    "the button": lambda: bpy.ops.hfx.live_stop_all(),
    "another file": lambda: bpy.ops.wm.read_homefile(use_empty=True),
    "an undo": lambda: live.handlers.on_undo(),  # nothing can be undone without a window
    "a fault here": lambda: live.stop_all("fault"),
}


@pytest.mark.parametrize("name", STOPS)
def test_after_a_stop_only_play_plays(log: Path, name: str) -> None:
    play(log)
    STOPS[name]()
    until(lambda: "stop" in rows(log)[-1] and not live.is_armed)
    count = len(rows(log))
    go(16)
    for _ in range(10):
        live.handlers.beat()
        time.sleep(0.01)
    assert all("stop" in row for row in rows(log)[count:])
    bpy.ops.hfx.live_play()
    until(lambda: live.is_armed)


def test_undo_and_load_are_listened_to_only_while_a_device_is_connected(log: Path) -> None:
    names = ("undo_pre", "redo_pre", "load_pre", "frame_change_post", "depsgraph_update_post")

    def here(name: str) -> list[Any]:
        return getattr(bpy.app.handlers, name)

    def ours() -> list[bool]:
        return [
            any(getattr(entry, "__self__", None) is live.handlers for entry in here(n))
            for n in names
        ]

    assert ours() == [True] * 5
    for name in names[:3]:  # before slow handlers of other add-ons
        assert here(name)[0].__self__ is live.handlers
    bpy.ops.hfx.live_disconnect(name=PAD)
    assert ours() == [False] * 5
    assert not events.is_waiting(live.handlers.beat)


def test_disabling_the_add_on_is_silence(log: Path) -> None:
    play(log)
    hfx_blender.unregister()
    try:
        assert "stop" in rows(log)[-1]
        assert not live.states
    finally:
        hfx_blender.register()


def test_an_error_of_ours_stops_and_is_told(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    play(log)

    def broken(*_: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(live_module.Live, "update", broken)
    go(16)
    until(lambda: "stop" in rows(log)[-1])
    assert "ZeroDivisionError" in live.fault
    bpy.ops.wm.read_homefile(use_empty=True)
    assert live.fault == "", "of another file"


def test_an_error_stops_before_it_is_logged(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    monkeypatch.setattr(live, "stop_all", lambda reason: order.append("stopped"))
    monkeypatch.setattr(live_handlers._log, "error", lambda *_, **__: order.append("logged"))
    monkeypatch.setattr(live, "exchange_heartbeat", lambda: 1 // 0)
    live.handlers.beat()
    assert order == ["stopped", "logged"]


def test_an_export_is_not_played(log: Path) -> None:
    play(log)
    go(5)
    until(lambda: not is_loud(log))
    count = len(rows(log))
    with stepping.own_scene(SceneReader(bpy.context.scene).found):
        go(15)
        live.handlers.beat()
        time.sleep(0.05)
        live.handlers.beat()
    time.sleep(0.05)
    assert not any(row["values"][0] for row in rows(log)[count:] if "values" in row)


def test_something_that_was_deleted_is_no_fault(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    play(log)

    def deleted(*_: object) -> bool:
        raise ReferenceError("StructRNA of type Object has been removed")

    with monkeypatch.context() as patched:
        patched.setattr(live_module.Live, "exchange_heartbeat", deleted)
        assert live.handlers.beat() > 0.0  # and is called again
    assert live.fault == "" and evaluation.scene is None


def test_a_test_pulse_is_felt_at_its_actuator(log: Path) -> None:
    until(lambda: live.is_armed)
    bpy.ops.hfx.live_pulse(name=PAD, actuator=3)
    until(lambda: any(row.get("values", [0] * 99)[6] > 0.5 for row in rows(log)))


def test_a_person_is_set_up_on_a_playing_device(log: Path) -> None:
    until(lambda: live.is_armed)
    shares = {"first_felt": 10.0, "strong_enough": 40.0, "too_strong": 80.0}
    operator = bpy.ops.hfx.live_person
    with pytest.raises(RuntimeError, match="must not fall"):
        operator(name=PAD, person="ada", **shares | {"too_strong": 30.0})
    with pytest.raises(RuntimeError, match="Profile 'a b': expected"):
        operator(name=PAD, person="a b", **shares)
    assert operator(name=PAD, person="ada", **shares) == {"FINISHED"}
    device = live.device(PAD)
    assert device is not None
    marks = person_profile.load("ada")[device.id]
    assert marks.keys() == {actuator.id for actuator in device.actuators}
    for actuator in device.actuators:
        limit = actuator.type.strength.highest
        assert marks[actuator.id] == pytest.approx(
            {mark: limit * share / 100.0 for mark, share in shares.items()}
        )
    live_settings.store(PAD, live_settings.LiveSettings("CSV", profile="ada"))
    with pytest.raises(RuntimeError, match="without a profile first"):
        operator(name=PAD, person="ada", **shares)
    bpy.ops.hfx.live_stop_all()
    until(lambda: not live.is_armed)
    with pytest.raises(RuntimeError, match="is not playing"):
        operator(name=PAD, person="ada", **shares)


def test_a_strength_is_played_while_a_person_changes_it(log: Path) -> None:
    play(log)
    go(2)
    until(lambda: not is_loud(log))
    dialog = SimpleNamespace(name=PAD, first_felt=5.0, strong_enough=50.0, too_strong=100.0)
    for name in ("_device", "_marks", "_play"):
        setattr(dialog, name, partial(getattr(HFX_OT_live_person, name), dialog))
    dialog._shown = dialog._marks(dialog._device())
    dialog.strong_enough = 60.0
    assert HFX_OT_live_person.check(dialog, bpy.context)
    until(lambda: is_loud(log))
    go(3)  # the clip of the scene begins at frame 10
    count = len(rows(log))
    until(lambda: len(rows(log)) > count + 20)
    assert is_loud(log), "the scene at rest does not silence the strength"
    HFX_OT_live_person.cancel(dialog, bpy.context)
    until(lambda: not is_loud(log))
    live.stop_all()
    until(lambda: not live.is_armed)
    dialog.strong_enough = 70.0
    assert HFX_OT_live_person.check(dialog, bpy.context)
    HFX_OT_live_person.cancel(dialog, bpy.context)


def test_how_a_device_is_connected_is_remembered_outside_the_file(log: Path) -> None:
    settings = live_settings.LiveSettings("CSV", path="/somewhere", offset_ms=35.0)
    live_settings.store(PAD, settings)
    assert live_settings.load()[PAD] == settings
    resources.live_settings().write_text('{"back_pad": {"kind": 3, "offset_ms": NaN}, "x": []}')
    assert live_settings.load() == {PAD: live_settings.LiveSettings()}


def test_a_frame_is_evaluated_once_for_devices_and_preview(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(log)
    preview = Preview()
    preview.invalidate()
    preview.describe(bpy.context)
    calls: list[float] = []
    runs = LiveScene.runs

    def counted(self: LiveScene) -> list[Any]:
        calls.append(bpy.context.scene.frame_current)
        return runs(self)

    monkeypatch.setattr(LiveScene, "runs", counted)
    preview.invalidate()  # the preview's handler runs first
    go(16)
    assert preview.layers("PAPER")
    assert calls == [16]


def test_what_moved_after_a_stop_is_felt_by_the_next_play(log: Path) -> None:
    play(log)
    go(5)
    until(lambda: not is_loud(log))
    live.stop_all()
    until(lambda: not live.is_armed)
    go(15)
    live.arm()
    if events.is_waiting(live.handlers.describe):  # before the device has armed
        events.remove_timers(live.handlers.describe)
        live.handlers.describe()
    until(lambda: is_loud(log))


def test_both_are_told_when_something_is_added(log: Path) -> None:
    play(log)
    preview = Preview()
    preview.describe(bpy.context)
    bpy.ops.hfx.add_painted(modality="pressure", name="Other")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    bpy.context.view_layer.update()
    preview.describe(bpy.context)
    go(16)  # between: renderers are of the scene before, and nothing is sent for a moment
    live.handlers.describe()
    until(lambda: is_loud(log))
    assert live.fault == ""
    assert len(evaluation.runs()) == 2


@pytest.fixture
def late(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Pad answering after half a frame, and a second device answering after 100 ms.

    100 ms are two and a half frames. All changes of the scene are noticed, as with a window.
    """
    folder = tmp_path / "devices"
    folder.mkdir()
    monkeypatch.setenv("HFX_DEVICES", str(folder))
    content = json.loads((resources.device_configs() / f"{PAD}.json").read_text())
    content["id"] = "late"
    for kind in content["actuator_types"].values():
        kind["latency_ms"] = 100.0
    (folder / "late.json").write_text(json.dumps(content))
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 24
    bpy.context.scene.render.fps = 25  # each frame is four samples of 100 Hz
    path = tmp_path / "late.jsonl"
    bpy.ops.hfx.live_add(name="late")
    bpy.ops.hfx.live_connect(name="late", kind="SIMULATOR", path=str(path))
    play(path)
    viewport_preview.listen()
    yield path
    viewport_preview.stop_listening()
    recorder.forget()


def last(path: Path) -> list[float]:
    return rows(path)[-1].get("values", [])


def test_late_actuators_are_given_what_an_export_has_when_they_answer(
    log: Path, late: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rumble = bpy.data.objects["Rumble"]
    for frame, amplitude in ((1, 1.0), (24, 24.0)):  # by a metre per second squared each frame
        rumble.hfx.amplitude = amplitude
        rumble.keyframe_insert("hfx.amplitude", frame=frame)
    for curve in compat.fcurves(rumble):
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    bpy.context.view_layer.update()
    recorder.update_now(bpy.context.scene)
    monkeypatch.setattr(live_handlers, "is_playing", lambda: True)
    for frame in (8, 11, 14):  # the clip is from 10 to 20

        def is_given(frame: int = frame) -> bool:
            go(frame)
            return last(late)[:1] == pytest.approx([frame + 2.5], rel=1e-5)

        until(is_given)
    monkeypatch.setattr(live_handlers, "is_playing", lambda: False)
    go(8)  # scrubbing: the clip has not begun
    until(lambda: not is_loud(late))


def test_a_volume_is_felt_on_time_and_only_while_the_record_is_valid(
    log: Path, late: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = bpy.context.scene
    bpy.data.objects["Rumble"].hfx.is_muted = True
    bpy.ops.hfx.add_volume(modality="vibration", shape="CUBOID", name="Box", location=(9, 0, 1.2))
    box = bpy.context.object
    for frame, x in ((1, 9.0), (12, 0.0)):  # in contact at frame 12, without approach
        box.location.x = x
        box.keyframe_insert("location", frame=frame)
    for curve in compat.fcurves(box):
        for key in curve.keyframe_points:
            key.interpolation = "CONSTANT"
    bpy.context.view_layer.update()
    live.handlers.describe()
    monkeypatch.setattr(live_handlers, "is_playing", lambda: True)

    def until_at(frame: int, of_pad: bool, of_late: bool) -> None:
        def is_so() -> bool:
            go(frame)
            return (is_loud(log), is_loud(late)) == (of_pad, of_late)

        until(is_so)

    def until_on_time() -> None:
        until_at(9, False, False)  # 100 ms later the frame is 11.5
        until_at(10, False, True)  # 100 ms later the frame is 12.5
        until_at(12, True, True)

    assert recorder.valid is None
    until_at(10, False, False)
    assert "not compensated yet" in uncompensated(scene)
    until_at(12, True, True)
    recorder.update_now(scene)
    assert uncompensated(scene) == ""
    until_on_time()
    bpy.data.objects["Box"].hfx.amplitude = 3.0  # an edit during playback
    viewport_preview.check_scene()
    bpy.context.view_layer.update()
    assert recorder.valid is None
    until_at(10, False, False)
    until_at(12, True, True)
    recorder.update_now(scene)
    until_on_time()


def test_the_offset_of_a_device_is_set_while_it_plays_and_remembered(log: Path) -> None:
    play(log)
    assert bpy.ops.hfx.live_offset(name=PAD, offset_ms=40.0) == {"FINISHED"}
    assert live.offset_ms(PAD) == 40.0
    assert live_settings.load()[PAD].offset_ms == 40.0
    assert live_settings.load()[PAD].path == str(log)  # all remaining settings unchanged
    with pytest.raises(RuntimeError, match="not connected"):
        bpy.ops.hfx.live_offset(name="other", offset_ms=40.0)


def test_a_device_that_was_found_is_added_and_connected_there(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = "arduino_uno_pwm"
    brand = load_device(board).brand
    assert brand is not None
    port = FoundPort("/dev/ttyACM7", "Uno", brand.usb[0])
    monkeypatch.setattr(connect_operators, "found", [])  # only for this test
    monkeypatch.setattr(discovery, "serial_ports", lambda: [port])
    monkeypatch.setattr(discovery, "answers", lambda host, port: False)
    assert connect_operators.find_devices() == [port.name]
    names = [entry.device for entry in connect_operators.found]
    assert board in names
    assert bpy.ops.hfx.live_find(which=str(names.index(board))) == {"FINISHED"}
    assert board in bpy.context.scene.hfx.devices
    assert live_settings.load()[board].port == port.name
    until(lambda: live.states[board].state == "lost")  # there is no such port here
    assert port.name in live.states[board].text
    assert live.states[PAD].state != "lost"


def test_a_node_map_is_imported_and_added(log: Path, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("HFX_DEVICES", str(tmp_path / "devices"))
    node = {"node_data": {"x": 0.0, "y": 1.3, "z": 0.1}, "radius": 0.03, "target_bone": "Chest"}
    (tmp_path / "my map.json").write_text(json.dumps({"nodes": [node]}))
    bpy.ops.hfx.live_import(filepath=str(tmp_path / "my map.json"), name="my_vest")
    assert "my_vest" in bpy.context.scene.hfx.devices
    assert (tmp_path / "devices" / "my_vest.json").exists()
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.hfx.live_import(filepath=str(tmp_path / "my map.json"), name="my_vest")


def test_a_device_that_nothing_drives_says_so(log: Path) -> None:
    device = load_device("pressure_vest")
    if device.output is None:
        with pytest.raises(DeviceError, match="cannot be driven live"):
            live_settings.target_of(device, live_settings.LiveSettings("DEVICE"))


def test_a_script_is_asked_about_before_it_runs(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "devices"
    folder.mkdir()
    monkeypatch.setenv("HFX_DEVICES", str(folder))
    text = (resources.device_configs() / f"{PAD}.json").read_text()
    (folder / "mine.json").write_text(text.replace(f'"id": "{PAD}"', '"id": "mine"'))
    mark = tmp_path / "was_run"
    (folder / "mine.py").write_text(
        f"open({str(mark)!r}, 'w')\ndef render(haptics):\n    return haptics.values\n"
    )
    path = tmp_path / "mine.jsonl"
    bpy.ops.hfx.live_add(name="mine")
    with pytest.raises(RuntimeError, match="read it and approve it"):
        bpy.ops.hfx.live_connect(name="mine", kind="SIMULATOR", path=str(path))
    assert "mine" in live.unapproved and not mark.exists()
    source = (folder / "mine.py").read_text()
    (folder / "mine.py").write_text(source + "def render(haptics)\n")
    with pytest.raises(RuntimeError, match=r"mine\.py, line 4: is no Python"):
        bpy.ops.hfx.live_approve(name="mine")
    (folder / "mine.py").write_text(source)
    bpy.ops.hfx.live_approve(name="mine")
    bpy.ops.hfx.live_connect(name="mine", kind="SIMULATOR", path=str(path))
    until(lambda: live.states["mine"].is_armed)
    live.handlers.describe()

    def is_played() -> bool:
        go(15)
        return is_loud(path)

    until(is_played)
    assert mark.exists()
    bpy.ops.hfx.live_revoke(name="mine")
    assert "mine" not in live.states and "mine" in live.unapproved
    with pytest.raises(RuntimeError, match="read it and approve it"):
        bpy.ops.hfx.live_connect(name="mine", kind="SIMULATOR", path=str(path))


def test_an_approval_on_the_list_is_withdrawn_also_where_its_files_are_gone(
    registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.devices.live import approval

    monkeypatch.setenv(resources.USER_DATA_VARIABLE, str(tmp_path))
    (tmp_path / "gone.json").write_bytes((resources.device_configs() / f"{PAD}.json").read_bytes())
    (tmp_path / "gone.py").write_text("render = None")
    script = approval.script_of(tmp_path / "gone.json")
    approval.approve(script)
    for path in (script.path, script.configuration):
        path.unlink()
    assert bpy.ops.hfx.live_revoke(fingerprint=script.fingerprint) == {"FINISHED"}
    assert approval.approved() == {}
    with pytest.raises(RuntimeError, match="is not approved"):
        bpy.ops.hfx.live_revoke(fingerprint=script.fingerprint)


def test_quitting_is_silence(tmp_path: Path) -> None:
    path = tmp_path / "pad.jsonl"
    source = (
        "import sys, time, bpy, patient_host\n"
        "from hfx_blender.processes import blender_session\n"
        "from hfx_blender.devices.live import live_settings\n"
        "blender_session.start()\n"
        "patient_host.use()\n"
        "from hfx_blender.playback.live.live import live\n"
        "live.connect('back_pad', live_settings.LiveSettings(path=sys.argv[1]))\n"
        "values = live.device('back_pad').neutral; values[0] = 5.0\n"
        "for _ in range(3000):\n"
        "    live.handlers.beat(); live.client.send('back_pad', values); time.sleep(0.01)\n"
        "    if '5.0' in open(sys.argv[1]).read() if live.is_armed else False: break\n"
        "sys.exit()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", source, str(path)],
        env={
            **os.environ,
            "XDG_DATA_HOME": str(tmp_path),
            "PYTHONPATH": str(Path(__file__).parents[2]),
        },
    )
    end = time.monotonic() + PATIENCE_S
    try:
        while not (rows(path) and "stop" in rows(path)[-1] and '"values"' in path.read_text()):
            assert time.monotonic() < end
            time.sleep(0.02)
    finally:
        process.kill()  # bpy may hang at exit
        process.wait()
    assert any(row.get("values", [0.0])[0] == 5.0 for row in rows(path))


def test_what_stands_still_is_silent_past_scripts() -> None:
    actual, messages = live_module.Live(), []
    device = load_device(PAD)
    actual.client = SimpleNamespace(  # type: ignore[assignment]
        send=lambda name, values: messages.append((name, values.tolist())),
    )
    for name, has_script in {"scripted": True, "plain": False}.items():
        actual.connected[name] = live_module.Connected(device, has_script, 0.0)
    actual.fade()
    assert messages == [(name, device.neutral.tolist()) for name in ("scripted", "plain")]
