# SPDX-License-Identifier: GPL-3.0-or-later
"""*Shift+D* of a clip stays on its NLA track; *Shift+D* of an effect selects the copy's clips."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    bpy.context.scene.frame_end = 160
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", name="Ball")
        bpy.ops.hfx.add_clip(start=10.0)
    area = h.area()
    area.ui_type = "NLA_EDITOR"
    yield 1.5
    area.spaces.active.show_region_ui = False
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=h.window, area=area, region=region):
        bpy.ops.nla.view_all()
    yield 1.0
    x, y = region.x + 400, h.window.height - region.y - 300
    yield from h.move(x, y)
    yield from h.key("shift+d")
    yield 0.5
    yield from h.text("30")
    yield from h.key("Return")
    yield 2.0
    h.shot("0_duplicated.png")
    tracks = bpy.data.objects["Ball"].animation_data.nla_tracks
    h.check([len(track.strips) for track in tracks] == [2], "a duplicated clip joins its track")
    selected = [strip.select for strip in tracks[0].strips]
    h.check(selected == [False, True], "the duplicate is the selected clip")
    with h.context("NLA_EDITOR"):
        bpy.ops.hfx.add_clip(start=70.0)
        bpy.ops.hfx.add_heartbeat(start=120.0)
    yield 1.0
    h.shot("1_tracks.png")
    tracks = bpy.data.objects["Ball"].animation_data.nla_tracks
    own = [len(track.strips) for track in tracks if track.name == "Clips"]
    h.check(own == [4] and len(tracks) == 1, f"later clips are on the effect's own track: {own}")

    area.ui_type = "VIEW_3D"
    yield 1.0
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("shift+d")
    yield 0.5
    yield from h.key("Return")
    yield 2.0
    h.shot("2_effect.png")
    selected = {
        name: [strip.select for strip in hands.clips_of(bpy.data.objects[name])]
        for name in ("Ball", "Ball.001")
    }
    h.check(
        not any(selected["Ball"]) and any(selected["Ball.001"]),
        f"clips of the copy are selected, not those of the first effect: {selected}",
    )
