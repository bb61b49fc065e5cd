# SPDX-License-Identifier: GPL-3.0-or-later
"""Material from words or a picture: the wish, progress, previews of what was made, the pad."""

from __future__ import annotations

from typing import Any

import bpy
import bpy.utils.previews

from ...authoring.surfaces import surfaces
from ...files.suffixes import GENERATED
from ...operators.shared import active_armature
from ...operators.surfaces import generation
from ..sidebar import HfxPanel, draw_text

_previews: Any = None


class HFX_PT_generation(HfxPanel, bpy.types.Panel):
    """A material that can be felt, from words or from any picture"""

    bl_label = "Material from Words or Picture"
    bl_order = 1  # above the panel of the surface that it makes, or its results would be far below
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        if context.mode != "OBJECT" or generation.running is not None or obj is None:
            return context.mode == "OBJECT"
        is_free = obj.hfx.role == "NONE" and active_armature(context) is None
        return obj.type == "MESH" and (is_free or surfaces.is_surface(obj))

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        wanted = context.window_manager.hfx_generation
        layout.row().prop(wanted, "source", expand=True)
        if wanted.source == "WORDS":
            layout.prop(wanted, "words", text="", icon="GREASEPENCIL")
            layout.prop(wanted, "negative")
            row = layout.row(align=True)
            row.prop(wanted, "seed")
            row.prop(wanted, "variations")
            layout.prop(wanted, "resolution")
        else:
            layout.prop(wanted, "picture", text="")
            layout.prop(wanted, "size_mm")
            layout.prop(wanted, "height_mm")
            layout.prop(wanted, "tiles")
        layout.prop(wanted, "use_steps")
        if generation.running is not None:
            share = generation.running.share
            row = layout.row(align=True)
            row.progress(factor=share, text=f"{share:.0%}")
            row.operator("hfx.cancel_generation", text="", icon="X")
            return
        layout.operator("hfx.generate_surface", icon="SHADERFX")
        self._draw_results(context, layout)

    @staticmethod
    def _draw_results(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        obj = context.object
        is_felt = obj is not None and obj.hfx.surface.source == "GENERATED"
        if is_felt and obj.hfx.kind == "SURFACE":
            layout.operator("hfx.stroke_pad", icon="GREASEPENCIL")
        grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for number, record in enumerate(generation.results):
            column = grid.column(align=True)
            column.template_icon(icon_value=_icon(record), scale=5.0)
            column.operator("hfx.use_generated").number = number
        if is_felt and obj.hfx.surface.note:
            draw_text(context, layout, obj.hfx.surface.note, "INFO")


def _icon(record: Any) -> int:
    """Number of the icon of a result's colour picture."""
    path = str(record.with_name(record.name.removesuffix(GENERATED) + ".colour.png"))
    if path not in _previews:
        for old in [each for each in _previews if not each.startswith(str(record.parent))]:
            del _previews[old]
        _previews.load(path, path, "IMAGE")
    return int(_previews[path].icon_id)


def register() -> None:
    global _previews
    _previews = bpy.utils.previews.new()


def unregister() -> None:
    bpy.utils.previews.remove(_previews)
