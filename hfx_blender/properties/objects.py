# SPDX-License-Identifier: GPL-3.0-or-later
"""Object properties stored in a .blend: ``Object.hfx`` of effects and bodies."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..engine.modality import MODALITIES, MODALITY_ITEMS
from . import scenes, surface_properties
from .response_properties import HfxResponseFilter

_OVERRIDABLE = {"override": {"LIBRARY_OVERRIDABLE"}}

ROLES = (
    ("NONE", "None", "A normal object"),
    ("EFFECT", "Effect", "A haptic effect, painted on a body or placed in the scene"),
    ("BODY", "Body", "An armature with a haptic body"),
)
KINDS = (
    ("PAINTED", "Painted", "Acts on skin painted on the body (egocentric)"),
    ("VOLUME", "Volume", "Acts on skin inside the volume (allocentric)"),
    ("SURFACE", "Surface", "Acts on skin that moves over the object (haptic texture)"),
    ("SPOT", "Point on the Skin", "A disc on the skin, still or moving along a path"),
    ("ACTUATORS", "Vector", "One curve per actuator of a device"),
)
SHAPES = (
    ("CUBOID", "Box", "A box of the given size"),
    ("SPHERE", "Sphere", "A sphere of the given radius"),
    ("CYLINDER", "Cylinder", "A cylinder along the local Z axis"),
    ("CAPSULE", "Capsule", "A cylinder with round ends along the local Z axis"),
    ("MESH", "Mesh", "The closed mesh of the object"),
)
FALLOFFS = (
    ("none", "None", "Full strength in the whole volume"),
    ("linear", "Linear", "Strength rises linearly from the boundary inwards"),
    ("smooth", "Smooth", "Strength rises with a soft start and end"),
)
FELT_LAYERS = (
    ("VISIBLE", "Visible", "The outermost layer: clothes, or uncovered skin"),
    ("SKIN", "Skin", "The innermost layer: modelled skin under clothes"),
)
"""Layers of an avatar to fit a body to."""

FOLLOWS = (
    ("AUTO", "Automatic", "Bones, or the evaluated surface if further modifiers deform the avatar"),
    ("BONES", "Bones", "Bones only: fast, without further deformation"),
    ("SURFACE", "Surface", "The avatar's evaluated surface: shape keys, cloth, any modifier"),
)
BONE_REGIONS = (
    ("BODY", "Body", "Torso, head, arms and legs"),
    ("HANDS", "Hands", "Fingers and palms"),
    ("FEET", "Toes", "Single toes"),
    ("FACE", "Face", "Jaw, eyes and facial muscles, missing in most rigs"),
)
TEMPERATURE_REFERENCES = (
    ("AMBIENT", "Ambient", "Air, sun, fire. Neutral at 24 degrees Celsius"),
    ("CONTACT", "Contact", "A touched object. Neutral at skin temperature, 33 degrees Celsius"),
)


def _redraw_volume(self: HfxObjectProperties, _context: bpy.types.Context) -> None:
    from ..authoring import volumes

    volumes.refresh_display(self.id_data)


def _store_body_name(self: HfxObjectProperties, _context: bpy.types.Context) -> None:
    self.body_name = "" if self.body is None else self.body.name


def _refresh_bones(self: HfxMappedBone, _context: bpy.types.Context) -> None:
    from ..avatars import bone_table

    bone_table.refresh(self.id_data)


def _parameter(modality: str, name: str, label: str, tip: str, **options: object) -> FloatProperty:
    """Overridable float property with a parameter's default and range, its unit in the tooltip."""
    parameter = {p.name: p for p in MODALITIES[modality].parameters}[name]
    return FloatProperty(
        name=label,
        description=f"{tip} ({parameter.unit})",
        default=parameter.default,
        min=parameter.minimum,
        max=parameter.maximum,
        **_OVERRIDABLE,
        **options,
    )


def _share(name: str, tip: str, default: float, **options: object) -> FloatProperty:
    """Float property with slider from 0 to 1, editable in library overrides; ``tip``: tooltip."""
    return FloatProperty(
        name=name,
        description=tip,
        default=default,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        **_OVERRIDABLE,
        **options,
    )


class HfxAvatarPart(bpy.types.PropertyGroup):
    """Further mesh of an avatar; the first mesh is a property of the body."""

    mesh: PointerProperty(
        name="Mesh",
        description="A mesh of this body's avatar",
        type=bpy.types.Object,
        **_OVERRIDABLE,
    )


class HfxMappedBone(bpy.types.PropertyGroup):
    """Row of the bone table, named after a bone of the canonical skeleton."""

    bone: StringProperty(
        name="Bone",
        description="The avatar's bone at this joint. Empty: this skin follows the parent joint",
        update=_refresh_bones,
        **_OVERRIDABLE,
    )
    found: StringProperty(
        name="Found", description="The automatically detected bone", **_OVERRIDABLE
    )
    follows: StringProperty(
        name="Follows",
        description="The bone that moves this skin without an assigned bone",
        **_OVERRIDABLE,
    )


class HfxActuatorValue(bpy.types.PropertyGroup):
    """Actuator of a vector sensation, named by the actuator's id."""

    value: _share(
        "Value", "Strength of this actuator as a share of the effect's full strength", 0.0
    )


