# SPDX-License-Identifier: GPL-3.0-or-later
"""A track plays on devices in step with the timeline, without an evaluation of the scene."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from test_live import PAD, go, is_loud, log, play, rows, until  # noqa: F401

from hfx_blender.playback import live as live_module
from hfx_blender.playback import live_handlers
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.live import live

pytestmark = pytest.mark.usefixtures("patient_devices")


@pytest.fixture
def recorded(log: Path, monkeypatch: pytest.MonkeyPatch) -> Path:  # noqa: F811
    """Connected pad that plays a recorded track; the scene is muted since, and not evaluated."""
    play(log)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 24
    bpy.ops.hfx.record_track()
    assert bpy.context.scene.hfx.live_source == "TRACK"
    until(lambda: not live.is_armed)
    bpy.context.object.hfx.is_muted = True
    evaluation.forget()

    def evaluated(*_: object) -> None:
        raise AssertionError("the scene was evaluated")

    monkeypatch.setattr(evaluation, "describe", evaluated)
    monkeypatch.setattr(evaluation, "runs", evaluated)
    return log


def test_a_track_follows_the_timeline_and_the_scene_is_not_evaluated(recorded: Path) -> None:
    go(15)
    assert not is_loud(recorded)  # recording has stopped it; only Play plays
    play(recorded)
    until(lambda: rows(recorded)[-1]["values"][0] == 5.0)
    go(5)  # before its clip
    until(lambda: not is_loud(recorded))
    go(15)
    until(lambda: is_loud(recorded))
    go(30)  # after the end
    until(lambda: not is_loud(recorded))
    assert live.is_armed


def test_a_track_stands_still_mutes_and_stops_like_a_scene(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(recorded)
    item = bpy.context.scene.hfx.devices[PAD]
    item.is_muted = True
    until(lambda: not is_loud(recorded))
    item.is_muted = False
    until(lambda: is_loud(recorded))
    monkeypatch.setattr(live_module, "HOLD_S", 0.0)
    until(lambda: not is_loud(recorded))
    bpy.ops.hfx.live_stop_all()
    until(lambda: "stop" in rows(recorded)[-1] and not live.is_armed)


def test_a_damaged_track_is_silence_and_says_why(recorded: Path, tmp_path: Path) -> None:
    play(recorded)
    whole = Path(bpy.context.scene.hfx.live_track).read_bytes()
    cut = tmp_path / "cut.hfxtrack"
    cut.write_bytes(whole[: len(whole) // 2])
    bpy.context.scene.hfx.live_track = str(cut)
    until(lambda: "stop" in rows(recorded)[-1] and not live.is_armed)
    assert "cut.hfxtrack: not a HapticTrack" in live.fault


def test_the_way_back_to_the_scene_is_silence_at_first(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(recorded)
    monkeypatch.undo()
    bpy.context.scene.hfx.live_source = "SCENE"
    until(lambda: not is_loud(recorded))
    live_handlers._describe()
    bpy.context.object.hfx.is_muted = False
    bpy.context.view_layer.update()
    until(lambda: is_loud(recorded))
