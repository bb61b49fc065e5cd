# SPDX-License-Identifier: GPL-3.0-or-later
"""Instant preview: a volume dragged through the body colours the body; solo, mute, palettes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

CHEST = (0.03, -0.1, 1.25)  # away from the wires of the volumes
COLOUR_BLIND_ROW = 2  # of the palettes


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    sphere = hands.VOLUME_ROW + hands.SHAPES.index("SPHERE")
    yield from hands.add_haptic(h, sphere, hands.MODALITIES.index("vibration"))
    h.check(not is_red(h, h.shot("1_at_the_feet.png")), "at the feet, it is not felt on the chest")

    start = h.xy(h.region(), 0.3, 0.2)
    goal = start[0], start[1] + h.xy_of((0, 0, 1.25))[1] - h.xy_of((0, 0, 0))[1]
    yield from h.move(*start)
    yield from h.key("g")
    for share in (0.3, 0.6, 0.8, 1.0):
        yield from h.move(start[0], start[1] + (goal[1] - start[1]) * share)
        yield 0.3
    yield from h.until(lambda: is_red(h, h.shot("2_dragged.png")), "dragging colours it at once")
    h.check(
        any(op.bl_idname == "TRANSFORM_OT_translate" for op in h.window.modal_operators),
        "while the mouse still drags",
    )
    yield from h.click(*goal)
    height = hands.effect("vibration").location.z
    h.check(abs(height - 1.25) < 0.1, f"G moved it up: {height:.2f} m")

    warmth = hands.MODALITIES.index("temperature")
    yield from hands.add_haptic(h, sphere, warmth)  # at the feet
    for name, first, second in (("is_muted", 1, 1), ("is_solo", 0, 0)):
        row = 0  # by name: the temperature is the first
        position = yield from hands.icon(h, row, first)
        yield from h.click(*position)
        yield 0.8
        switched = getattr(hands.effect("temperature").hfx, name)
        h.check(switched, f"a click on the row's icon: {name}")
        red = is_red(h, h.shot(f"3_{name}.png"))
        h.check(red == (name == "is_muted"), "the other one is felt unless this one is solo")
        position = yield from hands.icon(h, row, second)
        yield from h.click(*position)
        yield 0.5
        switched = getattr(hands.effect("temperature").hfx, name)
        h.check(not switched, "and back")
    pixels = h.shot("4_both.png")
    h.check(is_red(h, pixels), "both are felt again")
    before = hands.tint(pixels, h.xy_of(CHEST))

    x, y = yield from hands.icon(h, 0, 0)
    above = y - hands.LIST_BELOW  # the switches and, to the right, the palette
    yield from h.click(x + 42, above)
    yield 0.6
    h.shot("5_palettes.png")
    rows = yield from h.menu_rows()
    yield from h.click(*rows[COLOUR_BLIND_ROW])
    yield 0.8
    h.check(bpy.context.scene.hfx.palette == "COLOUR_BLIND", "the palette is chosen")
    pixels = h.shot("6_colour_blind.png")
    after = hands.tint(pixels, h.xy_of(CHEST))
    # Red 0.9, 0.05, 0.05 and vermilion 0.835, 0.369, 0, blended at 0.85 with grey skin in linear
    # light: green differs by about 40 of 255 under full light, by less on a chest.
    h.check(after[1] - before[1] > 30, f"the chest is greener by {after[1] - before[1]:.0f} of 255")
    h.check(after[0] < before[0], "and less red: vermilion instead of red")
    yield from h.click(h.region("UI").x + 100, above)
    yield 0.8
    h.check(not bpy.context.window_manager.hfx_preview, "Show What Is Felt is switched off")
    red, green, blue = hands.tint(h.shot("7_off.png"), h.xy_of(CHEST))
    h.check(max(red, green, blue) - min(red, green, blue) < 12, "the avatar is as it was")


def is_red(h: Any, pixels: Any) -> bool:
    red, green, blue = hands.tint(pixels, h.xy_of(CHEST))
    return bool(red > 1.5 * green and red > 1.5 * blue)
