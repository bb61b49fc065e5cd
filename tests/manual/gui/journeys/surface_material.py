# SPDX-License-Identifier: GPL-3.0-or-later
"""A plane is felt by the plane's material, and edits of the material are felt too.

Blender draws the material's icon next to the maps, slowly without a graphics card.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.mesh.primitive_plane_add(size=0.1)
    plane = bpy.context.object
    noise = bumpy(plane)
    plane.hfx.surface.resolution = 128
    h.undo_push()
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("KP_7", "KP_Decimal")
    yield 1.0
    with h.context():
        bpy.ops.hfx.add_surface(source="MATERIAL")
    yield 2.0
    settings = plane.hfx.surface
    h.check(settings.intensity_image is not None and not settings.is_faulty, "its maps are made")
    before = pixels_of(settings.intensity_image)
    h.check(before.std() > 0.01, "the material's bumps are on them")
    h.shot("1_maps.png")

    noise.inputs["Scale"].default_value = 60.0
    follows = lambda: settings.is_outdated or changed(settings, before)  # noqa: E731
    yield from h.until(follows, "an edit of the material is noticed", 60)
    yield 2.0
    h.shot("2_edited.png")
    if not changed(settings, before):  # baking took too long for an automatic bake
        yield from h.press_button("HFX_OT_bake_surface")
        yield 1.0
    h.check(changed(settings, before), "and is on the maps")
    h.check(not settings.is_outdated, "which are up to date")
    h.shot("3_maps.png")


def bumpy(plane: bpy.types.Object) -> bpy.types.Node:
    """Give the plane a material with a noise for bumps."""
    material = bpy.data.materials.new("Bumps")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    noise, bump = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeBump")
    noise.inputs["Scale"].default_value = 15.0
    bump.inputs["Distance"].default_value = 0.001  # metres; a new one's was 1 in older Blenders
    links.new(noise.outputs[0], bump.inputs["Height"])
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    plane.data.materials.append(material)
    return noise


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    pixels = np.zeros(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels


def changed(settings: Any, before: np.ndarray) -> bool:
    now = pixels_of(settings.intensity_image)
    return now.shape != before.shape or bool(np.abs(now - before).mean() > 0.01)
