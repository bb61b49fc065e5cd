# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of haptics dragged from Blender's file browser into the viewport; presets of parameters."""

from __future__ import annotations

import json
import shutil
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
    haptic = folder(h, "haptic") / "buzz.haptic"
    haptic.write_text(json.dumps(CLIP))
    path, hjif = saved_path(h), exported(h)
    yield from h.press_button("HFX_OT_remove_effects")
    yield 1.0
    h.check(not found(), "the scene has no effect")

    area = h.area("PROPERTIES")
    area.ui_type = "FILES"
    yield 1.0
    area.spaces.active.show_region_toolbar = False
    yield 1.0
    for file, kinds in ((effect, ["wind"]), (ahap, ["vibration", "wind"])):
        yield from drop(h, area, file, kinds)
    h.check(hands.effect("wind").hfx.wind_speed == 7.0, "with its parameters")
    (clip,) = hands.clips_of(hands.effect("vibration"))
    h.check(abs(clip.frame_start - 25) <= 1, "and a clip from the current frame on")
    h.check(abs(clip.frame_end - clip.frame_start - 48) < 1, "of two seconds")
    yield from drop(h, area, haptic, ["vibration", "vibration", "wind"])
    yield from drop(h, area, hjif, ["pressure", "vibration", "vibration", "wind"])
    bpy.context.view_layer.objects.active = None
    yield from drop(h, area, path, ["pressure", *["vibration"] * 3, "wind"])
    points = hands.module("authoring.paths.paths").path_of(bpy.context.object)
    h.check(len(points) > 2, "the path is that of a new point")


def drop(h: Any, area: bpy.types.Area, file: Path, kinds: list[str]) -> Iterator[float]:
    """Drop a file at frame 25, and compare the modalities of all effects with ``kinds``."""
    yield from hands.go_to(h, 25)
    old = set(bpy.context.scene.objects)
    yield from drag_in(h, area, file)
    h.shot(f"{file.suffix[1:]}.png")
    h.check(found() == kinds, f"{file.name} is dropped into the viewport: {found()}")
    new = [obj for obj in bpy.context.scene.objects if obj not in old]
    h.check(bpy.context.object in new, "an added effect is active")
    h.check(set(bpy.context.selected_objects) == set(new), "the added effects alone are selected")
    chosen = [obj for obj in old for strip in hands.clips_of(obj) if strip.select]
    h.check(not chosen, f"no clip of an older effect is selected: {chosen}")


def saved_path(h: Any) -> Path:
    """File with a path of the library, of a point that is then deleted."""
    file = folder(h, "hfxpath") / "circle.hfxpath"
    with h.context():
        bpy.ops.hfx.add_spot()
        bpy.ops.hfx.path_from_library(name="circle_chest")
        bpy.ops.hfx.save_path(filepath=str(file))
        bpy.ops.hfx.remove_effects()
    return file


def exported(h: Any) -> Path:
    """HJIF of a painted chest, whose effect is then deleted."""
    scene, last, wind = bpy.context.scene, bpy.context.scene.frame_end, hands.effect("wind")
    scene.frame_end, wind.hfx.is_muted = 12, True
    source = folder(h, "exported") / "chest.hjif"
    file = folder(h, "hjif") / "chest.hjif"
    with h.context():
        bpy.ops.hfx.add_on_part(modality="pressure", part="chest")
        bpy.ops.hfx.export(filepath=str(source), formats={"hjif"})
        shutil.copy(source, file)
        bpy.ops.hfx.remove_effects()
        scene.frame_end, wind.hfx.is_muted = last, False
        bpy.context.view_layer.objects.active = wind
        wind.select_set(True)
    return file


CLIP = {
    "version": {"major": 1, "minor": 0, "patch": 0},
    "metadata": {},
    "signals": {
        "continuous": {
            "envelopes": {
                name: [{"time": time, name: 0.5} for time in (0.0, 2.0)]
                for name in ("amplitude", "frequency")
            }
        }
    },
}


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
