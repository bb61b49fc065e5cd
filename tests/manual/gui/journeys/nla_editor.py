# SPDX-License-Identifier: GPL-3.0-or-later
"""A clip is dragged and trimmed with the mouse in Blender's own NLA editor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

FPS = 24
WHOLE_BODY = 0, 0  # column and row of Fill Body Part


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    bpy.context.scene.frame_end = 120
    yield from hands.add_avatar(h)
    pressure = hands.MODALITIES.index("pressure")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, pressure)
    yield from hands.fill_part(h, WHOLE_BODY)
    yield from hands.go_to(h, 24)
    yield from h.press_button("HFX_OT_add_clip")
    (strip,) = hands.clips_of(hands.effect("pressure"))
    start, end = strip.frame_start, strip.frame_end

    area = h.area()
    area.ui_type = "NLA_EDITOR"
    yield 1.5
    area.spaces.active.show_region_ui = False
    yield 0.5
    region = next(region for region in area.regions if region.type == "WINDOW")
    channels = next(region for region in area.regions if region.type == "CHANNELS")
    with bpy.context.temp_override(window=h.window, area=area, region=region):
        bpy.ops.nla.view_all()
    yield 1.0
    h.shot("1_nla.png")
    h.document_area("editor_nla.png", area, height=0.3)

    row = next_row(h, region, strip)
    yield from folded(h, area, region)
    yield from h.click(at(h, region, (start + end) / 2), row)
    h.check(strip_now().select, "a click selects the clip")
    way = (at(h, region, end) - at(h, region, start)) / 2
    yield from h.key("g")
    x = at(h, region, (start + end) / 2)
    for share in (0.25, 0.5, 0.75, 1.0):
        yield from h.move(x + way * share, row)
        yield 0.2
    yield from h.click(x + way, row)
    yield 0.5
    moved = strip_now()
    shift = moved.frame_start - start
    h.check(abs(shift - (end - start) / 2) < 3, f"G and the mouse move it by {shift:.1f} frames")
    h.check(abs((moved.frame_end - moved.frame_start) - (end - start)) < 0.1, "as long as before")
    h.shot("2_moved.png")

    bpy.context.scene.frame_set(round(moved.frame_start + (end - start) / 2))
    yield 0.5
    yield from h.move(at(h, region, moved.frame_start + 2), row)
    yield from h.key("y")  # Split Strips at the current frame
    yield 0.5
    parts = hands.clips_of(hands.effect("pressure"))
    h.check(len(parts) == 2, f"Y cuts it in two ({len(parts)})")
    for part in parts:
        part.select = False
    area.tag_redraw()
    yield 0.5
    second = parts[1]
    yield from h.click(at(h, region, second.frame_start + 1), row)  # the sidebar covers the rest
    yield from h.key("Delete")
    yield 0.5
    clips = hands.clips_of(hands.effect("pressure"))
    h.check(len(clips) == 1, "Delete takes the second half away: it is trimmed")
    h.shot("3_trimmed.png")
    length = clips[0].frame_end - clips[0].frame_start
    h.check(abs(length - (end - start) / 2) <= 1.0, f"half as long as before ({length:.1f})")
    h.check(channels.width > 1, "the channels name the effect")

    area.ui_type = "VIEW_3D"
    yield 1.0
    bpy.context.scene.frame_set(round(clips[0].frame_start + 1))
    yield 1.0
    green = hands.tint(h.shot("4_felt.png"), h.xy_of((0.0, -0.1, 1.2)))
    h.check(green[1] > 1.3 * green[0], "it is felt where it was dragged to")
    bpy.context.scene.frame_set(round(start + 1))
    yield 1.0
    grey = hands.tint(h.shot("5_not_felt.png"), h.xy_of((0.0, -0.1, 1.2)))
    h.check(max(grey) - min(grey) < 12, "and no longer where it was")


def strip_now() -> bpy.types.NlaStrip:
    return hands.clips_of(hands.effect("pressure"))[0]


def at(h: Any, region: bpy.types.Region, frame: float) -> float:
    """Position of a frame in the NLA editor."""
    x, _ = region.view2d.view_to_region(frame, 0, clip=False)
    return float(region.x + x)


def next_row(h: Any, region: bpy.types.Region, strip: bpy.types.NlaStrip) -> float:
    """Height of the clip's row, located by the green of pressure."""
    rows = green_rows(h, region, strip)
    h.check(len(rows), "the clip has the colour of pressure")
    return float(rows.mean())


def green_rows(h: Any, region: bpy.types.Region, strip: bpy.types.NlaStrip) -> Any:
    """Heights of the green pixels of a clip, in the window."""
    pixels = h.shot("strips.png")
    (h.out / "strips.png").unlink()
    x = round(at(h, region, strip.frame_start + 0.8 * (strip.frame_end - strip.frame_start)))
    top = h.window.height - region.y - region.height
    column = pixels[top : top + region.height, x].astype(int)
    return (
        top + ((column[:, 1] - column[:, 0] > 60) & (column[:, 1] - column[:, 2] > 60)).nonzero()[0]
    )


def folded(h: Any, area: bpy.types.Area, region: bpy.types.Region) -> Iterator[float]:
    """Colours follow rows that move, and are not drawn for folded effects."""
    strip = strip_now()
    before = green_rows(h, region, strip)
    for name, modality in (("A", "vibration"), ("Z", "temperature")):
        with h.context("NLA_EDITOR"):
            bpy.ops.hfx.add_volume(modality=modality, shape="SPHERE", name=name)
            bpy.ops.hfx.add_clip(start=strip.frame_start, duration=1.0, fade_in=0.5)
    yield 1.0
    h.shot("1_three_rows.png")
    h.check(not strip_now().select, "an added clip is the only selected clip")
    shifted = green_rows(h, region, strip_now())
    h.check(shifted.mean() > before.mean() + 10, "a row above moves the clip's row")
    with bpy.context.temp_override(window=h.window, area=area, region=region):
        bpy.ops.anim.channels_collapse(all=True)
    yield 1.0
    h.shot("1_folded.png")
    h.check(not len(green_rows(h, region, strip_now())), "a folded effect has no colour")
    with bpy.context.temp_override(window=h.window, area=area, region=region):
        bpy.ops.anim.channels_expand(all=True)
    for name in "AZ":
        bpy.data.objects.remove(bpy.data.objects[name])
    pressed = hands.effect("pressure")
    pressed.select_set(True)
    bpy.context.view_layer.objects.active = pressed
    strip_now().select = False
    yield 1.0
    h.check(abs(green_rows(h, region, strip_now()).mean() - before.mean()) < 2, "as before")
