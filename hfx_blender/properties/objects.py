# SPDX-License-Identifier: GPL-3.0-or-later
"""Object properties stored in a .blend: ``Object.hfx`` of effects and bodies."""

from collections.abc import Callable

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

from ..authoring.responses import KINDS as FILTER_KINDS
from ..engine.modality import MODALITIES, MODALITY_ITEMS
from ..engine.response_filters.controls import CONTROLS, FilterKind
from . import scenes, surface_properties

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
    ("VISIBLE", "Clothes and Skin", "The outermost layer: clothes, or uncovered skin"),
    ("SKIN", "Skin Below Clothes", "The innermost layer: modelled skin under clothes"),
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

OPERATIONS = (
    ("multiply", "Multiply", "Multiply the result of the filters above"),
    ("add", "Add", "Add to the result of the filters above"),
    ("maximum", "Maximum", "Maximum of this and the result of the filters above"),
)
ABOUT_WHAT = (
    ("centre", "Centre", "The volume's origin"),
    ("axis", "Axis", "The volume's local Z axis"),
)
DOMAINS = (("time", "Time", "Seconds since the scene's first frame"), *ABOUT_WHAT)


def _redraw_volume(self: "HfxObjectProperties", _context: bpy.types.Context) -> None:
    # On use: the modules load numpy, and Blender's start does not wait for it.
    from ..authoring import volumes

    volumes.refresh_display(self.id_data)


def _store_body_name(self: "HfxObjectProperties", _context: bpy.types.Context) -> None:
    self.body_name = "" if self.body is None else self.body.name


def _refresh_bones(self: "HfxMappedBone", _context: bpy.types.Context) -> None:
    from ..avatars import bone_table

    bone_table.refresh(self.id_data)


def _overridable(kind: Callable[..., object], label: str, tip: str, **options: object) -> object:
    """Property of the type ``kind``, as FloatProperty, editable in library overrides."""
    return kind(name=label, description=tip, override={"LIBRARY_OVERRIDABLE"}, **options)


def _constant(kind: Callable[..., object], label: str, tip: str, **options: object) -> object:
    """Property open to library overrides, but not to keyframes and drivers."""
    return _overridable(kind, label, tip, options=set(), **options)


def _steady(kind: Callable[..., object], label: str, tip: str, **options: object) -> object:
    """Property without keyframes and drivers: samples of all times use the same value."""
    return kind(name=label, description=tip, options=set(), **options)


def _parameter(modality: str, name: str, label: str, tip: str, **options: object) -> object:
    """Overridable float property with a parameter's default and range, its unit in the tooltip."""
    parameter = next(p for p in MODALITIES[modality].parameters if p.name == name)
    return _overridable(
        FloatProperty,
        label,
        f"{tip} ({parameter.unit})",
        default=parameter.default,
        min=parameter.minimum,
        max=parameter.maximum,
        **options,
    )


def _force(label: str, tip: str, default: float, most: float) -> object:
    """Overridable coefficient of a contact law."""
    limits = {"default": default, "min": 0.0, "soft_max": most, "max": 100.0 * most}
    return _constant(FloatProperty, label, tip, **limits)


def _share(label: str, tip: str, default: float, **options: object) -> object:
    """Overridable float property with a slider from 0 to 1; ``tip`` is the tooltip."""
    limits = {"default": default, "min": 0.0, "max": 1.0, "subtype": "FACTOR"}
    return _overridable(FloatProperty, label, tip, **limits, **options)


def _length(label: str, tip: str, default: float, **options: object) -> object:
    """Overridable float property in the scene's unit of length; ``tip`` is the tooltip."""
    return _overridable(FloatProperty, label, tip, default=default, unit="LENGTH", **options)


def _control(kind: str, control: str, label: str, tip: str, **options: object) -> object:
    """Overridable float property with a filter control's default and range; lengths up to 1e6."""
    info = next(info for info in CONTROLS[FilterKind(kind)] if info.name == control)
    # Lengths are stored in Blender's units, for which a limit in metres has no meaning.
    highest = 1e6 if options.get("unit") == "LENGTH" else info.maximum
    return _overridable(
        FloatProperty, label, tip, default=info.default, min=info.minimum, max=highest, **options
    )


class HfxAvatarPart(bpy.types.PropertyGroup):
    """Further mesh of an avatar; the first mesh is a property of the body."""

    mesh: _overridable(
        PointerProperty, "Mesh", "A mesh of this body's avatar", type=bpy.types.Object
    )


