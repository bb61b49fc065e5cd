# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of objects that a .blend stores: ``Object.hfx`` of effects and bodies."""

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
from . import generation, scenes, surfaces
from .responses import HfxResponseFilter

_OVERRIDABLE = {"override": {"LIBRARY_OVERRIDABLE"}}

ROLES = (
    ("NONE", "None", "A normal object"),
    ("EFFECT", "Effect", "A haptic effect, painted on a body or placed in the scene"),
    ("BODY", "Body", "An armature whose wearer feels the effects"),
)
KINDS = (
    ("PAINTED", "Painted", "Felt where it is painted on the body (egocentric)"),
    ("VOLUME", "Volume", "Felt by what is inside it (allocentric)"),
    ("SURFACE", "Surface", "Felt by moving over the object (a haptic texture)"),
    ("SPOT", "Point on the Skin", "A disc that may move along a path on the body"),
    ("ACTUATORS", "Vector", "A curve for each actuator of one device"),
)
SHAPES = (
    ("CUBOID", "Box", "A box of the given size"),
    ("SPHERE", "Sphere", "A sphere of the given radius"),
    ("CYLINDER", "Cylinder", "A cylinder along the local Z axis"),
    ("CAPSULE", "Capsule", "A cylinder with round ends along the local Z axis"),
    ("MESH", "Mesh", "Exactly the shape of the object's own closed mesh"),
)
FALLOFFS = (
    ("none", "None", "Full strength everywhere inside"),
    ("linear", "Linear", "Strength rises evenly from the boundary inwards"),
    ("smooth", "Smooth", "Strength rises with a soft start and end"),
)
FELT_LAYERS = (
    ("VISIBLE", "Visible", "The outermost layer: clothes where there are any, else skin"),
    ("SKIN", "Skin", "The innermost layer: skin under clothes, where it is modelled"),
)
"""Layers of an avatar that its body may be fitted to."""

FOLLOWS = (
    ("AUTO", "Automatic", "The bones; the evaluated surface if more than bones deforms the avatar"),
    ("BONES", "Bones", "Fast: only the bones move the skin; other deformation is ignored"),
    ("SURFACE", "Surface", "The avatar's evaluated surface: shape keys, cloth, any modifier"),
)
BONE_REGIONS = (
    ("BODY", "Body", "Torso, head, arms and legs"),
    ("HANDS", "Hands", "Fingers and palms"),
    ("FEET", "Toes", "Single toes"),
    ("FACE", "Face", "Jaw, eyes and muscles of the face, which hardly any rig has"),
)
TEMPERATURE_REFERENCES = (
    ("AMBIENT", "Ambient", "Air, sun, fire: neutral at 24 degrees Celsius"),
    ("CONTACT", "Contact", "A touched object: neutral at the skin's 33 degrees Celsius"),
)


def _redraw_volume(self: HfxObjectProperties, _context: bpy.types.Context) -> None:
    from ..authoring import volumes

    volumes.refresh_display(self.id_data)


def _remember_body(self: HfxObjectProperties, _context: bpy.types.Context) -> None:
    self.body_name = "" if self.body is None else self.body.name


def _refresh_bones(self: HfxMappedBone, _context: bpy.types.Context) -> None:
    from ..avatars import bone_table

    bone_table.refresh(self.id_data)


def _parameter(modality: str, name: str, label: str, tip: str, **options: object) -> FloatProperty:
    """A property with the range and the default that the engine states for a parameter."""
    found = {p.name: p for p in MODALITIES[modality].parameters}[name]
    return FloatProperty(
        name=label,
        description=f"{tip} ({found.unit})",
        default=found.default,
        min=found.minimum,
        max=found.maximum,
        **_OVERRIDABLE,
        **options,
    )


def _share(name: str, tip: str, default: float, **options: object) -> FloatProperty:
    """A property for a share in 0..1 that library overrides may change."""
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
    """Additional mesh of an avatar in several pieces."""

    mesh: PointerProperty(
        name="Mesh",
        description="A mesh that shows this body",
        type=bpy.types.Object,
        **_OVERRIDABLE,
    )


class HfxMappedBone(bpy.types.PropertyGroup):
    """A row of the bone table; its name is that of the bone of the canonical skeleton."""

    bone: StringProperty(
        name="Bone",
        description="The avatar's bone that begins at this joint; empty: the skin here follows "
        "the joint above",
        update=_refresh_bones,
        **_OVERRIDABLE,
    )
    found: StringProperty(
        name="Found", description="The bone that was found automatically", **_OVERRIDABLE
    )
    follows: StringProperty(
        name="Follows",
        description="The bone that moves this skin while none is assigned",
        **_OVERRIDABLE,
    )


class HfxActuatorValue(bpy.types.PropertyGroup):
    """Actuator of a vector sensation; its name is the actuator's id."""

    value: _share("Value", "Share of the effect's full strength that this actuator gets", 0.0)


