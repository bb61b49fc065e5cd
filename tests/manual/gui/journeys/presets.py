# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of an effect's parameters: saved, applied, undone and removed in the panel's header."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

ICON = 67  # distance of the presets' icon from the sidebar's right edge, pixels
ADD = 108  # of the plus from the middle of the name's field
ABOVE = 37  # of the last preset from the name's field


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_volume(modality="wind", shape="SPHERE")
    h.undo_push()
    yield from h.until(lambda: len(bpy.context.window_manager.hfx_rows) == 1, "a row", 30)
    yield 2.0
    yield from set_speed(h, "9")
    name = yield from open_presets(h, "1_empty.png")
    yield from h.click(*name)
    yield from h.key("ctrl+a")
    yield from h.text("Gale")
    yield from h.key("Return")
    yield 0.5
    yield from h.click(name[0] + ADD, name[1])
    yield from h.until(lambda: files() == ["Gale.py"], "the preset is saved", 10)
    h.shot("2_saved.png")
    yield from h.key("Escape")

    yield from set_speed(h, "3")
    name = yield from open_presets(h, "3_presets.png")
    yield from h.click(name[0], name[1] - ABOVE)
    yield from h.until(lambda: speed() == 9.0, "the preset is applied", 10)
    yield 1.5  # the undo step
    h.shot("4_applied.png")
    yield from h.key("Escape")  # the open presets take every key
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 1.0
    h.check(speed() == 3.0, f"one undo takes it back: {speed()} m/s")

    with h.context():
        bpy.ops.hfx.add_volume(modality="temperature", shape="SPHERE")
    h.undo_push()
    yield 1.0
    yield from open_presets(h, "5_other_modality.png")
    yield from h.key("Escape")
    with h.context():
        bpy.ops.hfx.remove_effects()
    bpy.context.view_layer.objects.active = hands.effect("wind")
    yield 1.0
    name = yield from open_presets(h, "6_again.png")
    yield from h.click(name[0] + ADD, name[1] - ABOVE)
    yield from h.until(lambda: not files(), "the minus removes the preset", 10)
    h.shot("7_removed.png")
    yield from h.key("Escape")


def set_speed(h: Any, value: str) -> Iterator[float]:
    fields = yield from h.fields(h.region("UI"))
    yield from h.enter(fields[0], value)
    h.shot(f"speed_{value}.png")
    h.check(speed() == float(value), f"{value} m/s")


def open_presets(h: Any, shot: str) -> Iterator[float]:
    """Open the presets in the header of *Haptic Effect*; place of the field for a new name."""
    sidebar = h.region("UI")
    before = yield from h.text_fields()
    panels = yield from h.panels(sidebar)
    yield from h.click(sidebar.x + sidebar.width - ICON, panels[1][1])
    yield 1.2
    h.shot(shot)
    after = yield from h.text_fields()
    names = [place for place in after if place not in before]
    # Left of the presets stands what they leave visible of the field with the effect's name.
    h.check(1 <= len(names) <= 2, f"the presets have a field for a name: {names}")
    return max(names)


def speed() -> float:
    return float(hands.effect("wind").hfx.wind_speed)


def files() -> list[str]:
    folder = bpy.utils.user_resource("SCRIPTS", path="presets/hfx_haptics/wind")
    return sorted(file.name for file in Path(folder).glob("*.py"))
