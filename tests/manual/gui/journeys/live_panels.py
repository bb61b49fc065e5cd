# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of live devices that few users see: a device with two outputs, a board of VRC Haptics, and
a phone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

BOARD, TWO, PHONE = "vrc_haptics_board_left", "two_boards", "phone_lra"
BELOW = -4  # the panels of input, values, sound and video are below


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
    two = two_boards()
    bpy.context.view_layer.objects.active = None
    yield 0.5
    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 0.6

    with h.context():
        bpy.ops.hfx.live_add(name=TWO)
    bpy.context.scene.hfx.devices[TWO].is_expanded = False
    yield 0.6
    yield from h.press_button("HFX_OT_live_connect")
    yield 3.0
    shown = yield from h.radios()
    row = max((y for _, y in shown), key=[y for _, y in shown].count)
    kinds = sorted(x for x, y in shown if y == row)
    yield from h.click(kinds[1], row)
    yield 3.0
    yield from h.move(kinds[0], row + 26)  # a redraw of the dialog
    yield 0.5
    h.shot("1_two_outputs.png")
    yield from h.key("Escape")
    two.unlink()
    yield 0.5

    live = hands.module("playback.live.live").live
    bpy.context.scene.hfx.devices.clear()
    with h.context():
        bpy.ops.hfx.live_add(name=BOARD)
    bpy.context.scene.hfx.devices[BOARD].is_expanded = False
    with h.context():
        bpy.ops.hfx.live_connect(name=BOARD, kind="SIMULATOR", path=str(h.out / "board.jsonl"))
    yield from h.until(lambda: live.states[BOARD].state != "connecting", "the board answers", 60)
    yield 1.0
    h.shot("2_vrc_haptics.png")
    with h.context():
        bpy.ops.hfx.live_disconnect(name=BOARD)
    bpy.context.scene.hfx.devices.clear()
    yield 1.0

    yield from h.press_button("HFX_OT_live_phone")
    yield 4.0
    h.shot("3_phone.png")
    h.check(PHONE in bpy.context.scene.hfx.devices, "the phone is added")
    bpy.context.scene.hfx.devices[PHONE].is_expanded = False
    yield 1.0
    h.shot("4_phone.png")
    h.check(PHONE in live.states, f"the page is served: {live.states[PHONE].text}")
    with h.context():
        bpy.ops.hfx.live_disconnect(name=PHONE)
    yield 1.0


def two_boards() -> Path:
    """A device in the user's folder: the board of VRC Haptics as two serial boards of 4 motors."""
    resources = hands.module("files.resources")
    document = json.loads(
        (resources.device_configs() / "vrc_haptics_board.json").read_text(encoding="utf-8")
    )
    motors = [actuator["id"] for actuator in document["actuators"]]
    del document["output"], document["side"]  # not mirrored to the right
    document |= {"id": TWO, "name": "Two boards"}
    document["outputs"] = [
        {
            "encoder": {"kind": "hfx-wire"},
            "actuators": half,
            "transport": {"kind": "serial", "baud": 115200},
        }
        for half in (motors[:4], motors[4:])
    ]
    folder = Path(resources.user_devices())
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{TWO}.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path
