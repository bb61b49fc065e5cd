# SPDX-License-Identifier: GPL-3.0-or-later
"""A track plays on devices in step with the timeline, without an evaluation of the scene."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from test_live import PAD, go, is_loud, log, play, rows, until  # noqa: F401

from hfx_blender.devices.live.host_pipe import Event
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.live import live_handlers
from hfx_blender.playback.live.live import live

pytestmark = pytest.mark.usefixtures("patient_devices")


def test_a_track_plays_in_place_of_the_scene(
    log: Path,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(log)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 24
    bpy.ops.hfx.record_track()
    hfx = bpy.context.scene.hfx
    assert hfx.live_source == "TRACK"
    until(lambda: not live.is_armed)  # recording stopped playback; only Play starts again
    bpy.context.object.hfx.is_muted = True  # the scene itself is silent from now on

    def evaluated(*_: object) -> None:
        raise AssertionError("the scene was evaluated")

    with monkeypatch.context() as patched:
        patched.setattr(evaluation, "describe", evaluated)
        patched.setattr(evaluation, "runs", evaluated)
        go(15)
        assert not is_loud(log)
        play(log)
        until(lambda: rows(log)[-1]["values"][0] == 5.0)
        go(5)  # before the clip
        until(lambda: not is_loud(log))
        go(15)
        until(lambda: is_loud(log))
        # After the end no moment reaches the devices, whose scripts would be called with it.
        with monkeypatch.context() as outside:
            shown: list[object] = []
            outside.setattr(live.client, "show", shown.append)
            go(30)
            until(lambda: not is_loud(log))
            assert shown == []
        go(15)
        until(lambda: is_loud(log))
        hfx.devices[PAD].is_muted = True
        until(lambda: not is_loud(log))
        hfx.devices[PAD].is_muted = False
        until(lambda: is_loud(log))

    whole = Path(hfx.live_track).read_bytes()
    cut = tmp_path / "cut.hfxtrack"
    cut.write_bytes(whole[: len(whole) // 2])
    hfx.live_track = str(cut)
    until(lambda: "stop" in rows(log)[-1] and not live.is_armed)
    assert "cut.hfxtrack: not a HapticTrack" in live.fault
    hfx.live_source = "SCENE"
    bpy.context.object.hfx.is_muted = False
    bpy.context.view_layer.update()
    play(log)


def test_a_device_that_blender_was_too_slow_for_waits_for_play(
    log: Path,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(log)
    text = "Blender did not answer for 250 ms"
    for state in live.states.values():
        state.update(Event("frozen", state.number, text))
    assert not live.is_armed
    assert "frozen" in [state.state for state in live.states.values()]
    live.client.stop(PAD)  # type: ignore[union-attr]
    until(lambda: "stop" in rows(log)[-1])
    count = len(rows(log))
    monkeypatch.setattr(live_handlers, "is_playing", lambda: True)
    for frame in range(12, 18):  # Blender's own playback
        go(frame)
        live.handlers.beat()
    assert all("stop" in row for row in rows(log)[count:]) and not live.is_armed
    bpy.ops.hfx.live_play()
    until(lambda: live.is_armed)
