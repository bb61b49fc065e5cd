# SPDX-License-Identifier: GPL-3.0-or-later
"""Sensations are dragged out of the Asset Browser: onto the body, and into the scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands

LIBRARY = "HFX Haptics"
BESIDE = (-1.0, 0.0, 0.3)


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    yield from hands.add_avatar(h)
    libraries = bpy.context.preferences.filepaths.asset_libraries
    h.check(
        [library.name for library in libraries].count(LIBRARY) == 1, "the library is registered"
    )

    area = next(area for area in h.window.screen.areas if area.type == "PROPERTIES")
    area.ui_type = "ASSETS"
    yield 1.0
    space = area.spaces.active
    space.show_region_toolbar = False
    space.params.asset_library_reference = LIBRARY
    yield 3.0
    h.shot("1_asset_browser.png")
    h.document_area("editor_assets.png", area)

    before = set(bpy.data.objects.keys())
    yield from drop(h, area, "heartbeat", h.xy_of((0.0, -0.1, 1.3)))
    h.shot("2_on_the_body.png")
    actual = new(before)
    h.check(actual and all(o.hfx.role == "EFFECT" for o in actual), f"effects: {names(actual)}")
    body = next(o for o in bpy.data.objects if o.hfx.role == "BODY")
    h.check(all(o.hfx.body == body for o in actual), "they are painted on the body")
    h.check(all(len(o["hfx_vertices"]) for o in actual), "they have areas")
    h.check(all(hands.clips_of(o) for o in actual), "they have clips")
    yield from h.move(*h.xy(h.region(), 0.3, 0.6))
    yield from h.key("ctrl+z")
    yield 1.5
    h.check(not new(before), f"one Ctrl+Z takes all of it back {names(new(before))}")
    yield from h.key("ctrl+shift+z")
    yield 1.5
    h.check(len(new(before)) == len(actual), "and Shift+Ctrl+Z brings all of it back")

    before = set(bpy.data.objects.keys())
    yield from drop(h, area, "hot_object", h.xy_of(BESIDE))
    h.shot("3_in_the_scene.png")
    actual = new(before)
    h.check(actual and all(o.hfx.kind == "VOLUME" for o in actual), f"volumes: {names(actual)}")
    h.check(abs(actual[0].matrix_world.translation.x - BESIDE[0]) < 0.3, "where they were dropped")
    h.check(all(not o.get("hfx_sensation") for o in bpy.data.objects), "no empty is left")


def drop(h: Any, area: bpy.types.Area, stem: str, place: tuple[float, float]) -> Iterator[float]:
    """Drag an asset's picture to a place in the window."""
    space = area.spaces.active
    label = stem.replace("_", " ").title()
    space.params.filter_search = label
    area.tag_redraw()
    yield 2.0
    region = next(region for region in area.regions if region.type == "WINDOW")
    start = region.x + 50, h.window.height - (region.y + region.height - 60)
    middle = (start[0] + place[0]) / 2, (start[1] + place[1]) / 2
    yield from h.click(*start)
    yield 0.5
    yield from h.drag([start, (start[0] - 8, start[1] + 8), middle, place, place], step=0.4)
    yield 2.5


def new(before: set[str]) -> list[bpy.types.Object]:
    return [obj for obj in bpy.data.objects if obj.name not in before]


def names(found: list[bpy.types.Object]) -> str:
    return ", ".join(obj.name for obj in found)
