# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects: add a volume, a volume with the shape of a mesh, a painted effect."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, StringProperty

from ...authoring.effects import effects
from ...blender.scene_info import metres_of
from ...engine.modality import MODALITY_ITEMS
from ...properties.objects import SHAPES
from ..shared import ON_MESH, HfxOperator, OnBodyOperator, active_effect, select_only, target_body

_NAME_TIP = "Name in the Outliner; empty: the kind of effect"


def _show_wire_colours(context: bpy.types.Context) -> None:
    """Show wires in object colours, which encode the modality, if the viewport has theme
    colours.
    """
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        if space.shading.wireframe_color_type == "THEME":
            space.shading.wireframe_color_type = "OBJECT"


class HFX_OT_add_volume(HfxOperator):
    """Add a haptic volume. Bodies inside it feel the effect"""

    leaves_mode = True
    bl_idname = "hfx.add_volume"
    bl_label = "Haptic Volume"

    modality: EnumProperty(
        name="Modality", description="Sensation inside the volume", items=MODALITY_ITEMS
    )
    shape: EnumProperty(
        name="Shape",
        description="Shape of the volume; handles in the viewport change its size",
        items=SHAPES[:-1],
        default="SPHERE",
    )
    size: FloatVectorProperty(
        name="Size",
        description="Edge lengths of a box",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        subtype="XYZ_LENGTH",
        unit="LENGTH",
    )
    radius: FloatProperty(
        name="Radius",
        description="Radius of a sphere, a cylinder or a capsule",
        default=0.5,
        min=0.0,
        unit="LENGTH",
    )
    height: FloatProperty(
        name="Height",
        description="Height of a cylinder or a capsule, round ends included",
        default=2.0,
        min=0.0,
        unit="LENGTH",
    )
    location: FloatVectorProperty(
        name="Location", description="Centre in world space", subtype="TRANSLATION"
    )
    name: StringProperty(name="Name", description=_NAME_TIP)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("location"):
            self.location = context.scene.cursor.location
        return self.execute(context)

    def work(self, context: bpy.types.Context) -> str:
        self._use_metres(1.0 / metres_of(context.scene))
        effect = effects.add_volume(context.scene, self.modality, self.shape, self.name or None)
        effect.hfx.size = self.size
        effect.hfx.radius = self.radius
        effect.hfx.height = self.height
        effect.location = self.location
        _show_wire_colours(context)
        select_only(context, effect)
        return ""

    def _use_metres(self, units_a_metre: float) -> None:
        """Convert the defaults of unset lengths, in metres, to the scene's unit, in place."""
        for name in ("radius", "height"):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(self, name) * units_a_metre)
        if not self.properties.is_property_set("size"):
            self.size = [edge * units_a_metre for edge in self.size]


class HFX_OT_volume_from_mesh(HfxOperator):
    """Add a haptic volume with the shape of the active mesh, parented to the mesh"""

    leaves_mode = True
    bl_idname = "hfx.volume_from_mesh"
    bl_label = "Haptic Volume from Mesh"

    modality: EnumProperty(
        name="Modality", description="Sensation inside the volume", items=MODALITY_ITEMS
    )
    name: StringProperty(name="Name", description=_NAME_TIP)
    requires = (ON_MESH,)

    def work(self, context: bpy.types.Context) -> str:
        effect = effects.volume_from_mesh(
            context.scene, self.modality, context.object, self.name or None
        )
        _show_wire_colours(context)
        select_only(context, effect)
        return ""


class HFX_OT_add_painted(OnBodyOperator):
    """Add an effect with a painted area on a haptic body"""

    bl_idname = "hfx.add_painted"
    bl_label = "Painted Effect"

    modality: EnumProperty(
        name="Modality",
        description="Sensation on the painted area",
        items=MODALITY_ITEMS,
        default="pressure",
    )
    name: StringProperty(name="Name", description=_NAME_TIP)
    paint: BoolProperty(
        name="Paint", description="Start painting the area", default=False, options={"SKIP_SAVE"}
    )

    def work(self, context: bpy.types.Context) -> str:
        body = target_body(context)
        effect = effects.add_painted(context.scene, self.modality, body, self.name or None)
        select_only(context, effect)
        if self.paint:
            bpy.ops.hfx.paint_begin()
            return "Paint, then press Finish Painting"
        return f"'{effect.name}' has no painted area yet"


class HFX_OT_make_editable(HfxOperator):
    """Let settings, area and clips of an effect of a linked file be changed in this file"""

    bl_idname = "hfx.make_editable"
    bl_label = "Make Editable"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_effect(context)
        is_locked = effect is not None and effects.is_locked(effect)
        return cls.needs(is_locked, "Select an effect that belongs to a linked file")

    def work(self, context: bpy.types.Context) -> str:
        active_effect(context).override_library.is_system_override = False
        return ""
