# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic bodies: add the built-in avatar, mark an armature, let it walk."""

from __future__ import annotations

import bpy
from bpy.props import CollectionProperty, IntProperty

from .. import bodies
from .shared import HfxOperator


class HFX_OT_add_avatar(HfxOperator):
    """Add the built-in avatar: a haptic body that is ready to be posed and to feel"""

    bl_idname = "hfx.add_avatar"
    bl_label = "Avatar"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode == "OBJECT":
            return True
        cls.poll_message_set("Go to Object Mode first")
        return False

    def work(self, context: bpy.types.Context) -> str:
        armature, _ = bodies.add_avatar(context)
        armature.location = context.scene.cursor.location
        return f"'{armature.name}' is a haptic body"


class HFX_OT_mark_body(HfxOperator):
    """Make the active armature a haptic body; the selected mesh is its avatar, whatever its \
pose, size and bones"""

    bl_idname = "hfx.mark_body"
    bl_label = "Add Haptic Body"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.object is not None and context.object.type == "ARMATURE":
            return True
        cls.poll_message_set("Select an armature")
        return False

    def work(self, context: bpy.types.Context) -> str:
        body, avatar = context.object, _avatar_mesh(context)
        context.view_layer.update()
        for warning in bodies.add_body(body, avatar):
            self.report({"WARNING"}, f"{body.name}: {warning}")
        shown = f", shown by '{avatar.name}'" if avatar else ""
        return f"'{body.name}' is a haptic body{shown}"


def _avatar_mesh(context: bpy.types.Context) -> bpy.types.Object | None:
    """The selected mesh, or else the largest that hangs on the active armature."""
    meshes = [obj for obj in context.selected_objects if obj.type == "MESH"]
    if not meshes:
        meshes = [obj for obj in context.object.children_recursive if obj.type == "MESH"]
    return max(meshes, key=lambda obj: (len(obj.data.vertices), obj.name), default=None)


class HfxPlace(bpy.types.PropertyGroup):
    """A place of a way, in the world."""

    location: bpy.props.FloatVectorProperty(name="Location", subtype="TRANSLATION")


class HFX_OT_add_walk(HfxOperator):
    """Let the active haptic body walk from place to place at an even speed"""

    bl_idname = "hfx.add_walk"
    bl_label = "Walk"

    places: CollectionProperty(type=HfxPlace)
    frame_start: IntProperty(name="Start", default=1)
    frame_end: IntProperty(name="End", default=250)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.object is not None and context.object.hfx.role == "BODY":
            return True
        cls.poll_message_set("Select a haptic body")
        return False

    def work(self, context: bpy.types.Context) -> str:
        way = [tuple(place.location) for place in self.places]
        bodies.add_walk(context.object, way, self.frame_start, self.frame_end)
        return ""


register, unregister = bpy.utils.register_classes_factory(
    (HFX_OT_add_avatar, HFX_OT_mark_body, HfxPlace, HFX_OT_add_walk)
)
