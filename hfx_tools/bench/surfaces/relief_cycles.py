# SPDX-License-Identifier: GPL-3.0-or-later
"""Held-out relief rendered by Cycles and stored as JPEG by Blender: independent light and codec."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np

from hfx_blender.authoring.surfaces import image_values
from hfx_blender.engine.arrays import F64

from ...relief import pictures
from ...relief.families import Relief

_SAMPLES: Final = 24


def photograph(
    rng: np.random.Generator, relief: Relief, slope: float, folder: Path
) -> tuple[F64, F64]:
    """Render a relief with RMS slope ``slope``; 0: a flat print.

    Returns the picture (N, N, 3), sRGB 0..1, and the rendered heights (N, N) in texels. The relief
    is a mesh with a vertex for each texel under a sun and an even sky.
    """
    heights = pictures.scaled(relief.heights, slope)
    colours = pictures.colours_of(rng, relief, is_print=slope == 0.0)
    path = folder / "picture.jpg"
    with _scene() as scene:
        obj = _mesh(scene, heights, colours, float(rng.beta(2.0, 1.3)))
        _light(scene, rng)
        _camera(scene, len(heights), float(np.ptp(heights)))
        scene.render.resolution_x = scene.render.resolution_y = len(heights)
        scene.view_settings.view_transform = str(rng.choice(["Standard", "AgX"]))
        scene.render.image_settings.file_format = "JPEG"
        scene.render.image_settings.quality = int(rng.integers(60, 95))
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        mesh = obj.data
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)
    image = image_values.load(str(path))
    try:
        return image_values.colours_of(image), heights
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _scene() -> Iterator[bpy.types.Scene]:
    scene = bpy.data.scenes.new("Relief")
    scene.render.engine = "CYCLES"
    scene.cycles.samples = _SAMPLES
    scene.cycles.use_denoising = False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    try:
        yield scene
    finally:
        for obj in list(scene.objects):
            bpy.data.objects.remove(obj)
        bpy.data.scenes.remove(scene)


def _mesh(scene: bpy.types.Scene, heights: F64, colours: F64, roughness: float) -> Any:
    n = len(heights)
    y, x = np.indices(heights.shape) + 0.5
    index = np.arange(n * n).reshape(n, n)
    quads = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    mesh = bpy.data.meshes.new("Relief")
    points = np.stack([x, y, heights], -1).reshape(-1, 3)
    mesh.from_pydata(points.tolist(), [], np.stack(quads, -1).reshape(-1, 4).tolist())
    mesh.shade_smooth()
    layer = mesh.color_attributes.new("Colour", "FLOAT_COLOR", "POINT")
    values = np.concatenate([colours, np.ones((n, n, 1))], -1)
    layer.data.foreach_set("color", values.astype(np.float32).ravel())
    material = bpy.data.materials.new("Relief")
    material.use_nodes = True
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "Colour"
    tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = roughness
    mesh.materials.append(material)
    obj = bpy.data.objects.new("Relief", mesh)
    scene.collection.objects.link(obj)
    return obj


def _light(scene: bpy.types.Scene, rng: np.random.Generator) -> None:
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = rng.uniform(1.5, 4.0), np.radians(rng.uniform(0.5, 15.0))
    obj = bpy.data.objects.new("Sun", sun)
    obj.rotation_euler = (np.radians(rng.uniform(15.0, 70.0)), 0.0, rng.uniform(0.0, 2 * np.pi))
    scene.collection.objects.link(obj)
    world = bpy.data.worlds.new("Sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = rng.uniform(0.1, 0.8)
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.8, 0.9, 1.0, 1.0)
    scene.world = world


def _camera(scene: bpy.types.Scene, texels: int, depth: float) -> None:
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", float(texels)
    camera.clip_end = 4.0 * depth + 100.0
    obj = bpy.data.objects.new("Camera", camera)
    obj.location = (texels / 2.0, texels / 2.0, 2.0 * depth + 10.0)
    scene.collection.objects.link(obj)
    scene.camera = obj
