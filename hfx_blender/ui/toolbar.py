# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools of Object Mode that drag out effects, tool of Weight Paint; asset shelf of sensations."""

from pathlib import Path
from typing import Any

import bpy

from ..authoring.effects import effect_assets, effects
from ..blender import compat
from ..operators.effects.drag_operator import KINDS, HFX_OT_drag_effect
from ..operators.painting.paint_view import FILL_TOOL

_ICONS = Path(__file__).with_name("icons")  # drawn by release/tool_icons.py


def _tool(kind: str, label: str, description: str) -> type:
    """New tool of Object Mode that drags out an effect, described as in ``KINDS``."""

    def draw_settings(_context: Any, layout: bpy.types.UILayout, tool: Any) -> None:
        if kind != "WIND":
            layout.prop(tool.operator_properties(HFX_OT_drag_effect.bl_idname), "modality")

    press = {"type": "LEFTMOUSE", "value": "PRESS"}
    attributes = {
        "bl_space_type": "VIEW_3D",
        "bl_context_mode": "OBJECT",
        "bl_idname": f"hfx.drag_{kind.lower()}",
        "bl_label": f"Haptic {label}",
        "bl_description": description,
        "bl_icon": str(_ICONS / kind.lower()),
        "bl_cursor": "CROSSHAIR",
        "bl_keymap": ((HFX_OT_drag_effect.bl_idname, press, {"properties": [("kind", kind)]}),),
        "draw_settings": staticmethod(draw_settings),
    }
    return type(f"HfxDrag{kind.title()}", (bpy.types.WorkSpaceTool,), attributes)


class FillPartTool(bpy.types.WorkSpaceTool):
    """Tool of Weight Paint for the body part under the mouse"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "PAINT_WEIGHT"
    bl_idname = FILL_TOOL
    bl_label = "Fill Body Part"
    bl_description = "Click a body part to fill the part, Ctrl to clear"
    bl_icon = "ops.paint.weight_fill"
    bl_cursor = "PAINT_BRUSH"
    bl_keymap = tuple(
        (
            "hfx.fill_part",
            {"type": "LEFTMOUSE", "value": "PRESS", "ctrl": is_cleared},
            {"properties": [("is_under_mouse", True), ("is_cleared", is_cleared)]},
        )
        for is_cleared in (False, True)
    )


_TOOLS = [_tool(*kind) for kind in KINDS]


if compat.HAS_ASSET_SHELVES:

    class HFX_AST_sensations(bpy.types.AssetShelf):
        """Sensations below the viewport, to be dragged onto the body or into the scene"""

        bl_idname = "HFX_AST_sensations"
        bl_space_type = "VIEW_3D"

        @classmethod
        def poll(cls, context: bpy.types.Context) -> bool:
            return context.mode == "OBJECT" and bool(effects.bodies_of(context.scene))

        @classmethod
        def asset_poll(cls, asset: bpy.types.AssetRepresentation) -> bool:
            return asset.id_type == "OBJECT" and asset.metadata.author == effect_assets.AUTHOR


def register() -> None:
    after, is_first = "builtin.primitive_cube_add", True
    for tool in _TOOLS:
        bpy.utils.register_tool(tool, after={after}, separator=is_first, group=is_first)
        after, is_first = tool.bl_idname, False
    bpy.utils.register_tool(FillPartTool, separator=True)


def unregister() -> None:
    user = bpy.context.window_manager.keyconfigs.user
    for tool in (FillPartTool, *reversed(_TOOLS)):
        keymap = user.keymaps.get(tool._bl_tool.keymap[0])
        bpy.utils.unregister_tool(tool)
        if keymap is not None:  # Blender keeps this copy of a tool's keymap
            user.keymaps.remove(keymap)
