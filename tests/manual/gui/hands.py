# SPDX-License-Identifier: GPL-3.0-or-later
"""Common actions of journeys in the haptic editor, by mouse and keyboard."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np

AVATAR_ROW, VOLUME_ROW, PAINTED_ROW, PART_ROW, POINT_ROW = 0, 1, 6, 7, 8  # of Add > Haptic
SHAPES = ("CUBOID", "SPHERE", "CYLINDER", "CAPSULE")  # volumes: a row of the menu for each
# Distance of the list of effects below the list's switches, and height of a row, pixels.
LIST_BELOW, LIST_ROW = 31, 21
_ABOVE_MENU = 24  # pixels from a menu's first row to the menu's title
MODALITIES = ("vibration", "pressure", "temperature", "wind")


def empty_scene(h: Any, frames_per_second: int = 24) -> Iterator[float]:
    """Load Blender's start-up file without the cube, with an open HFX tab."""
    for name in ("Cube", "Light", "Camera"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.context.scene.render.fps = frames_per_second
    h.fast()
    h.undo_push()
    yield from h.sidebar("HFX")


def add_haptic(h: Any, row: int, entry: int | None = None, shot: str = "") -> Iterator[float]:
    """Choose an entry of Add > Haptic as a person does."""
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("shift+a")
    yield 0.4
    rows = yield from h.menu()
    x, y = rows[0]
    yield from h.move(x, y - _ABOVE_MENU)  # the entry chosen last is highlighted: not found
    rows = yield from h.menu()
    entries: list[tuple[float, float]] = []
    for _ in range(5):
        entries = yield from h.submenu(rows[-1])  # Haptic is the last
        if len(entries) > row:
            break
    chosen = entries[row]
    if entry is not None:
        kinds = yield from h.submenu(chosen)
        chosen = kinds[entry]
        yield from h.move(*chosen)
    if shot:
        h.shot(shot)
    yield from h.click(*chosen)
    yield 0.8


def add_avatar(h: Any) -> Iterator[float]:
    """The built-in avatar, seen from the front and as large as the viewport."""
    yield from add_haptic(h, AVATAR_ROW)
    h.check(bpy.context.object and bpy.context.object.hfx.role == "BODY", "an avatar is added")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("KP_1")
    yield 0.5
    yield from h.key("KP_Decimal")  # View Selected
    yield 1.0


def zoom_out(h: Any, times: int) -> Iterator[float]:
    """A step of the view's zoom for each time."""
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    for _ in range(times):
        yield from h.key("KP_Subtract")
    yield 0.6


def ruler(h: Any, frame: int) -> tuple[float, float]:
    """Position of a frame in the timeline's ruler."""
    region = next(region for region in timeline(h).regions if region.type == "WINDOW")
    x, _ = region.view2d.view_to_region(frame, 0, clip=False)
    return region.x + x, h.window.height - (region.y + region.height - 10)


def go_to(h: Any, frame: int) -> Iterator[float]:
    """Click a frame in the timeline's ruler."""
    yield from h.click(*ruler(h, frame))
    yield 0.4
    at = bpy.context.scene.frame_current
    h.check(abs(at - frame) <= 1, f"a click in the timeline goes to frame {frame} ({at})")


def timeline(h: Any) -> bpy.types.Area:
    return next(area for area in h.window.screen.areas if area.type == "DOPESHEET_EDITOR")


def adjust(h: Any, values: dict[int, str], shot: str = "") -> Iterator[float]:
    """Type values into the number fields of "Adjust Last Operation", by their row."""
    region = h.region("HUD")
    fields = yield from h.fields(region)
    if not fields:  # folded, as at first
        yield from h.click(region.x + 20, h.window.height - (region.y + region.height - 12))
        yield 0.8
        fields = yield from h.fields(h.region("HUD"))
    for row, value in values.items():
        yield from h.enter(fields[row], value)
        yield 0.5
    if shot:
        h.shot(shot)


def fill_part(h: Any, entry: tuple[int, int], shot: str = "") -> Iterator[float]:
    """Fill Body Part in the sidebar while painting, a column and a row of the menu, and finish."""
    yield from h.until(lambda: bpy.context.mode == "PAINT_WEIGHT", "painting has begun", 60)
    yield 1.0
    paint = yield from h.button(h.region("UI"), bpy.types.HFX_OT_paint_end)
    menus = yield from h.choices(h.region("UI"))
    yield from h.click(*next(menu for menu in menus if menu[1] > paint[1]))
    yield 0.6
    if shot:
        h.shot(shot)
    parts = yield from h.menu_rows()
    yield from h.click(*in_columns(parts, entry))
    yield 0.8
    yield from h.press_button("HFX_OT_paint_end")
    yield from h.until(lambda: bpy.context.mode == "OBJECT", "painting has ended", 60)
    yield 0.8


def in_columns(places: list[tuple[float, float]], entry: tuple[int, int]) -> tuple[float, float]:
    """Place at a column and a row of a menu of several columns."""
    columns: list[list[tuple[float, float]]] = []
    for place in sorted(places):
        if columns and place[0] - columns[-1][-1][0] < 20:
            columns[-1].append(place)
        else:
            columns.append([place])
    column, row = entry
    return sorted(columns[column], key=lambda place: place[1])[row]


def add_on_part(h: Any, modality: str, part: tuple[int, int], shot: str = "") -> Iterator[float]:
    """Choose Add > Haptic > On a Body Part > modality > part, by the part's column and row."""
    yield from h.move(*h.xy(h.region(), 0.15, 0.6))
    yield from h.key("shift+a")
    yield 0.4
    rows = yield from h.menu()
    x, y = rows[0]
    yield from h.move(x, y - _ABOVE_MENU)
    rows = yield from h.menu()
    opened = yield from h.submenu(rows[-1])
    for row in (PART_ROW, MODALITIES.index(modality)):
        before = yield from h.menu_rows()
        yield from h.move(*opened[row])
        yield 1.0
        after = yield from h.menu_rows()
        opened = [place for place in after if min(map(_distance(place), before)) > 8]
        opened.sort(key=lambda place: place[1])
    if shot:
        h.shot(shot)
    yield from h.click(*in_columns(opened, part))
    yield 0.8


def _distance(place: tuple[float, float]) -> Callable[[tuple[float, float]], float]:
    return lambda other: abs(place[0] - other[0]) + abs(place[1] - other[1])


def enter_several(
    h: Any, first: tuple[float, float], last: tuple[float, float], value: str
) -> Iterator[float]:
    """Drag over neighbouring number fields and type a value for all of them."""
    inputs = bpy.context.preferences.inputs
    inputs.use_mouse_continuous = False  # a grabbed pointer of a virtual screen jumps
    x, middle = round(first[0]), 0.5 * (first[1] + last[1])
    yield from h.drag([(x, first[1]), (x, middle), (x, last[1])], step=0.3)
    inputs.use_mouse_continuous = True
    yield 0.4
    h.shot("several.png")
    yield from h.key("ctrl+a")
    yield from h.text(value)
    yield from h.key("Return")
    yield 0.5


def effect(modality: str) -> bpy.types.Object:
    """The scene's effect of a modality; call again after each undo."""
    (actual,) = (
        o for o in bpy.data.objects if o.hfx.role == "EFFECT" and o.hfx.modality == modality
    )
    return actual


def clips_of(obj: bpy.types.Object) -> list[bpy.types.NlaStrip]:
    """An effect's clips, the first clip first."""
    data = obj.animation_data
    tracks = data.nla_tracks if data is not None else ()
    return sorted((strip for track in tracks for strip in track.strips), key=start_of)


def start_of(strip: bpy.types.NlaStrip) -> float:
    return float(strip.frame_start)


def painted_parts(obj: bpy.types.Object) -> set[str]:
    """Body parts with paint of an effect."""
    model, parts = model_of(obj)
    return {parts[model.part[vertex]] for vertex in obj.get("hfx_vertices", [])}


def model_of(obj: bpy.types.Object) -> tuple[Any, tuple[str, ...]]:
    """An effect's perceptual model and the names of the body parts, from the add-on itself."""
    return module("engine.body.model").load_model(obj.hfx.model_id), module(
        "engine.body.parts"
    ).PARTS


def module(name: str) -> Any:
    """A module of the add-on, by the module's name within the add-on."""
    return importlib.import_module(f"{package()}.{name}")


def package() -> str:
    """Name of the enabled add-on's package."""
    return bpy.types.HFX_OT_paint_begin.__module__.rpartition(".operators")[0]


def icon(h: Any, row: int, which: int) -> Iterator[float]:
    """Centre of the star (0) or loudspeaker (1) in a row of the list of effects."""
    region = h.region("UI")
    (_, switches), *_ = yield from h.toggles(region)  # Show What Is Felt is the first switch
    return region.x + region.width - (86, 72)[which], switches + LIST_BELOW + LIST_ROW * row


def tint(pixels: np.ndarray, place: tuple[float, float], half: int = 6) -> np.ndarray:
    """Mean red, green and blue (0..255) around a place of the window."""
    x, y = (round(item) for item in place)
    return pixels[y - half : y + half + 1, x - half : x + half + 1].reshape(-1, 3).mean(axis=0)