class HfxObjectProperties(bpy.types.PropertyGroup):
    """Haptic properties of an object. Parameters are in SI units and degrees Celsius."""

    role: EnumProperty(
        name="Role", description="Role of the object in haptics", items=ROLES, **_OVERRIDABLE
    )
    uid: StringProperty(
        name="Id", description="Permanent id, independent of the object's name", **_OVERRIDABLE
    )

    group: StringProperty(
        name="Group",
        description="Effects of a group share an expandable row of the list",
        **_OVERRIDABLE,
    )

    modality: EnumProperty(
        name="Modality",
        description="Kind of sensation, with its own parameters",
        items=MODALITY_ITEMS,
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    kind: EnumProperty(
        name="Kind", description="Region of the effect", items=KINDS, default="VOLUME"
    )
    activation: FloatProperty(
        name="Activation",
        description="Animated by clips. Without animation the effect is always on",
        default=0.0,
        min=0.0,
        max=1.0,
        **_OVERRIDABLE,
    )
    intensity: _share("Intensity", "Share of the effect's full strength", 1.0)
    amplitude: _parameter("vibration", "amplitude_m_s2", "Amplitude", "Peak acceleration")
    frequency: _parameter("vibration", "frequency_hz", "Frequency", "Vibration frequency")
    pressure: _parameter("pressure", "pressure_kpa", "Pressure", "Pressure on the skin")
    temperature: _parameter("temperature", "temperature_c", "Temperature", "Temperature")
    wind_speed: _parameter("wind", "speed_m_s", "Speed", "Speed of the air")
    temperature_reference: EnumProperty(
        name="Reference",
        description="Neutral temperature, without a sensation",
        items=TEMPERATURE_REFERENCES,
        **_OVERRIDABLE,
    )

    is_muted: BoolProperty(
        name="Mute",
        description="Disable this effect in live playback and exports",
        default=False,
        **_OVERRIDABLE,
    )
    is_solo: BoolProperty(
        name="Solo", description="Disable effects that are not solo", default=False, **_OVERRIDABLE
    )

    shape: EnumProperty(
        name="Shape",
        description="Shape of the volume. Drag the handles in the viewport to resize",
        items=SHAPES,
        default="SPHERE",
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    size: FloatVectorProperty(
        name="Size",
        description="Edge lengths of the box",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        subtype="XYZ_LENGTH",
        unit="LENGTH",
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    radius: FloatProperty(
        name="Radius",
        description="Radius of the sphere, cylinder, capsule, or disc on the skin",
        default=0.5,
        min=0.0,
        unit="LENGTH",
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    height: FloatProperty(
        name="Height",
        description="Height along the local Z axis, including round ends",
        default=2.0,
        min=0.0,
        unit="LENGTH",
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    falloff: EnumProperty(
        name="Falloff",
        description="Rise of the strength from the boundary inwards",
        items=FALLOFFS,
        **_OVERRIDABLE,
    )
    falloff_share: _share(
        "Falloff Share", "Depth of the rise, as a share of the way from boundary to core", 1.0
    )

    surface: PointerProperty(
        name="Surface",
        description="Haptic texture of the object",
        type=surface_properties.HfxSurfaceProperties,
    )

    response: CollectionProperty(
        name="Contact Response",
        description="Response of the volume to a touch: filters in order, from top to bottom",
        type=HfxResponseFilter,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    response_active: IntProperty(
        name="Filter", description="Selected filter of the response", options=set()
    )
    envelope: _share(
        "Envelope", "Strength of the volume from Bake Response, as a source for drivers", 0.0
    )

    path_position: _share("Position", "Position on the path, from start (0) to end (1)", 0.0)
    device: StringProperty(name="Device", description="Device of the driven actuators")
    drive: CollectionProperty(
        name="Actuators",
        description="Strength of each actuator of the device",
        type=HfxActuatorValue,
        override={"LIBRARY_OVERRIDABLE"},
    )
    body: PointerProperty(
        name="Body",
        description="Body of the painted effect",
        type=bpy.types.Object,
        update=_store_body_name,
        **_OVERRIDABLE,
    )
    body_name: StringProperty(
        name="Body's Name",
        description="Name of the effect's body, also after deletion of the body. Empty: the only "
        "body of the scene",
        **_OVERRIDABLE,
    )
    model_id: StringProperty(name="Model", description="Painted perceptual model")
    model_hash: StringProperty(name="Model Hash", description="Hash of the painted model's content")
    avatar: PointerProperty(
        name="Avatar",
        description="Main mesh of this body's avatar",
        type=bpy.types.Object,
        **_OVERRIDABLE,
    )
    avatar_parts: CollectionProperty(
        name="Parts",
        description="Further meshes of the avatar",
        type=HfxAvatarPart,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    follow: EnumProperty(
        name="Follow", description="Source of the pose of this body", items=FOLLOWS, **_OVERRIDABLE
    )
    felt_layer: EnumProperty(
        name="Layer",
        description="Layer for haptics if clothes cover skin",
        items=FELT_LAYERS,
        **_OVERRIDABLE,
    )
    bone_map: CollectionProperty(
        name="Bones",
        description="Bone of the avatar for each joint",
        type=HfxMappedBone,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    fit_kept: PointerProperty(
        name="Fit",
        description="Storage of the fit of a library override. None: the armature",
        type=bpy.types.Mesh,
        **_OVERRIDABLE,
    )
    bone_map_active: IntProperty(
        name="Row", description="Selected row of the bone table", options=set()
    )
    bone_map_region: EnumProperty(
        name="Show", description="Part of the bone table to show", items=BONE_REGIONS, options=set()
    )
    bone_map_convention: StringProperty(
        name="Convention", description="Recognised naming convention of the bones"
    )


_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (HfxAvatarPart, HfxMappedBone, HfxResponseFilter, HfxActuatorValue, HfxObjectProperties)
)


def register() -> None:
    surface_properties.register()
    scenes.register()
    _classes()
    bpy.types.Object.hfx = PointerProperty(
        type=HfxObjectProperties, override={"LIBRARY_OVERRIDABLE"}
    )


def unregister() -> None:
    del bpy.types.Object.hfx
    _unregister_classes()
    scenes.unregister()
    surface_properties.unregister()
