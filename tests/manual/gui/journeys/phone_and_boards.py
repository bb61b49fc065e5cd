# SPDX-License-Identifier: GPL-3.0-or-later
"""A phone's page, a board of VRC Haptics and a device with two outputs, in the panel."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import bpy
import hands

BELOW = -4  # the panels of input, values, sound and video are below


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
    bpy.context.view_layer.objects.active = None  # without the panel of the body
    yield 0.5
    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 0.6
    for _ in range(2):  # the panels above are closed, so that devices are in sight
        panels = yield from h.panels(h.region("UI"))
        yield from h.click(h.region("UI").x + 60, panels[0][1])
        yield 0.6

    live = hands.module("playback.live.live").live
    yield from h.press_button("HFX_OT_live_phone")
    devices = bpy.context.scene.hfx.devices
    devices["phone_lra"].is_expanded = False
    state = lambda: live.states["phone_lra"]  # noqa: E731
    yield from h.until(lambda: state().state != "connecting", "the page is served", 60)
    h.check(state().unit.startswith("http://"), f"{state().state}: {state().unit} {state().text}")
    yield 1.0
    h.shot("1_phone.png")
    with h.context():
        bpy.ops.hfx.live_remove(name="phone_lra")
        bpy.ops.hfx.live_add(name="vrc_haptics_board_left")
    name = devices[0].name
    devices[name].is_expanded = False
    with h.context():
        bpy.ops.hfx.live_connect(name=name, kind="DEVICE", host="127.0.0.1", port="1027")
    yield from h.until(lambda: live.states[name].state != "connecting", "the board is asked", 60)
    yield 1.0
    h.shot("2_vrc_haptics.png")
    with h.context():
        bpy.ops.hfx.live_remove(name=name)

    resources = hands.module("files.resources")
    shipped = resources.device_configs() / "arduino_uno_pwm.json"
    document = json.loads(shipped.read_text(encoding="utf-8"))
    ids = [actuator["id"] for actuator in document["actuators"]]
    output = document.pop("output")
    document["id"] = "two_boards"
    document["outputs"] = [{**output, "actuators": part} for part in (ids[:3], ids[3:])]
    folder = resources.user_devices()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "two_boards.json").write_text(json.dumps(document), encoding="utf-8")
    with h.context():
        bpy.ops.hfx.live_add(name="two_boards")
    devices["two_boards"].is_expanded = False
    yield 0.8
    before = yield from h.radios()
    yield from h.press_button("HFX_OT_live_connect")
    yield 2.0
    kinds = [place for place in (yield from h.radios()) if place not in before]
    height = max(set(y for _, y in kinds), key=[y for _, y in kinds].count)
    left = min(x for x, y in kinds if y == height)
    yield from h.click(left + 88, height)  # Device
    yield 2.5
    yield from h.move(left, height + 26)  # a redraw of the dialog
    yield 0.5
    h.shot("3_two_outputs.png")
    yield from h.key("Escape")
    yield 0.5
