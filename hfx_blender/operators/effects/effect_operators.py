# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects: addition of volumes, painted effects and vector sensations; contact responses."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, StringProperty

from ...authoring import responses
from ...authoring.effects import effects
from ...authoring.paths import vector_sensations
from ...authoring.responses import KINDS
from ...blender.scene_info import metres_of
from ...engine.modality import MODALITIES, MODALITY_ITEMS
from ...export import response_baking
from ...files import resources
from ...properties.objects import SHAPES
from ...text import named
from .. import shared
from ..live.connect_operators import device_items

_NAME_TIP = "Name in the Outliner; empty: the kind of effect"


def active_volume(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active haptic volume, or the only volume emitted by the active object; otherwise None."""
    effect = shared.active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "VOLUME" else None


def active_vector(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active effect if a vector sensation (a curve for each actuator); otherwise None."""
    effect = shared.active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "ACTUATORS" else None


def show_wire_colours(context: bpy.types.Context) -> None:
    """Show wires in object colours, which encode the modality, if in the theme's colour."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        if space.shading.wireframe_color_type == "THEME":
            space.shading.wireframe_color_type = "OBJECT"


class HFX_OT_add_volume(shared.HfxOperator):
    """Add a haptic volume. Bodies inside it feel the effect"""

    leaves_mode = True
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

    def work(self, context: bpy.types.Context) -> None:
        # Defaults are metres; a length that is not set is converted to the scene's unit.
        units_a_metre = 1.0 / metres_of(context.scene)
        for name in ("radius", "height"):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(self, name) * units_a_metre)
        if not self.properties.is_property_set("size"):
            self.size = [edge * units_a_metre for edge in self.size]
        effect = effects.add_volume(context.scene, self.modality, self.shape, self.name or None)
        effect.hfx.size = self.size
        effect.hfx.radius = self.radius
        effect.hfx.height = self.height
        effect.location = self.location
        show_wire_colours(context)
        shared.select_only(context, effect)


class HFX_OT_volume_from_mesh(shared.HfxOperator):
    """Add a haptic volume with the shape of the active mesh, parented to the mesh, which is then
    shown as a wire"""

    leaves_mode = True
    bl_label = "Haptic Volume from Mesh"

    modality: EnumProperty(
        name="Modality", description="Sensation inside the volume", items=MODALITY_ITEMS
    )
    name: StringProperty(name="Name", description=_NAME_TIP)
    requires = (shared.ON_MESH,)

    def work(self, context: bpy.types.Context) -> None:
        source = context.object
        # A solid mesh would hide the skin inside; an avatar shows the colours itself.
        has_body = shared.active_body(context) is not None
        effect = effects.volume_from_mesh(context.scene, self.modality, source, self.name or None)
        if not has_body:
            source.display_type = "WIRE"
        show_wire_colours(context)
        shared.select_only(context, effect)


class HFX_OT_add_painted(shared.OnBodyOperator):
    """Add an effect with a painted area on a haptic body"""

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
        body = shared.target_body(context)
        effect = effects.add_painted(context.scene, self.modality, body, self.name or None)
        shared.select_only(context, effect)
        if self.paint:  # from the button of the next step, which leads straight into painting
            bpy.ops.hfx.paint_begin()
            return ""
        return f"'{effect.name}' has no painted area yet"


class HFX_OT_make_editable(shared.HfxOperator):
    """Let settings and clips of an effect of a linked file be changed in this file"""

    bl_label = "Make Editable"
    requires = (
        (
            lambda context: (
                shared.active_effect(context) and effects.is_locked(shared.active_effect(context))
            ),
            "Select an effect that belongs to a linked file",
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        effect, scene = shared.active_effect(context), context.scene
        if effect.library is not None:
            linked, top = effect, scene.collection
            # An object linked by itself is replaced here, with its collection below.
            linked.override_create(remap_local_usages=True)
            for parent in (top, *top.children_recursive):
                for child in parent.children if parent.library is None else ():
                    if child.library is not None and linked in child.all_objects.values():
                        child.override_hierarchy_create(scene, context.view_layer)
                        parent.children.unlink(child)
            overrides = (obj for obj in scene.objects if obj.override_library is not None)
            effect = next(obj for obj in overrides if obj.override_library.reference == linked)
            shared.select_only(context, effect)
        effect.override_library.is_system_override = False
        locked = [other for other in effects.effects_of(scene) if effects.is_locked(other)]
        rest = f"; linked effects stay unchanged: {named([o.name for o in locked])}"
        return f"1 effect can be changed: '{effect.name}'{rest if locked else ''}"


_MODALITIES = (
    ("FIRST", "Its First", "Of the device's first actuator"),
    *((modality.name, modality.title, modality.devices) for modality in MODALITIES.values()),
)


class HFX_OT_add_vector_sensation(shared.MenuOperator, shared.OnBodyOperator):
    """Add an effect with a curve for each actuator of one device. Other devices ignore the
    effect"""

    bl_label = "Vector Sensation"
    bl_property = "device"

    device: EnumProperty(
        name="Device", description="Device whose actuators are driven", items=device_items
    )
    modality: EnumProperty(
        name="Actuators",
        description="Modality of the device's actuators to drive",
        items=_MODALITIES,
    )
    name: StringProperty(
        name="Name", description="Name in the Outliner; empty: the name of the device"
    )

    def work(self, context: bpy.types.Context) -> str:
        from ...devices.configuration import load_device

        effect = vector_sensations.add(
            context.scene,
            load_device(self.device, resources.user_devices()),
            shared.target_body(context),
            modality=None if self.modality == "FIRST" else self.modality,
            name=self.name or None,
        )
        shared.select_only(context, effect)
        return f"'{effect.name}': {len(effect.hfx.drive)} actuators, all at 0"


class HFX_OT_key_actuators(shared.HfxOperator):
    """Insert a keyframe for every actuator of the vector sensation at the current frame"""

    bl_label = "Key All Actuators"

    value: FloatProperty(
        name="Value",
        description="Value of all actuators; -1: the current values",
        default=-1.0,
        min=-1.0,
        max=1.0,
    )
    requires = ((active_vector, "Select a vector sensation"), shared.IS_EDITABLE)

    def work(self, context: bpy.types.Context) -> None:
        effect = active_vector(context)
        for k, actuator in enumerate(effect.hfx.drive):
            if self.value >= 0.0:
                actuator.value = self.value
            effect.keyframe_insert(f"hfx.drive[{k}].value", frame=context.scene.frame_current)


class _OnVolume(shared.HfxOperator):
    requires = ((active_volume, "Select a haptic volume"), shared.IS_EDITABLE)


class _OnFilter(shared.HfxOperator):
    requires = (
        (
            lambda context: active_volume(context) and active_volume(context).hfx.response,
            "Add a filter first",
        ),
        shared.IS_EDITABLE,
    )


class HFX_OT_add_response_filter(_OnVolume):
    """Add a filter to the volume's contact response"""

    bl_label = "Add Filter"

    kind: EnumProperty(
        name="Kind", description="Function of the filter", items=KINDS, default="impact"
    )

    def work(self, context: bpy.types.Context) -> None:
        responses.add_filter(active_volume(context), self.kind)


class HFX_OT_remove_response_filter(_OnFilter):
    """Remove the active filter with the filter's animation"""

    bl_label = "Remove Filter"

    def work(self, context: bpy.types.Context) -> None:
        effect = active_volume(context)
        last = len(effect.hfx.response) - 1
        responses.remove_filter(effect, min(effect.hfx.response_active, last))


class HFX_OT_move_response_filter(_OnFilter):
    """Move the selected filter; filters work from top to bottom"""

    bl_label = "Move Filter"

    direction: EnumProperty(
        name="Direction",
        description="Where to",
        items=(("UP", "Up", "To work earlier"), ("DOWN", "Down", "To work later")),
    )

    def work(self, context: bpy.types.Context) -> None:
        effect, step = active_volume(context), -1 if self.direction == "UP" else 1
        active = effect.hfx.response_active
        responses.move_filter(effect, active, active + step)


class HFX_OT_bake_response(_OnVolume):
    """Bake the contact response to keyframes, one on each frame of the scene"""

    bl_label = "Bake Response to Keyframes"

    target: EnumProperty(name="To", description="Keyframed property", items=response_baking.TARGETS)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def work(self, context: bpy.types.Context) -> str:
        count = response_baking.bake(context.scene, active_volume(context), self.target)
        return f"Inserted {count} keyframes"
