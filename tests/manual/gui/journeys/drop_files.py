# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of haptics dragged from Blender's file browser into the viewport; presets of parameters."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import hands

FIRST_FILE = (20, 42)  # its icon: pixels from the upper left corner of a vertical list


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    yield from hands.add_haptic(h, hands.VOLUME_ROW + 1, hands.MODALITIES.index("wind"))
    wind = hands.effect("wind")
    wind.hfx.wind_speed, wind.name = 7.0, "Gust"
    effect = folder(h, "effect") / "gust.hfxeffect"
    with h.context():
        bpy.ops.hfx.save_effects(filepath=str(effect))
    ahap = folder(h, "ahap") / "buzz.ahap"
    ahap.write_text(json.dumps(PATTERN))
    yield from h.press_button("HFX_OT_remove_effects")
    yield 1.0
    h.check(not found(), "the scene has no effect")

    area = h.area("PROPERTIES")
    area.ui_type = "FILES"
    yield 1.0
    area.spaces.active.show_region_toolbar = False
    yield 1.0
    for path, kinds in ((effect, ["wind"]), (ahap, ["vibration", "wind"])):
        yield from hands.go_to(h, 25)
        yield from drag_in(h, area, path)
        h.shot(f"{path.suffix[1:]}.png")
        h.check(found() == kinds, f"{path.name} is dropped into the viewport: {found()}")
    h.check(hands.effect("wind").hfx.wind_speed == 7.0, "with its parameters")
    (clip,) = hands.clips_of(hands.effect("vibration"))
    h.check(abs(clip.frame_start - 25) <= 1, "and a clip from the current frame on")
    h.check(abs(clip.frame_end - clip.frame_start - 48) < 1, "of two seconds")


PATTERN = {
    "Version": 1.0,
    "Pattern": [
        {
            "Event": {
                "Time": 0.0,
                "EventType": "HapticContinuous",
                "EventDuration": 2.0,
                "EventParameters": [
                    {"ParameterID": "HapticIntensity", "ParameterValue": 0.8},
                    {"ParameterID": "HapticSharpness", "ParameterValue": 0.5},
                ],
            }
        }
    ],
}


def folder(h: Any, name: str) -> Path:
    path = Path(h.out, name)
    path.mkdir()
    return path


def found() -> list[str]:
    return sorted(obj.hfx.modality for obj in bpy.context.scene.objects if obj.hfx.role == "EFFECT")


def drag_in(h: Any, area: bpy.types.Area, path: Path) -> Iterator[float]:
    """Drag the only file of a folder from a file browser into the viewport."""
    area.spaces.active.params.directory = str(path.parent).encode()
    area.spaces.active.params.display_type = "LIST_VERTICAL"
    area.tag_redraw()
    yield 2.0
    region = next(region for region in area.regions if region.type == "WINDOW")
    top = h.window.height - region.y - region.height
    start = region.x + FIRST_FILE[0], top + FIRST_FILE[1]
    x, y = h.xy(h.region(), 0.3, 0.6)
    middle = 0.5 * (start[0] + x), 0.5 * (start[1] + y)
    h.shot(f"{path.suffix[1:]}_browser.png")
    yield from h.click(*start)
    yield 0.5
    yield from h.drag([start, (start[0] - 8, start[1] + 8), middle, (x, y), (x, y)], step=0.4)
    yield 3.0
