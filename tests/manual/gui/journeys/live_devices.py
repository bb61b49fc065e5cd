# SPDX-License-Identifier: GPL-3.0-or-later
"""Live device in the editor: output follows scrubbing, playback and edits; Stop All is a key."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

DEVICE = "back_pad"  # vibrates, and answers 20 ms late
LAST, CLIP = 12, 6  # frames
BELOW = -4  # the panels of input, values, sound and video are below


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    set_up(h)
    log = h.out / "pad.jsonl"
    with h.context():
        bpy.ops.hfx.live_connect(name=DEVICE, kind="SIMULATOR", path=str(log))
    live = hands.module("playback.live.live").live
    # Without a graphics card a window takes longer to be drawn than a device waits for Blender.
    patient = Patience(live, log)
    threading.Thread(target=show_life, args=(live,), daemon=True).start()
    yield from h.until(patient.plays, "the simulator is connected and plays", 60)
    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 0.6
    h.shot("1_connected.png")
    recorder = hands.module("playback.timeline.timeline_recorder").recorder
    yield from h.until(lambda: recorder.valid is not None, "values over time are recorded", 60)

    yield from hands.go_to(h, 9)
    yield from h.until(patient.is_loud, "scrubbing into the clip is felt", 30)
    yield from h.until(
        lambda: patient.plays() and max(live.states[DEVICE].levels, default=0.0) > 0.0,
        "the panel shows how strongly",
        60,
    )
    h.shot("2_scrubbed.png")
    yield from hands.go_to(h, 2)
    yield from h.until(patient.is_silent, "and out of it, silence", 30)

    yield from h.move(*h.xy(h.region(), 0.3, 0.8))
    yield from h.key("space")
    begun = len(rows(log))
    yield from h.until(
        lambda: patient.plays() and patient.has_passed(begun, ["loud", "silent", "loud"]),
        "playback is felt, not before the clip, and again when it begins again",
        150,
    )
    h.shot("3_playing.png")
    h.check(h.window.screen.is_animation_playing, "and plays on")
    h.check(recorder.valid is not None, "playing is no edit: latency is compensated")
    yield from h.until(patient.plays, "the device does, too", 60)

    yield from h.key("ctrl+shift+BackSpace")
    yield from h.until(lambda: "by you" in live.states[DEVICE].text, "the key stops all", 30)
    h.check("stop" in rows(log)[-1], "with stop bytes as the last at the port")
    count = len(rows(log))
    yield 3.0
    h.shot("4_stopped.png")
    h.check(len(rows(log)) == count, "nothing follows them, though the animation plays on")
    yield from h.key("space")
    yield 0.5
    yield from h.press_button("HFX_OT_live_play")
    yield from hands.go_to(h, 9)
    yield from h.until(patient.is_loud, "Play plays again", 60)

    hands.effect("vibration").hfx.is_muted = True
    h.undo_push("Mute")
    yield from h.until(patient.is_silent, "an edit is felt at once", 30)
    yield from h.move(*h.xy(h.region(), 0.3, 0.8))
    yield 2.0
    yield from h.until(patient.plays, "it plays on", 30)
    yield from h.key("ctrl+z")
    yield from h.until(lambda: "undo" in live.states[DEVICE].text, "an undo stops all", 30)
    h.shot("5_undone.png")
    h.check(live.fault == "", "without any fault")


def set_up(h: Any) -> None:
    """A back vibrating from a frame on, small enough for frequent drawing."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, LAST
    scene.hfx.devices.add().name = DEVICE
    bpy.context.window_manager.hfx_preview = False
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_painted(modality="vibration", name="Rumble")
        bpy.ops.hfx.fill_part(part="torso", side="both")
        scene.frame_set(CLIP)
        bpy.ops.hfx.add_clip()
        scene.frame_set(2)
    for item in scene.objects:
        item.hide_set(True)
    bpy.context.view_layer.objects.active = None
    h.undo_push()


def show_life(live: Any) -> None:
    while live.states:
        live.client.heartbeat()
        time.sleep(0.05)


class Patience:
    """Presses Play again where Blender was busy with a picture for too long."""

    def __init__(self, live: Any, log: Path) -> None:
        self._live, self._log = live, log

    def plays(self) -> bool:
        if any("did not answer" in state.text for state in self._live.states.values()):
            self._live.arm()
        return bool(self._live.is_armed)

    def has_passed(self, begun: int, phases: list[str]) -> bool:
        """Test for a direct change between two phases, since a row of the log."""
        actual: list[str] = []
        for row in rows(self._log)[begun:]:
            phase = "stop" if "stop" in row else "loud" if any(row["values"][::2]) else "silent"
            if actual[-1:] != [phase]:
                actual.append(phase)
        count = len(phases)
        return any(actual[k : k + count] == phases for k in range(len(actual)))

    def is_loud(self) -> bool:
        return self.plays() and is_loud(self._log)

    def is_silent(self) -> bool:
        return self.plays() and not is_loud(self._log)


def rows(log: Path) -> list[dict[str, Any]]:
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    return [json.loads(line) for line in lines]


def is_loud(log: Path) -> bool:
    actual = rows(log)
    return bool(actual) and any(actual[-1].get("values", [0.0])[::2])
