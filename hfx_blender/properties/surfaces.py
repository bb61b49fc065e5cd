# SPDX-License-Identifier: GPL-3.0-or-later
"""``Object.hfx.surface``: settings of an object that is felt by moving over it."""

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
    ("MATERIAL", "Material", "Displacement, bump, normals and roughness, baked by Cycles"),
    ("IMAGE", "Image", "A height map, or the colours of a photograph"),
    ("SCAN", "Scan", "A point cloud (PLY, XYZ) or a 16-bit picture of a measured piece"),
    ("PROCEDURAL", "Library", "Procedural gravel, metal, fabric or wood"),
    ("MAP", "Map", "Layers of an imported haptic map, unchanged"),
    ("GENERATED", "Generated", "Relief made from words or a picture, at its own size"),
)
RENDERERS = (
    (
        "MCHA",
        "Micro-Collisions",
        "The strongest texel along the stroke, with the map's own frequency",
    ),
    ("TEXTILE", "Textile Window", "The weighted spectrum of 50 ms, at one frequency"),
    ("DIRECT", "Height Profile", "The height itself at audio rate, for wide-band actuators"),
)
IMAGE_KINDS = (
    ("HEIGHT", "Heights", "Black is low and white is high; read as numbers, not as colours"),
    ("COLOUR", "Colours", "A photograph: bright means high, in linear light"),
    (
        "ESTIMATE",
        "Estimate",
        "Height, roughness and slope of a photograph, as Relief from Picture made them",
    ),
)


def _remake(self: HfxSurfaceProperties, _context: bpy.types.Context) -> None:
    from ..authoring.surfaces import surface_updates

    surface_updates.request(self.id_data)


def _numbered(name: str) -> int:
    """Stable number of a material's name for a .blend: it must not change when others are added."""
    return zlib.crc32(name.encode()) >> 1


PROCEDURALS = tuple(
    (name, title, kind.title(), "NONE", _numbered(name))
    for name, (kind, title) in MATERIAL_TITLES.items()
)


