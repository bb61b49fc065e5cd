# SPDX-License-Identifier: GPL-3.0-or-later
"""``WindowManager.hfx_generation``: settings of the panel *Material from Words or Picture*."""

from __future__ import annotations

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


class HfxGenerationProperties(bpy.types.PropertyGroup):
    """A wish, or a picture, and how many surfaces are made of it; not stored in the .blend."""

    source: EnumProperty(
        name="From",
        description="What the material is made from",
        items=(
            ("WORDS", "Words", "Search the library for what is nearest, and steer it"),
            ("PICTURE", "Picture", "Estimate the relief of any picture of a material"),
        ),
    )
    words: StringProperty(
        name="Words",
        description="The material: kind, colour, coarser, deeper, worn, woven as, diagonal",
        default="coarse grey gravel, wet",
    )
    negative: StringProperty(name="Not", description="What it shall not be")
    seed: IntProperty(name="Seed", description="Another sample of the same wish", min=0)
    variations: IntProperty(
        name="Variations",
        description="Made with this seed and the next ones",
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
        description="Width and height of what the picture shows",
        size=2,
        default=(100.0, 100.0),
        min=1e-3,
    )
    height_mm: FloatProperty(
        name="Height (mm)",
        description="White over black, where brightness is taken as height",
        default=0.2,
        min=0.0,
    )
    tiles: BoolProperty(name="Tiles", description="Opposite edges of the picture match")


_register, _unregister = bpy.utils.register_classes_factory((HfxGenerationProperties,))


def register() -> None:
    _register()
    bpy.types.WindowManager.hfx_generation = PointerProperty(type=HfxGenerationProperties)


def unregister() -> None:
    del bpy.types.WindowManager.hfx_generation
    _unregister()
