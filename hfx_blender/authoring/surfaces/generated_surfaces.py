# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces made by helper processes: generated materials, and reliefs estimated from a picture.

An estimated relief is stored as an image in the .blend, which is the source of the surface.
"""

import os
import tempfile
from pathlib import Path

import bpy
import numpy as np

from ...blender.scene_info import metres_of
from ...engine.texture.height_field import HeightField
from ...engine.texture.relief.relief_estimate import EstimatedRelief
from ...errors import InputError, OutputError
from ...generation import generated
from ...generation.generated import GeneratedFiles
from ...processes.messages import decode_json
from ...processes.worker import Worker
from . import image_values, surface_sources, surfaces

_TITLE = 60  # bytes of a datablock's name


def apply_generated(obj: bpy.types.Object, record: Path) -> bpy.types.Material:
    """Give an object a generated material and haptic surface at their real size.

    An existing surface, and the material of the active slot, are replaced.

    Raises InputError: the object is no mesh of this file, or a file of the record is missing or
    damaged.
    """
    files = generated.read(record)
    if not surfaces.is_surface(obj):
        surfaces.add_surface(obj, "GENERATED")
    obj.hfx.surface.use_steps = files.map.steps is not None
    surfaces.store_generated(obj, files.relief)
    material = _material(files, obj)
    obj.active_material = material  # in the active slot; a new slot if there is none
    return material


def _material(files: GeneratedFiles, obj: bpy.types.Object) -> bpy.types.Material:
    """New material with the packed images as colour, roughness and displacement in real size; box
    projection without a UV map. The record is stored as a custom property."""
    name = (files.words or files.name)[:_TITLE]
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before 5.0 a material can be without nodes
        material.use_nodes = True
    tree = material.node_tree
    nodes, links = tree.nodes, tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    shader.inputs["Metallic"].default_value = float(files.is_metal)
    placing = _tile_coordinates(files, obj, tree)
    sockets = {}
    for row, part in enumerate(("colour", "roughness", "height")):
        image = image_values.load(os.path.abspath(files.path.with_name(f"{files.name}.{part}.png")))
        if part != "colour":
            image.colorspace_settings.is_data = True
            image.reload()  # applies the new colour space to the loaded pixels
        # Packed, so that the .blend needs no further file.
        image.pack()
        node = nodes.new("ShaderNodeTexImage")
        node.image, node.label = image, part.title()
        node.location = (-600.0, 300.0 - 300.0 * row)
        node.extension = "REPEAT" if files.relief.height.tiles else "EXTEND"
        if not obj.data.uv_layers:
            node.projection = "BOX"
        links.new(placing, node.inputs["Vector"])
        sockets[part] = node.outputs["Color"]
    links.new(sockets["colour"], shader.inputs["Base Color"])
    links.new(sockets["roughness"], shader.inputs["Roughness"])
    relief = nodes.new("ShaderNodeDisplacement")
    relief.location = (-200.0, -300.0)
    # The height picture spans 0 to 1, from the lowest to the highest point.
    relief.inputs["Midlevel"].default_value = 0.0
    unit = metres_of(bpy.context.scene)
    depth = float(files.relief.height.heights_m.max() - files.relief.height.heights_m.min())
    relief.inputs["Scale"].default_value = depth / unit
    links.new(sockets["height"], relief.inputs["Height"])
    links.new(relief.outputs["Displacement"], output.inputs["Displacement"])
    material["hfx_generated"] = files.path.read_text(encoding="utf-8")
    return material


def _tile_coordinates(
    files: GeneratedFiles, obj: bpy.types.Object, tree: bpy.types.NodeTree
) -> bpy.types.NodeSocket:
    """Socket of texture coordinates, 1 per generated tile, from nodes added to ``tree``: UV map
    scaled by its size, or object coordinates without one."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    coordinates.location, mapping.location = (-1000.0, 0.0), (-800.0, 0.0)
    size_mm = [1000.0 * length for length in files.relief.height.size_m]
    # Tiles per unit of the coordinates, so that a tile has its real size on the object.
    if obj.data.uv_layers:
        source = coordinates.outputs["UV"]
        unit_mm = [*surface_sources.tile_mm(obj), 1000.0]
    else:
        source = coordinates.outputs["Object"]
        metres = metres_of(bpy.context.scene)
        unit_mm = [1000.0 * metres * abs(scale) for scale in obj.matrix_world.to_scale()]
    tiles = [unit / size for unit, size in zip(unit_mm, [*size_mm, size_mm[0]], strict=True)]
    mapping.inputs["Scale"].default_value = tiles
    tree.links.new(source, mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


class ReliefEstimation:
    """Estimation in a helper process, started at once. ``size_mm`` is width and height of the
    pictured material; ``tiles`` if opposite edges match. Raises InputError: the picture cannot be
    read. Raises OutputError: the temporary folder is not writable."""

    def __init__(self, picture: bpy.types.Image, size_mm: tuple[float, float], tiles: bool) -> None:
        colours = image_values.colours_of(picture).astype(np.float32)
        self.name, self.size_mm, self.tiles = picture.name, size_mm, tiles
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="hfx-relief-")
            source, self._target = (Path(self._folder.name) / f"{n}.npz" for n in ("in", "out"))
            np.savez(source, srgb=colours, size_m=np.divide(size_mm, 1000.0), tiles=tiles)
        except OSError as error:
            raise OutputError(f"The temporary folder cannot be written to ({error}).") from error
        self._worker = Worker(
            "engine.texture.relief.relief_estimate", source, self._target, keeps_errors=True
        )
        self._worker.start()

    @property
    def is_running(self) -> bool:
        """Test for a process that has not ended yet."""
        return self._worker.is_running

    def result(self) -> EstimatedRelief:
        """Estimated relief; waits for the process and removes its files, so call once. InputError
        if the estimation failed."""
        try:
            # A refusal is a message of the worker; an exit code is a crash.
            refusal = self._worker.receive()
            if refusal is not None or self._worker.wait():
                reason = (
                    f"its process {self._worker.how_it_ended()}"
                    if refusal is None
                    else decode_json(refusal.body)["error"]
                )
                raise InputError(f"The relief of '{self.name}' was not estimated: {reason}")
            with np.load(self._target) as file:
                heights, slope, roughness = (
                    file[name] for name in ("heights_m", "slope", "roughness")
                )
        finally:
            self._folder.cleanup()
        rows, columns = heights.shape
        texel = self.size_mm[0] / 1000.0 / columns, self.size_mm[1] / 1000.0 / rows
        return EstimatedRelief(HeightField(heights, texel, self.tiles), slope, roughness)

    def stop(self) -> None:
        """Kill the process, wait until it has ended, and remove its files; no result remains."""
        self._worker.close(0.0)
        self._folder.cleanup()


def apply_estimate(obj: bpy.types.Object, estimation: ReliefEstimation) -> str:
    """Store an estimate as an object's surface, and make the maps; return notes. Raises InputError:
    the estimation failed, or the object cannot have a surface."""
    estimate = estimation.result()
    if not surfaces.is_surface(obj):
        surfaces.add_surface(obj, "IMAGE")
    settings = obj.hfx.surface
    height_mm = 1000.0 * float(estimate.field.heights_m.max())
    image = image_values.store(
        f"{estimation.name} Estimate", None, surface_sources.estimate_channels(estimate)
    )
    # The estimate knows its size, so the scale is entered rather than measured.
    settings.source, settings.image_kind, settings.image = "IMAGE", "ESTIMATE", image
    settings.roughness_image = None
    settings.height_mm = height_mm
    settings.use_own_scale, settings.uv_mm = True, estimation.size_mm
    surfaces.make_maps(obj)
    return f"The relief of '{estimation.name}' is an estimate, {height_mm:.3g} mm high"