class HfxSurfaceProperties(bpy.types.PropertyGroup):
    """Settings of an object's surface, its maps and its rendering. Lengths are in mm, as
    labelled.
    """

    source: EnumProperty(
        name="Source", description="Source of the relief", items=SOURCES, update=_remake
    )
    uv_map: StringProperty(
        name="UV Map", description="Empty: the one that is active for rendering", update=_remake
    )
    resolution: IntProperty(
        name="Resolution",
        description="Texels along the longer edge of the map",
        default=512,
        min=8,
        max=4096,
        update=_remake,
    )
    image: PointerProperty(
        name="Image",
        description="Image that the UV map puts on the object",
        type=bpy.types.Image,
        update=_remake,
    )
    image_kind: EnumProperty(
        name="Image Holds",
        description="Meaning of the image's pixels",
        items=IMAGE_KINDS,
        update=_remake,
    )
    roughness_image: PointerProperty(
        name="Roughness",
        description="Dark is smooth; without an image, roughness is 0.5",
        type=bpy.types.Image,
        update=_remake,
    )
    scan_path: StringProperty(
        name="Scan",
        description="File of a scanned piece: points, or a picture of heights",
        subtype="FILE_PATH",
        update=_remake,
    )
    scan_unit_mm: FloatProperty(
        name="Unit (mm)",
        description="Millimetres of one unit of the scan's coordinates",
        default=1.0,
        min=1e-6,
        max=1e6,
        update=_remake,
    )
    scan_size_mm: FloatVectorProperty(
        name="Size (mm)",
        description="Width and height of the measured piece; for a picture",
        size=2,
        default=(50.0, 50.0),
        min=1e-3,
        update=_remake,
    )
    procedural: EnumProperty(
        name="Material",
        description="One of the library's materials",
        items=PROCEDURALS,
        default="gravel-fine",
        update=_remake,
    )
    seed: IntProperty(
        name="Variant",
        description="Seed: another sample of the same material",
        default=0,
        min=0,
        update=_remake,
    )
    height_mm: FloatProperty(
        name="Height (mm)",
        description="Of white over black: for images, and for colours where a material has no "
        "relief. Negative turns it inside out",
        default=0.2,
        soft_min=-5.0,
        soft_max=5.0,
        update=_remake,
    )
    use_own_scale: BoolProperty(
        name="Own Scale",
        description="State the size of a UV unit instead of measuring it on the object",
        default=False,
        update=_remake,
    )
    uv_mm: FloatVectorProperty(
        name="UV Unit (mm)",
        description="Width and height of one UV unit on the object",
        size=2,
        default=(100.0, 100.0),
        min=1e-3,
        update=_remake,
    )

    blur_mm: FloatProperty(
        name="Blur (mm)",
        description="Standard deviation of the Gaussian blur before slopes are taken",
        default=0.1,
        min=0.0,
        soft_max=2.0,
        precision=3,
        update=_remake,
    )
    full_slope: FloatProperty(
        name="Full Slope",
        description="Slope that is felt at full strength; the same for all materials, so that "
        "gravel stays stronger than metal",
        default=1.0,
        min=1e-4,
        soft_max=4.0,
        precision=3,
        update=_remake,
    )
    lowest_hz: FloatProperty(
        name="Lowest (Hz)",
        description="The device's frequency for the roughest texels",
        default=80.0,
        min=1.0,
        max=1000.0,
        update=_remake,
    )
    highest_hz: FloatProperty(
        name="Highest (Hz)",
        description="The device's frequency for the smoothest texels",
        default=260.0,
        min=1.0,
        max=1000.0,
        update=_remake,
    )
    use_steps: BoolProperty(
        name="Noticeable Steps",
        description="Round to just noticeable differences: 0.2 g and 40 Hz",
        default=False,
        update=_remake,
    )
    renderer: EnumProperty(
        name="Renderer", description="Method that makes vibration from the relief", items=RENDERERS
    )
    drive: FloatProperty(
        name="Drive (1/mm)",
        description="c_v of the textile paper: share of full strength per mm of weighted height; "
        "0: as you calibrated it",
        default=0.0,
        min=0.0,
        soft_max=100.0,
    )
    sound: PointerProperty(
        name="Friction Sound",
        description="Played during strokes: for surfaces that are too smooth to feel",
        type=bpy.types.Sound,
    )

    relief_image: PointerProperty(description="The heights that were made", type=bpy.types.Image)
    intensity_image: PointerProperty(
        description="How strongly each place is felt, as it was made", type=bpy.types.Image
    )
    sharpness_image: PointerProperty(
        description="How fine each place is, as it was made", type=bpy.types.Image
    )
    made_size_mm: FloatVectorProperty(size=2, options={"HIDDEN"})
    made_tiles: BoolProperty(options={"HIDDEN"})
    made_slope: BoolProperty(
        options={"HIDDEN"}, description="Whether the relief's image holds slopes, too"
    )
    made_of: StringProperty(options={"HIDDEN"}, description="Settings that the relief is made of")
    layers_of: StringProperty(options={"HIDDEN"}, description="Settings of the layers")
    note: StringProperty(options={"HIDDEN"}, description="What was done, or why it could not be")
    is_faulty: BoolProperty(options={"HIDDEN"})
    warning: StringProperty(options={"HIDDEN"}, description="What is wrong with the maps, if any")
    material_state: StringProperty(
        options={"HIDDEN"}, description="State of the material that the relief is made of"
    )
    is_outdated: BoolProperty(
        options={"HIDDEN"}, description="Whether the material was edited since the maps were made"
    )


def _keep_drive(self: HfxSurfaceCalibration, _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

    surface_calibration.store(self.drive * 1000.0, self.device)
    if not self.device:
        events.announce("live forget")  # surfaces are described anew, with it


def _show_drive(self: HfxSurfaceCalibration, _context: bpy.types.Context) -> None:
    from ..devices.configurations import surface_calibration

    self["drive"] = surface_calibration.drive_per_m(self.device) / 1000.0


class HfxSurfaceCalibration(bpy.types.PropertyGroup):
    """Slider of the calibration; its result is stored in the user's data."""

    device: StringProperty(
        name="Device",
        description="Empty: for devices without their own calibration",
        update=_show_drive,
    )
    fabric: EnumProperty(
        name="Fabric",
        description="Smooth, medium, rough: all three should feel right, none too weak or too "
        "strong",
        items=[(name, name.title(), "") for name in FABRICS],
    )
    speed: EnumProperty(
        name="Speed", items=(("SLOW", "2 cm/s", "Slow"), ("FAST", "10 cm/s", "Fast"))
    )
    drive: FloatProperty(
        name="Strength",
        description="c_v: share of full strength for a millimetre of weighted height",
        default=DRIVE_PER_M / 1000.0,
        min=0.1,
        soft_max=100.0,
        update=_keep_drive,
    )


_register, _unregister = bpy.utils.register_classes_factory(
    (HfxSurfaceProperties, HfxSurfaceCalibration)
)


def register() -> None:
    _register()
    bpy.types.WindowManager.hfx_surface_calibration = PointerProperty(type=HfxSurfaceCalibration)


def unregister() -> None:
    del bpy.types.WindowManager.hfx_surface_calibration
    _unregister()