class HfxMappedBone(bpy.types.PropertyGroup):
    """Row of the bone table, named after a bone of the canonical skeleton."""

    bone: _overridable(
        StringProperty,
        "Bone",
        "The avatar's bone at this joint. Empty: this skin follows the parent joint",
        update=_refresh_bones,
    )
    found: _overridable(StringProperty, "Found", "The automatically detected bone")
    follows: _overridable(
        StringProperty, "Follows", "The bone that moves this skin without an assigned bone"
    )


class HfxActuatorValue(bpy.types.PropertyGroup):
    """Actuator of a vector sensation, named by the actuator's id."""

    value: _share(
        "Value", "Strength of this actuator as a share of the effect's full strength", 0.0
    )


class HfxResponseFilter(bpy.types.PropertyGroup):
    """Contact response filter with the controls of all kinds. Lengths are in Blender units."""

    kind: _steady(
        EnumProperty, "Kind", "Function of the filter", items=FILTER_KINDS, default="impact"
    )
    operation: _steady(
        EnumProperty,
        "Operation",
        "Operation with the result of the filters above",
        items=OPERATIONS,
    )
    about: _steady(EnumProperty, "From", "Reference of the measurement", items=ABOUT_WHAT)
    domain: _steady(EnumProperty, "Over", "Variable of the sine", items=DOMAINS)
    is_muted: _steady(BoolProperty, "Mute", "Leave this filter out")

    influence: _control(
        "speed", "influence", "Influence", "Influence of this filter", subtype="FACTOR"
    )
    near: _control(
        "distance", "near_m", "Near", "Largest distance of the first value", unit="LENGTH"
    )
    far: _control(
        "distance", "far_m", "Far", "Smallest distance of the second value", unit="LENGTH"
    )
    near_value: _control(
        "distance", "near_value", "Value Near", "Strength at the near end", subtype="FACTOR"
    )
    far_value: _control(
        "distance", "far_value", "Value Far", "Strength at the far end", subtype="FACTOR"
    )
    still_speed: _control(
        "speed", "still_m_s", "Still (m/s)", "Largest relative speed without a sensation"
    )
    full_speed: _control(
        "speed", "full_m_s", "Full (m/s)", "Smallest relative speed of full strength"
    )
    attack: _control("impact", "attack_s", "Attack (s)", "Time constant of the rise")
    decay: _control(
        "impact", "decay_s", "Decay (s)", "Time constant of the decay. A short decay feels stiff"
    )
    reach: _control(
        "proximity", "range_m", "Range", "Distance of the first sensation", unit="LENGTH"
    )
    exponent: _control("proximity", "exponent", "Exponent", "1: linear rise. Above 1: late rise")
    frequency: _control("sine", "cycles", "Frequency (Hz)", "Oscillations per second")
    wavelength: _length("Wavelength", "Wavelength", 0.1, min=1e-4, max=1000.0)
    depth: _control(
        "sine",
        "depth",
        "Depth",
        "Amplitude: strength oscillates between 1 and 1 - depth",
        subtype="FACTOR",
    )
    phase: _control("sine", "phase", "Phase (turns)", "Phase at the start")


