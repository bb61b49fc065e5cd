# SPDX-License-Identifier: GPL-3.0-or-later
"""The four tasks of the HFX paper's study, from a new haptic file, in the fewest actions.

An action is a click, a key, a stroke, or a value typed into a field; the same value in two fields
is two actions, also where a drag over both fields enters the value once. A click in submenus that
open under the mouse is a single action. Folded *Adjust Last Operation* is counted in each task.
``--arg T3 --arg T4`` runs these tasks alone, on a slow computer.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

FPS = 24
MOST = {"T1": 12, "T2": 14, "T3": 18, "T4": 8}
WHOLE_BODY, TRUNK = (0, 0), (1, 1)  # column and row of a menu of body parts


class Task:
    """Task of the HFX paper, with a count of the user's actions."""

    def __init__(self, name: str) -> None:
        self.name, self.actions = name, 0

    def do(self, steps: Iterator[float], actions: int = 1) -> Iterator[float]:
        yield from steps
        self.actions += actions

    def end(self, h: Any) -> None:
        h.shot(f"{self.name}.png")
        h.check(self.actions <= MOST[self.name], f"{self.name} takes {self.actions} actions")


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h, FPS)
    yield from hands.add_avatar(h)
    for name, task in zip(MOST, (ambience, arrow, storm, heartbeat), strict=True):
        if h.args and name not in h.args:
            continue
        yield from task(h)
        for effect in [obj for obj in bpy.data.objects if obj.hfx.role == "EFFECT"]:
            bpy.data.objects.remove(effect)
        yield from hands.go_to(h, 1)


def ambience(h: Any) -> Iterator[float]:
    """A warm sphere of 2 m radius at 30 degrees, and a floor of 2 x 2 m at 100 Hz, for 2 s."""
    task = Task("T1")
    yield from task.do(add_volume(h, "SPHERE", "temperature"), 2)
    fields = yield from h.fields(h.region("UI"))
    yield from task.do(h.enter(fields[1], "2"))
    fire = hands.effect("temperature").hfx
    h.check((fire.radius, fire.temperature) == (2.0, 30.0), "2 m at 30 degrees")
    yield from task.do(h.press_button("HFX_OT_add_clip"))
    yield from task.do(hands.adjust(h, {1: "48"}), 2)
    yield from task.do(add_volume(h, "CUBOID", "vibration"), 2)
    fields = yield from h.fields(h.region("UI"))
    yield from task.do(hands.enter_several(h, fields[2], fields[3], "2"), 2)
    yield from task.do(h.enter(fields[4], "0.3"))
    floor = hands.effect("vibration").hfx
    size = tuple(round(edge, 3) for edge in floor.size)
    h.check((floor.frequency, size) == (100.0, (2, 2, 0.3)), f"a floor of 100 Hz: {size}")
    yield from task.do(h.press_button("HFX_OT_add_clip"))
    for modality in ("temperature", "vibration"):
        check_clips(h, modality, [(1, 48)])
    task.end(h)


def arrow(h: Any) -> Iterator[float]:
    """An arrow of pressure on the back, from 2.5 s to 3.0 s."""
    task = Task("T2")
    menus = yield from h.choices(h.region("HEADER"))
    yield from task.do(h.click(*menus[2]))
    yield 0.8
    rows = yield from h.menu_rows()
    yield from task.do(h.click(*rows[hands.MODALITIES.index("pressure")]))
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting begins", 60)
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from task.do(h.key("ctrl+KP_1"))
    yield 1.0
    for line in (
        [(0.09, 1.3), (-0.09, 1.3)],
        [(-0.03, 1.36), (-0.09, 1.3), (-0.03, 1.24)],
    ):
        places = [h.xy_of((x, 0.1, z)) for x, z in line]
        yield from task.do(h.drag(places, step=0.2))
        yield 0.8
    yield from task.do(hands.go_to(h, 1 + round(2.5 * FPS)))
    frame = bpy.context.scene.frame_current
    position = yield from h.button(h.region("HEADER"), bpy.types.HFX_OT_add_clip)
    yield from task.do(h.click(*position))
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "and ends", 60)
    yield from task.do(hands.adjust(h, {1: "12"}), 2)
    h.check(len(hands.effect("pressure")["hfx_vertices"]) > 10, "an area is painted")
    check_clips(h, "pressure", [(frame, 12)])
    task.end(h)


def storm(h: Any) -> Iterator[float]:
    """Wind in a box of 2 x 2 x 3 m from 5 s to 7 s, and three strikes of lightning."""
    task = Task("T3")
    yield from task.do(add_volume(h, "CUBOID", "wind"), 2)
    fields = yield from h.fields(h.region("UI"))
    yield from task.do(hands.enter_several(h, fields[1], fields[2], "2"), 2)
    yield from task.do(h.enter(fields[3], "3"))
    size = tuple(round(edge, 3) for edge in hands.effect("wind").hfx.size)
    h.check(size == (2, 2, 3), f"a box of {size} m")
    yield from task.do(hands.go_to(h, 1 + 5 * FPS))
    frame = bpy.context.scene.frame_current
    yield from task.do(h.press_button("HFX_OT_add_clip"))
    yield from task.do(hands.adjust(h, {1: "48"}), 2)
    check_clips(h, "wind", [(frame, 48)])
    yield from task.do(hands.add_on_part(h, "pressure", WHOLE_BODY, shot="T3_parts.png"), 2)
    h.check(len(hands.painted_parts(hands.effect("pressure"))) == 11, "the whole body")
    strikes = []
    for frame in (126, 140, 158):
        yield from task.do(hands.go_to(h, frame))
        strikes.append((bpy.context.scene.frame_current, 2.4))
        yield from task.do(h.press_button("HFX_OT_add_clip"))
        if frame == 126:
            yield from task.do(hands.adjust(h, {1: "2.4"}))
    check_clips(h, "pressure", strikes)
    task.end(h)


def heartbeat(h: Any) -> Iterator[float]:
    """A heartbeat on the torso: 2 beats a second for 2 s, half a second of fades."""
    task = Task("T4")
    yield from task.do(hands.go_to(h, 13))
    frame = bpy.context.scene.frame_current
    yield from task.do(hands.add_on_part(h, "vibration", TRUNK), 2)
    h.check(hands.painted_parts(hands.effect("vibration")) == {"torso"}, "on the torso")
    yield from task.do(h.press_button("HFX_OT_add_heartbeat"))
    yield from task.do(hands.adjust(h, {2: "12", 3: "12", 4: "120"}), 4)
    check_clips(h, "vibration", [(frame, 48)])
    (strip,) = hands.clips_of(hands.effect("vibration"))
    values = strip.blend_in, strip.blend_out, round(strip.repeat, 3)
    h.check(values == (12, 12, 4), f"fades and beats: {values}")
    task.end(h)


def add_volume(h: Any, shape: str, modality: str) -> Iterator[float]:
    row = hands.VOLUME_ROW + hands.SHAPES.index(shape)
    yield from hands.add_haptic(h, row, hands.MODALITIES.index(modality))


def check_clips(h: Any, modality: str, expected: list[tuple[float, float]]) -> None:
    clips = hands.clips_of(hands.effect(modality))
    spans = [(clip.frame_start, round(clip.frame_end - clip.frame_start, 3)) for clip in clips]
    h.check(spans == expected, f"clips of {modality}: start and length in frames {spans}")
