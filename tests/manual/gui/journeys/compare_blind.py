# SPDX-License-Identifier: GPL-3.0-or-later
"""Two effects are compared blind: X switches, Enter prefers, Esc ends; no list or strip is seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    bpy.context.scene.frame_end = 48
    yield from hands.add_avatar(h)
    for modality in ("vibration", "pressure"):
        yield from hands.add_haptic(h, hands.VOLUME_ROW + 1, hands.MODALITIES.index(modality))
    takes = [hands.effect(modality) for modality in ("vibration", "pressure")]
    names = [take.name for take in takes]
    for take in takes:
        take.select_set(True)
    yield 0.5
    kinds = sorted(area.type for area in h.window.screen.areas)
    h.shot("1_before.png")
    with h.context():
        bpy.ops.hfx.compare_takes("INVOKE_DEFAULT")
    yield 1.5
    h.shot("2_blind.png")
    kinds_now = [area.type for area in h.window.screen.areas]
    h.check(kinds_now == ["VIEW_3D"], f"only the viewport is seen: {kinds_now}")
    h.check(h.window.screen.is_animation_playing, "the timeline plays")
    h.check(sum(muted(names)) == 1, "one take is muted")
    before = muted(names)
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("x")
    yield 0.6
    h.check(muted(names) == [not mute for mute in before], "X switches")
    h.shot("3_other.png")
    preferred = names[muted(names).index(False)]
    yield from h.key("Return")
    yield 0.6
    yield from h.key("Escape")
    yield 1.5
    h.shot("4_after.png")
    h.check(muted(names) == [False, False], "the mutes are as before")
    h.check(sorted(area.type for area in h.window.screen.areas) == kinds, "the areas are back")
    h.check(not h.window.screen.is_animation_playing, "the timeline stands")
    reports = " ".join(bpy.data.window_managers[0].operators.keys())
    h.check(bpy.context.window_manager.hfx_preview, f"colours are back ({preferred}; {reports})")


def muted(names: list[str]) -> list[bool]:
    return [bpy.data.objects[name].hfx.is_muted for name in names]