class HfxObjectProperties(bpy.types.PropertyGroup):
    """Haptic properties of an object. Parameters are in SI units and degrees Celsius."""

    role: _constant(EnumProperty, "Role", "Role of the object in haptics", items=ROLES)
    uid: _overridable(StringProperty, "Id", "Permanent id, independent of the object's name")

    group: _overridable(
        StringProperty, "Group", "Effects of a group share an expandable row of the list"
    )
    # Equal on all effects of a group. Not animatable: each effect would need the keyframes.
    is_group_muted: _constant(BoolProperty, "Mute Group", "Disable all effects of the group")
    group_gain: _constant(
        FloatProperty,
        "Group Gain",
        "Common factor of the intensities of all effects of the group",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )

    modality: _constant(
        EnumProperty,
        "Modality",
        "Kind of sensation, with its own parameters",
        items=MODALITY_ITEMS,
        update=_redraw_volume,
    )
    kind: _steady(EnumProperty, "Kind", "Region of the effect", items=KINDS, default="VOLUME")
    activation: _overridable(
        FloatProperty,
        "Activation",
        "Animated by clips. Without animation the effect is always on",
        min=0.0,
        max=1.0,
    )
    intensity: _share("Intensity", "Share of the effect's full strength", 1.0)
    amplitude: _parameter("vibration", "amplitude_m_s2", "Amplitude", "Peak acceleration")
    frequency: _parameter("vibration", "frequency_hz", "Frequency", "Vibration frequency")
    pressure: _parameter("pressure", "pressure_kpa", "Pressure", "Pressure on the skin")
    temperature: _parameter(
        "temperature", "temperature_c", "Temperature", "Temperature", update=_redraw_volume
    )
    wind_speed: _parameter("wind", "speed_m_s", "Speed", "Speed of the air")
    temperature_reference: _constant(
        EnumProperty,
        "Reference",
        "Neutral temperature, without a sensation",
        items=TEMPERATURE_REFERENCES,
    )

    is_muted: _constant(BoolProperty, "Mute", "Disable this effect in live playback and exports")
    is_solo: _constant(BoolProperty, "Solo", "Disable effects that are not solo")

    shape: _overridable(
        EnumProperty,
        "Shape",
        "Shape of the volume. Drag the handles in the viewport to resize",
        items=SHAPES,
        default="SPHERE",
        update=_redraw_volume,
    )
    size: _overridable(
        FloatVectorProperty,
        "Size",
        "Edge lengths of the box",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        subtype="XYZ_LENGTH",
        unit="LENGTH",
        update=_redraw_volume,
    )
    radius: _length(
        "Radius",
        "Radius of the sphere, cylinder, capsule, or disc on the skin",
        0.5,
        min=0.0,
        update=_redraw_volume,
    )
    height: _length(
        "Height",
        "Height along the local Z axis, including round ends",
        2.0,
        min=0.0,
        update=_redraw_volume,
    )
    falloff: _constant(
        EnumProperty, "Falloff", "Rise of the strength from the boundary inwards", items=FALLOFFS
    )
    falloff_share: _share(
        "Falloff Share",
        "Depth of the rise, as a share of the way from boundary to core",
        1.0,
        options=set(),
    )

    stiffness: _force(
        "Stiffness (N/m)", "Force for each metre of depth in the object. 0: no force", 0.0, 1e4
    )
    damping: _force("Damping (N s/m)", "Force for each m/s of speed into the object", 0.0, 100.0)
    friction: _force("Friction", "Force along the boundary, as a share of the normal force", 0.3, 2)

    surface: PointerProperty(
        name="Surface",
        description="Haptic texture of the object",
        type=surface_properties.HfxSurfaceProperties,
    )

    response: CollectionProperty(
        name="Contact Response",
        description="Response of the volume to a touch: filters in order, from top to bottom",
        type=HfxResponseFilter,
        # Without USE_INSERTION a library override could change filters, but add none.
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    response_active: _steady(IntProperty, "Filter", "Selected filter of the response")
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
    body: _overridable(
        PointerProperty,
        "Body",
        "Body of the painted effect",
        type=bpy.types.Object,
        update=_store_body_name,
    )
    body_name: _overridable(
        StringProperty,
        "Body's Name",
        "Name of the effect's body, also after deletion of the body. Empty: the only "
        "body of the scene",
    )
    model_id: StringProperty(name="Model", description="Painted perceptual model")
    model_hash: StringProperty(name="Model Hash", description="Hash of the painted model's content")
    avatar: _overridable(
        PointerProperty, "Avatar", "Main mesh of this body's avatar", type=bpy.types.Object
    )
    avatar_parts: CollectionProperty(
        name="Parts",
        description="Further meshes of the avatar",
        type=HfxAvatarPart,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    body_models: _overridable(
        StringProperty,
        "Body Models",
        "Ids of the perceptual models of this body, separated by spaces. Empty: the shipped ones",
    )
    follow: _constant(EnumProperty, "Follow", "Source of the pose of this body", items=FOLLOWS)
    felt_layer: _constant(
        EnumProperty, "Felt On", "Layer for haptics if clothes cover skin", items=FELT_LAYERS
    )
    bone_map: CollectionProperty(
        name="Bones",
        description="Bone of the avatar for each joint",
        type=HfxMappedBone,
        override={"LIBRARY_OVERRIDABLE", "USE_INSERTION"},
    )
    fit_kept: _overridable(
        PointerProperty,
        "Fit",
        "Storage of the fit of a library override. None: the armature",
        type=bpy.types.Mesh,
    )
    bone_map_active: _steady(IntProperty, "Row", "Selected row of the bone table")
    bone_map_region: _steady(
        EnumProperty,
        "Show",
        "Part of the bone table to show",
        items=BONE_REGIONS,
        translation_context="HFX",
    )
    bone_map_convention: StringProperty(
        name="Convention", description="Recognised naming convention of the bones"
    )


_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (HfxAvatarPart, HfxMappedBone, HfxResponseFilter, HfxActuatorValue, HfxObjectProperties)
)


def register() -> None:
    # First the types that pointers of the classes below refer to.
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