class HfxObjectProperties(bpy.types.PropertyGroup):
    """An object's haptic side. Parameters are in the units of the engine (SI, degrees C)."""

    role: EnumProperty(
        name="Role", description="Role of the object in haptics", items=ROLES, **_OVERRIDABLE
    )
    uid: StringProperty(
        name="Id", description="Stays the same when the object is renamed", **_OVERRIDABLE
    )

    group: StringProperty(
        name="Group",
        description="Effects of the same group are one row of the list, which opens",
        **_OVERRIDABLE,
    )

    modality: EnumProperty(
        name="Modality",
        description="Kind of sensation; each has its own parameters",
        items=MODALITY_ITEMS,
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    kind: EnumProperty(
        name="Kind", description="Where the effect is felt", items=KINDS, default="VOLUME"
    )
    activation: FloatProperty(
        name="Activation",
        description="Animated by clips; without animation the effect is always on",
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
        description="Neutral temperature, at which nothing is felt",
        items=TEMPERATURE_REFERENCES,
        **_OVERRIDABLE,
    )

    is_muted: BoolProperty(
        name="Mute",
        description="Neither felt nor exported",
        default=False,
        **_OVERRIDABLE,
    )
    is_solo: BoolProperty(
        name="Solo",
        description="Only effects that are solo are felt and exported",
        default=False,
        **_OVERRIDABLE,
    )

    shape: EnumProperty(
        name="Shape",
        description="Shape of the volume; handles in the viewport change its size",
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
        description="Radius of a sphere, a cylinder, a capsule, or the disc of a point on the skin",
        default=0.5,
        min=0.0,
        unit="LENGTH",
        update=_redraw_volume,
        **_OVERRIDABLE,
    )
    height: FloatProperty(
        name="Height",
        description="Whole height along the local Z axis, round ends included",
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
        "Falloff Share",
        "Part of the way from the boundary to the core over which strength rises",
        1.0,
    )

    surface: PointerProperty(
        name="Surface",
        description="Haptic texture of the object",
        type=surfaces.HfxSurfaceProperties,
    )

    response: CollectionProperty(
        name="Contact Response",
        description="Response of the volume to a touch: filters, from top to bottom",
        type=HfxResponseFilter,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    response_active: IntProperty(
        name="Filter", description="The selected filter of the response", options=set()
    )
    envelope: _share(
        "Envelope",
        "Strength of the volume, written by Bake Response, for drivers of sound or light",
        0.0,
    )

    path_position: _share(
        "Position",
        "Position of the point on its path, from the start (0) to the end (1)",
        0.0,
    )
    device: StringProperty(name="Device", description="Device whose actuators are driven")
    drive: CollectionProperty(
        name="Actuators",
        description="The strength of each actuator of the device",
        type=HfxActuatorValue,
        override={"LIBRARY_OVERRIDABLE"},
    )
    body: PointerProperty(
        name="Body",
        description="The body that the effect is painted on",
        type=bpy.types.Object,
        update=_remember_body,
        **_OVERRIDABLE,
    )
    body_name: StringProperty(
        name="Body's Name",
        description="Name of the body that the effect belongs to, also after it was deleted; "
        "empty: the only body of the scene",
        **_OVERRIDABLE,
    )
    model_id: StringProperty(name="Model", description="Perceptual model that is painted on")
    model_hash: StringProperty(name="Model Hash", description="Content of that model")
    avatar: PointerProperty(
        name="Avatar",
        description="The mesh that shows this body",
        type=bpy.types.Object,
        **_OVERRIDABLE,
    )
    avatar_parts: CollectionProperty(
        name="Parts",
        description="Other meshes of an avatar that is in several pieces",
        type=HfxAvatarPart,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    follow: EnumProperty(
        name="Follow",
        description="Source of the pose of this body",
        items=FOLLOWS,
        **_OVERRIDABLE,
    )
    felt_layer: EnumProperty(
        name="Layer",
        description="What is felt where clothes lie over skin",
        items=FELT_LAYERS,
        **_OVERRIDABLE,
    )
    bone_map: CollectionProperty(
        name="Bones",
        description="The bone of the avatar for each joint",
        type=HfxMappedBone,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    fit_kept: PointerProperty(
        name="Fit",
        description="Storage of the fit if the body is a library override; none: the armature",
        type=bpy.types.Mesh,
        **_OVERRIDABLE,
    )
    bone_map_active: IntProperty(
        name="Row", description="The selected row of the bone table", options=set()
    )
    bone_map_region: EnumProperty(
        name="Show",
        description="Part of the bone table to show",
        items=BONE_REGIONS,
        options=set(),
    )
    bone_map_convention: StringProperty(
        name="Convention", description="Recognised naming convention of the bones"
    )


_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (
        HfxAvatarPart,
        HfxMappedBone,
        HfxResponseFilter,
        HfxActuatorValue,
        HfxObjectProperties,
    )
)


def register() -> None:
    surfaces.register()
    generation.register()
    scenes.register()
    _classes()
    bpy.types.Object.hfx = PointerProperty(
        type=HfxObjectProperties, override={"LIBRARY_OVERRIDABLE"}
    )


def unregister() -> None:
    del bpy.types.Object.hfx
    _unregister_classes()
    scenes.unregister()
    generation.unregister()
    surfaces.unregister()
