# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses: add, remove, move and mute filters of a volume, and bake the result."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty

from ...authoring import responses
from ...authoring.responses import KINDS
from ...export import response_baking
from ..shared import HfxOperator, active_effect


def active_volume(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active effect, as of ``shared.active_effect``, if a haptic volume; otherwise None."""
    effect = active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "VOLUME" else None


class _OnVolume(HfxOperator):
    requires = ((active_volume, "Select a haptic volume"),)


class _OnFilter(HfxOperator):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_volume(context)
        return cls.needs(effect is not None and effect.hfx.response, "Add a filter first")


class HFX_OT_add_response_filter(_OnVolume):
    """Add a filter to the volume's contact response"""

    bl_idname = "hfx.add_response_filter"
    bl_label = "Add Filter"

    kind: EnumProperty(
        name="Kind", description="Function of the filter", items=KINDS, default="impact"
    )

    def work(self, context: bpy.types.Context) -> str:
        responses.add_filter(active_volume(context), self.kind)
        return ""


class HFX_OT_remove_response_filter(_OnFilter):
    """Remove the active filter with the filter's animation"""

    bl_idname = "hfx.remove_response_filter"
    bl_label = "Remove Filter"

    def work(self, context: bpy.types.Context) -> str:
        effect = active_volume(context)
        last = len(effect.hfx.response) - 1
        responses.remove_filter(effect, min(effect.hfx.response_active, last))
        return ""


class HFX_OT_move_response_filter(_OnFilter):
    """Move the selected filter; filters work from top to bottom"""

    bl_idname = "hfx.move_response_filter"
    bl_label = "Move Filter"

    direction: EnumProperty(
        name="Direction",
        description="Where to",
        items=(("UP", "Up", "To work earlier"), ("DOWN", "Down", "To work later")),
    )

    def work(self, context: bpy.types.Context) -> str:
        effect = active_volume(context)
        step = -1 if self.direction == "UP" else 1
        active = effect.hfx.response_active
        responses.move_filter(effect, active, active + step)
        return ""


class HFX_OT_bake_response(_OnVolume):
    """Bake the contact response to keyframes, one on each frame of the scene"""

    bl_idname = "hfx.bake_response"
    bl_label = "Bake Response to Keyframes"

    target: EnumProperty(
        name="To",
        description="Keyframed property",
        items=response_baking.TARGETS,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def work(self, context: bpy.types.Context) -> str:
        count = response_baking.bake(context.scene, active_volume(context), self.target)
        return f"{count} keys"
