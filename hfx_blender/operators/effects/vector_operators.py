# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations: effects with an F-curve for each actuator of one device."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ...authoring.paths import vector_sensations
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...files import resources
from ..shared import (
    EnumItems,
    HfxOperator,
    OnBodyOperator,
    active_effect,
    kept_items,
    select_only,
    target_body,
)


@kept_items
def _devices() -> EnumItems:
    from ...devices.configuration import list_devices

    return [(name, name, "") for name in list_devices(resources.user_devices())]


_MODALITIES = (
    ("FIRST", "Its First", "Of the device's first actuator"),
    *((modality.name, modality.title, modality.devices) for modality in MODALITIES.values()),
)


class HFX_OT_add_vector_sensation(OnBodyOperator):
    """Add an effect with a curve for each actuator of one device. Other devices ignore the
    effect
    """

    bl_idname = "hfx.add_vector_sensation"
    bl_label = "Vector Sensation"
    bl_property = "device"

    device: EnumProperty(
        name="Device", description="Device whose actuators are driven", items=_devices
    )
    modality: EnumProperty(
        name="Actuators",
        description="Modality of the device's actuators to drive",
        items=_MODALITIES,
    )
    name: StringProperty(
        name="Name", description="Name in the Outliner; empty: the name of the device"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        from ...devices.configuration import load_device

        effect = vector_sensations.add(
            context.scene,
            load_device(self.device, resources.user_devices()),
            target_body(context),
            modality=None if self.modality == "FIRST" else self.modality,
            name=self.name or None,
        )
        select_only(context, effect)
        return f"'{effect.name}': {len(effect.hfx.drive)} actuators, all at 0"


class HFX_OT_key_actuators(HfxOperator):
    """Insert a keyframe for every actuator of the vector sensation at the current frame"""

    bl_idname = "hfx.key_actuators"
    bl_label = "Key All Actuators"

    value: FloatProperty(
        name="Value",
        description="Value of all actuators; -1: the current values",
        default=-1.0,
        min=-1.0,
        max=1.0,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        effect = active_effect(context)
        return cls.needs(
            effect is not None and effect.hfx.kind == "ACTUATORS", "Select a vector sensation"
        )

    def work(self, context: bpy.types.Context) -> str:
        effect = active_effect(context)
        if effect.library is not None:
            raise InputError(f"'{effect.name}' is linked from another file.")
        for k, actuator in enumerate(effect.hfx.drive):
            if self.value >= 0.0:
                actuator.value = self.value
            effect.keyframe_insert(f"hfx.drive[{k}].value", frame=context.scene.frame_current)
        return ""
