# SPDX-License-Identifier: GPL-3.0-or-later
"""Visible values: actuators glow with their values, a chart shows values over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

FPS = 24
WHOLE_BODY = 0, 0  # column and row of Fill Body Part
DEVICES = ("pressure_vest", "waist_belt")


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    scene = bpy.context.scene
    scene.frame_end = 96
    for name in DEVICES:
        scene.hfx.devices.add().name = name
    h.undo_push()
    yield from hands.add_avatar(h)
    pressure, warmth = (hands.MODALITIES.index(name) for name in ("pressure", "vibration"))
    yield from hands.add_haptic(h, hands.PAINTED_ROW, pressure)
    yield from hands.fill_part(h, WHOLE_BODY)
    yield from hands.go_to(h, 24)
    yield from h.press_button("HFX_OT_add_clip")
    yield from hands.add_haptic(h, hands.PAINTED_ROW, warmth)
    yield from hands.fill_part(h, WHOLE_BODY)
    yield from hands.go_to(h, 48)
    yield from h.press_button("HFX_OT_add_heartbeat")
    yield from hands.go_to(h, 12)
    yield 1.5
    calm = h.shot("1_calm.png")

    bpy.context.window_manager.hfx_preview = False  # the actuators alone
    yield from hands.go_to(h, 30)
    yield 1.5
    lit = h.shot("2_lit.png")
    green = greener(h, lit) - greener(h, calm)
    h.check(green > 60, f"actuators on the chest glow green ({green:.0f} pixels)")
    bpy.context.window_manager.hfx_preview = True

    known = hands.module("playback.timeline.timeline_recorder").recorder
    yield from h.until(lambda: known.is_fresh, "values over time are recorded by themselves", 60)
    before = known.count
    sidebar = h.region("UI")
    (_, y), *_ = yield from h.toggles(sidebar)  # Show What Is Felt, in the row of the curve icon
    yield from h.click(sidebar.x + sidebar.width - 82, y)
    yield 0.5
    h.check(bpy.context.window_manager.hfx_show_values, "Values over Time is switched on")
    yield from h.move(*h.xy(h.region(), 0.3, 0.8))  # no tooltip in the picture
    yield 2.0
    h.shot("3_chart.png")
    h.document("editor_values.png", left=0.0, bottom=0.0)
    h.check(known.count == before, "showing them records nothing anew")
    yield from hands.go_to(h, 60)
    yield 1.0
    h.shot("4_later.png")
    scene.hfx.time_unit = "SECONDS"
    marked = h.shot("4_seconds.png")
    line = hands.timeline(h)
    with bpy.context.temp_override(window=h.window, area=line, region=line.regions[-1]):
        bpy.ops.action.view_all()  # all keyframes of the selected effect: a part of the scene
    yield 1.0
    moved = h.shot("4_zoomed.png")
    x, y = (round(end) for end in h.xy(h.region(), 0.4, 0.05))
    part = slice(y - 60, y), slice(x - 200, x + 200)
    h.check((marked[part] != moved[part]).any(), "the time axis follows the timeline's view")
    scene.hfx.time_unit = "FRAMES"
    yield from h.move(*h.xy(h.region(), 0.3, 0.8))
    yield from h.key("space")
    yield 3.0
    h.shot("5_playing.png")
    yield from h.key("space")
    yield 0.5
    yield from h.until(lambda: known.is_fresh, "after playing, they hold", 60)
    h.check(known.count <= before + 1, f"nor does playing, frame by frame ({known.count - before})")
    before = known.count

    hands.clips_of(hands.effect("pressure"))[0].frame_start_ui = 40
    yield from h.until(lambda: known.count > before, "a moved clip is recorded anew", 60)
    yield 0.5
    h.shot("6_moved.png")
    yield 3.0
    h.check(known.count == before + 1, f"once ({known.count - before})")
    yield from constrained(h, known)


def constrained(h: Any, known: Any) -> Iterator[float]:
    """A body moved by a constraint needs Update Values; the values are valid until an edit."""
    scene = bpy.context.scene
    guide = bpy.data.objects.new("Guide", None)
    scene.collection.objects.link(guide)
    for frame, x in ((1, 0.0), (96, 0.5)):
        guide.location.x = x
        guide.keyframe_insert("location", frame=frame)
    body = next(obj for obj in bpy.data.objects if obj.hfx.role == "BODY")
    body.constraints.new("COPY_LOCATION").target = guide
    yield from h.until(lambda: known.must_step, "a constraint needs Update Values", 60)
    with h.context():
        bpy.ops.hfx.update_values()
    yield 2.0
    h.check(known.valid is not None, "after Update Values they are valid")
    yield from hands.go_to(h, 48)
    yield 2.0
    h.check(known.valid is not None, "at another frame, too")
    h.shot("7_constrained.png")
    body.location.z = 0.1
    yield 1.0
    h.check(known.valid is None, "until an edit")


def greener(h: Any, pixels: Any) -> int:
    """Clearly green pixels of the viewport's middle."""
    x, y = (round(item) for item in h.xy_of((0.0, -0.1, 1.2)))
    part = pixels[y - 120 : y + 120, x - 120 : x + 120].astype(int)
    red, green, blue = part[..., 0], part[..., 1], part[..., 2]
    return int(((green > red + 40) & (green > blue + 40)).sum())
