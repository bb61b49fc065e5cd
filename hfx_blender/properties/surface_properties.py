# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface settings of an object (``Object.hfx.surface``), calibration, and material generation."""

import zlib
from collections.abc import Callable

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..blender import events
from ..engine.texture.surface_names import DRIVE_PER_M, FABRICS, MATERIAL_TITLES

SOURCES = (
    ("MATERIAL", "Material", "Displacement, bump, normals and roughness, baked with Cycles"),
    ("IMAGE", "Image", "A height map, or the colours of a photograph"),
    ("SCAN", "Scan", "A point cloud (PLY, XYZ) or a 16-bit picture of a measured piece"),
    ("PROCEDURAL", "Library", "Procedural gravel, metal, fabric or wood"),
    ("MAP", "Map", "Layers of an imported haptic map, unchanged"),
    ("GENERATED", "Generated", "Relief generated from words or a picture, at its own size"),
)
RENDERERS = (
    (
        "MCHA",
        "Micro-Collisions",
        "The strongest texel along the stroke, with the map's own frequency",
    ),
    ("TEXTILE", "Textile Window", "The weighted spectrum of 50 ms, at one frequency"),
    ("DIRECT", "Height Profile", "The height as an audio-rate signal, for wide-band actuators"),
)
IMAGE_KINDS = (
    ("HEIGHT", "Heights", "Black is low and white is high. Raw values, without colour management"),
    ("COLOUR", "Colours", "A photograph. Bright is high, in linear light"),
    ("ESTIMATE", "Estimate", "Height, roughness and slope from the operator Relief from Picture"),
)


def _request_update(self: "HfxSurfaceProperties", _context: bpy.types.Context) -> None:
    from ..authoring.surfaces import surface_updates

    surface_updates.request(self.id_data)


def _setting(kind: Callable[..., object], label: str, tip: str, **options: object) -> object:
    """Property of the type ``kind``, as FloatProperty, whose changes update the maps; not
    animatable, as maps and renderer are the same at all times."""
    return kind(name=label, description=tip, update=_request_update, options=set(), **options)


def _size(label: str, tip: str, default: float) -> object:
    """Width and height in millimetres, equal by default, whose changes update the maps."""
    limits = {"size": 2, "default": (default, default), "min": 1e-3}
    return _setting(FloatVectorProperty, label, tip, **limits)


# Blender stores the number of an enum item. A position in the list would change with each new
# material, so the number is the CRC-32 of the name, without the lowest bit: Blender's are signed.
PROCEDURALS = tuple(
    (name, title, kind.title(), "NONE", zlib.crc32(name.encode()) >> 1)
    for name, (kind, title) in MATERIAL_TITLES.items()
)


class HfxSurfaceProperties(bpy.types.PropertyGroup):
    """Settings of an object's surface, its maps and its renderer. Lengths are in millimetres."""

    source: _setting(EnumProperty, "Source", "Source of the relief", items=SOURCES)
    uv_map: _setting(
        StringProperty, "UV Map", "UV map of the surface. Empty: the map active for rendering"
    )
    resolution: _setting(
        IntProperty,
        "Resolution",
        "Texels along the longer edge of the map",
        default=512,
        min=8,
        max=4096,
    )
    image: _setting(
        PointerProperty, "Image", "Image mapped onto the object by the UV map", type=bpy.types.Image
    )
    image_kind: _setting(
        EnumProperty, "Image Holds", "Meaning of the image's pixels", items=IMAGE_KINDS
    )
    roughness_image: _setting(
        PointerProperty,
        "Roughness",
        "Roughness map. Dark is smooth. Without an image, roughness is 0.5",
        type=bpy.types.Image,
    )
    scan_path: _setting(
        StringProperty,
        "Scan",
        "File of a scanned sample: a point cloud, or a height map",
        subtype="FILE_PATH",
    )
    scan_unit_mm: _setting(
        FloatProperty,
        "Unit (mm)",
        "Millimetres per unit of the scan's coordinates",
        default=1.0,
        min=1e-6,
        max=1e6,
    )
    scan_size_mm: _size("Size (mm)", "Width and height of a scanned height map", 50.0)
    procedural: _setting(
        EnumProperty,
        "Material",
        "Material of the library",
        items=PROCEDURALS,
        default="gravel-fine",
    )
    seed: _setting(IntProperty, "Variant", "Random seed of the sample", min=0)
    height_mm: _setting(
        FloatProperty,
        "Height (mm)",
        "Height of white above black, for images and for materials without relief. "
        "Negative values invert the relief",
        default=0.2,
        soft_min=-5.0,
        soft_max=5.0,
    )
    use_own_scale: _setting(
        BoolProperty, "Own Scale", "Enter the size of a UV unit instead of measuring the object"
    )
    uv_mm: _size("UV Unit (mm)", "Width and height of one UV unit on the object", 100.0)

    blur_mm: _setting(
        FloatProperty,
        "Blur (mm)",
        "Standard deviation of the Gaussian blur before the slopes",
        default=0.1,
        min=0.0,
        soft_max=2.0,
        precision=3,
    )
    full_slope: _setting(
        FloatProperty,
        "Full Slope",
        "Slope of full strength. One value for all materials keeps gravel stronger than metal",
        default=1.0,
        min=1e-4,
        soft_max=4.0,
        precision=3,
    )
    lowest_hz: _setting(
        FloatProperty,
        "Lowest (Hz)",
        "Vibration frequency of the roughest texels",
        default=80.0,
        min=1.0,
        max=1000.0,
    )
    highest_hz: _setting(
        FloatProperty,
        "Highest (Hz)",
        "Vibration frequency of the smoothest texels",
        default=260.0,
        min=1.0,
        max=1000.0,
    )
    use_steps: _setting(
        BoolProperty, "Noticeable Steps", "Round to just noticeable differences, 0.2 g and 40 Hz"
    )
    renderer: EnumProperty(
        name="Renderer",
        description="Method of rendering the relief as vibration",
        items=RENDERERS,
        options=set(),
    )
    drive: FloatProperty(
        name="Drive (1/mm)",
        description="c_v of the textile paper: share of full strength per mm of weighted height. "
        "0: the calibrated value",
        min=0.0,
        soft_max=100.0,
        options=set(),
    )
    sound: PointerProperty(
        name="Friction Sound",
        description="Sound during strokes, for surfaces too smooth to feel",
        type=bpy.types.Sound,
    )

    relief_image: PointerProperty(description="Generated heights", type=bpy.types.Image)
    intensity_image: PointerProperty(description="Generated map of intensity", type=bpy.types.Image)
    sharpness_image: PointerProperty(description="Generated map of sharpness", type=bpy.types.Image)
    made_size_mm: FloatVectorProperty(size=2, options={"HIDDEN"})
    made_tiles: BoolProperty(options={"HIDDEN"})
    made_slope: BoolProperty(
        options={"HIDDEN"}, description="The image of the relief contains slopes"
    )
    made_of: StringProperty(options={"HIDDEN"}, description="Settings of the generated relief")
    layers_of: StringProperty(options={"HIDDEN"}, description="Settings of the generated layers")
    note: StringProperty(options={"HIDDEN"}, description="Result of the last update")
    is_faulty: BoolProperty(options={"HIDDEN"})
    warning: StringProperty(options={"HIDDEN"}, description="Warning about the maps")
    material_state: StringProperty(
        options={"HIDDEN"}, description="State of the material at the time of baking"
    )
    is_outdated: BoolProperty(
        options={"HIDDEN"}, description="The material was edited after baking"
    )


