# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface settings of an object (``Object.hfx.surface``), calibration, and material generation."""

from __future__ import annotations

import zlib

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


def _request_update(self: HfxSurfaceProperties, _context: bpy.types.Context) -> None:
    from ..authoring.surfaces import surface_updates

    surface_updates.request(self.id_data)


def _enum_value(name: str) -> int:
    """Enum number of a material: CRC-32 of its name without the lowest bit."""
    # Blender stores enum numbers: a position in the list would change with new materials.
    return zlib.crc32(name.encode()) >> 1


PROCEDURALS = tuple(
    (name, title, kind.title(), "NONE", _enum_value(name))
    for name, (kind, title) in MATERIAL_TITLES.items()
)


class HfxSurfaceProperties(bpy.types.PropertyGroup):
    """Settings of an object's surface, its maps and its renderer. Lengths are in millimetres."""

    source: EnumProperty(
        name="Source", description="Source of the relief", items=SOURCES, update=_request_update
    )
    uv_map: StringProperty(
        name="UV Map",
        description="UV map of the surface. Empty: the map active for rendering",
        update=_request_update,
    )
    resolution: IntProperty(
        name="Resolution",
        description="Texels along the longer edge of the map",
        default=512,
        min=8,
        max=4096,
        update=_request_update,
    )
    image: PointerProperty(
        name="Image",
        description="Image mapped onto the object by the UV map",
        type=bpy.types.Image,
        update=_request_update,
    )
    image_kind: EnumProperty(
        name="Image Holds",
        description="Meaning of the image's pixels",
        items=IMAGE_KINDS,
        update=_request_update,
    )
    roughness_image: PointerProperty(
        name="Roughness",
        description="Roughness map. Dark is smooth. Without an image, roughness is 0.5",
        type=bpy.types.Image,
        update=_request_update,
    )
    scan_path: StringProperty(
        name="Scan",
        description="File of a scanned sample: a point cloud, or a height map",
        subtype="FILE_PATH",
        update=_request_update,
    )
    scan_unit_mm: FloatProperty(
        name="Unit (mm)",
        description="Millimetres per unit of the scan's coordinates",
        default=1.0,
        min=1e-6,
        max=1e6,
        update=_request_update,
    )
    scan_size_mm: FloatVectorProperty(
        name="Size (mm)",
        description="Width and height of a scanned height map",
        size=2,
        default=(50.0, 50.0),
        min=1e-3,
        update=_request_update,
    )
    procedural: EnumProperty(
        name="Material",
        description="Material of the library",
        items=PROCEDURALS,
        default="gravel-fine",
        update=_request_update,
    )
    seed: IntProperty(
        name="Variant",
        description="Random seed of the sample",
        default=0,
        min=0,
        update=_request_update,
    )
    height_mm: FloatProperty(
        name="Height (mm)",
        description="Height of white above black, for images and for materials without relief. "
        "Negative values invert the relief",
        default=0.2,
        soft_min=-5.0,
        soft_max=5.0,
        update=_request_update,
    )
    use_own_scale: BoolProperty(
        name="Own Scale",
        description="Enter the size of a UV unit instead of measuring the object",
        default=False,
        update=_request_update,
    )
    uv_mm: FloatVectorProperty(
        name="UV Unit (mm)",
        description="Width and height of one UV unit on the object",
        size=2,
        default=(100.0, 100.0),
        min=1e-3,
        update=_request_update,
    )

    blur_mm: FloatProperty(
        name="Blur (mm)",
        description="Standard deviation of the Gaussian blur before the slopes",
        default=0.1,
        min=0.0,
        soft_max=2.0,
        precision=3,
        update=_request_update,
    )
    full_slope: FloatProperty(
        name="Full Slope",
        description="Slope of full strength. One value for all materials keeps gravel stronger "
        "than metal",
        default=1.0,
        min=1e-4,
        soft_max=4.0,
        precision=3,
        update=_request_update,
    )
    lowest_hz: FloatProperty(
        name="Lowest (Hz)",
        description="Vibration frequency of the roughest texels",
        default=80.0,
        min=1.0,
        max=1000.0,
        update=_request_update,
    )
    highest_hz: FloatProperty(
        name="Highest (Hz)",
        description="Vibration frequency of the smoothest texels",
        default=260.0,
        min=1.0,
        max=1000.0,
        update=_request_update,
    )
    use_steps: BoolProperty(
        name="Noticeable Steps",
        description="Round to just noticeable differences, 0.2 g and 40 Hz",
        default=False,
        update=_request_update,
    )
    renderer: EnumProperty(
        name="Renderer", description="Method of rendering the relief as vibration", items=RENDERERS
    )
    drive: FloatProperty(
        name="Drive (1/mm)",
        description="c_v of the textile paper: share of full strength per mm of weighted height. "
        "0: the calibrated value",
        default=0.0,
        min=0.0,
        soft_max=100.0,
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


def _store_drive(self: HfxSurfaceCalibration, _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

    surface_calibration.store(self.drive * 1000.0, self.device)
    if not self.device:
        events.announce("live forget")  # updates the description of all surfaces


def _load_drive(self: HfxSurfaceCalibration, _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

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
    negative: StringProperty(name="Not", description="Properties to avoid")
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
