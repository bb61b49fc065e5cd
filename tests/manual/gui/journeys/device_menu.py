# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices by mouse: each menu is answered once; Connect names what is missing, and lists ports."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

VECTOR_ROW = hands.POINT_ROW + 1  # of Add > Haptic
BELOW = -4  # the panels of input, values, sound and video are below


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
    h.undo_push()
    yield from hands.add_haptic(h, VECTOR_ROW, 0, "1_vector_menu.png")
    effect = bpy.context.object
    h.check(effect.hfx.kind == "ACTUATORS", f"one choice adds '{effect.name}'")
    bpy.context.view_layer.objects.active = None
    yield 0.5

    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 0.6
    menus = yield from h.choices(h.region("UI"))
    yield from h.click(*menus[-1])  # Add Device, in the lowest open panel
    yield 1.0
    h.shot("2_add_device.png")
    rows = yield from h.menu_rows()
    h.check(all(0 < x < h.window.width for x, _ in rows), "the menu is inside the window")
    yield from h.click(*rows[-1])
    yield 0.8
    devices = bpy.context.scene.hfx.devices
    h.check(len(devices) == 1, f"one choice adds {list(devices.keys())}")

    yield from dialog(h, "insoles", 1, "3_insoles.png")  # greyed out
    yield from dialog(h, "arduino_uno_pwm", 1, "4_serial.png", is_field_open=True)
    yield from dialog(h, "bhaptics_tactsuit_x40", 1, "5_program.png")
    yield from dialog(h, "sound_card_8", 2, "6_sound_card.png")


def dialog(h: Any, name: str, kind: int, shot: str, is_field_open: bool = False) -> Iterator[float]:
    """Open the dialog of Connect for a new device, and choose a kind of connection."""
    devices = bpy.context.scene.hfx.devices
    devices.clear()
    with h.context():
        bpy.ops.hfx.live_add(name=name)
    devices[name].is_expanded = False
    yield 0.6
    before = yield from h.radios()
    kinds = []
    for attempt in range(12):  # a busy computer draws late, and may miss a click
        if attempt % 6 == 0:
            yield from h.press_button("HFX_OT_live_connect")
        yield 0.8
        shown = yield from h.radios()
        kinds = [place for place in shown if place not in before]
        if kinds:
            break
    heights = [y for _, y in kinds]
    height = max(set(heights), key=heights.count)  # of the dialog's row of kinds
    left = min(x for x, y in kinds if y == height)
    kinds = [(left + 109 * k, height) for k in range(4)]
    yield from h.click(*kinds[kind])
    yield 2.5
    yield from h.move(kinds[0][0], height + 26)  # a redraw of the dialog
    yield 0.5
    h.shot(shot)
    if is_field_open:  # the dialog grows upwards
        shown = yield from h.radios()
        height = next(y for x, y in shown if abs(x - left) < 2)
        yield from h.click(kinds[3][0] - 60, height + 26)
        yield 1.0
        h.shot("list_" + shot)
        yield from h.key("Escape")
    yield from h.key("Escape")
    yield 0.5