def _store_drive(self: "HfxSurfaceCalibration", _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

    surface_calibration.store(self.drive * 1000.0, self.device)
    if not self.device:
        events.announce("live forget")  # updates the description of all surfaces


def _load_drive(self: "HfxSurfaceCalibration", _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

    # As an ID property: an assignment would call the update, which stores the value again.
    self["drive"] = surface_calibration.drive_per_m(self.device) / 1000.0


class HfxSurfaceCalibration(bpy.types.PropertyGroup):
    """Settings of the calibration. The result is stored in the user's data."""

    device: StringProperty(
        name="Device",
        description="Device to calibrate. Empty: all devices without a calibration",
        update=_load_drive,
    )
    fabric: EnumProperty(
        name="Fabric",
        description="Test fabric. All three should feel neither too weak nor too strong",
        items=[(name, name.title(), "") for name in FABRICS],
    )
    speed: EnumProperty(
        name="Speed", items=(("SLOW", "2 cm/s", "Slow"), ("FAST", "10 cm/s", "Fast"))
    )
    drive: FloatProperty(
        name="Strength",
        description="c_v: share of full strength per millimetre of weighted height",
        default=DRIVE_PER_M / 1000.0,
        min=0.1,
        soft_max=100.0,
        update=_store_drive,
    )


class HfxGenerationProperties(bpy.types.PropertyGroup):
    """Settings of *Material from Words or Picture*, not stored in the .blend."""

    source: EnumProperty(
        name="From",
        description="Source of the material",
        items=(
            ("WORDS", "Words", "Search the library for the closest material, and modify it"),
            ("PICTURE", "Picture", "Estimate the relief of a picture of a material"),
        ),
    )
    words: StringProperty(
        name="Words",
        description="The material: kind, colour, coarser, deeper, worn, woven as, diagonal",
        default="coarse grey gravel, wet",
    )
    negative: StringProperty(
        name="Not", description="Properties to avoid", translation_context="HFX"
    )
    seed: IntProperty(name="Seed", description="Random seed of the first variation", min=0)
    variations: IntProperty(
        name="Variations",
        description="Number of variations, with this seed and the next ones",
        default=4,
        min=1,
        max=8,
    )
    resolution: IntProperty(
        name="Resolution", description="Texels along an edge", default=512, min=64, max=2048
    )
    use_steps: BoolProperty(
        name="Noticeable Steps", description="Round the map to steps of 0.2 g and 40 Hz"
    )
    picture: StringProperty(
        name="Picture", description="File of a picture of a material", subtype="FILE_PATH"
    )
    size_mm: FloatVectorProperty(
        name="Size (mm)",
        description="Width and height of the pictured material",
        size=2,
        default=(100.0, 100.0),
        min=1e-3,
    )
    height_mm: FloatProperty(
        name="Height (mm)",
        description="Height of white above black, if brightness is height",
        default=0.2,
        min=0.0,
    )
    tiles: BoolProperty(name="Tiles", description="Opposite edges of the picture match")


_register, _unregister = bpy.utils.register_classes_factory(
    (HfxSurfaceProperties, HfxSurfaceCalibration, HfxGenerationProperties)
)


def register() -> None:
    _register()
    bpy.types.WindowManager.hfx_surface_calibration = PointerProperty(type=HfxSurfaceCalibration)
    bpy.types.WindowManager.hfx_generation = PointerProperty(type=HfxGenerationProperties)


def unregister() -> None:
    del bpy.types.WindowManager.hfx_generation
    del bpy.types.WindowManager.hfx_surface_calibration
    _unregister()
