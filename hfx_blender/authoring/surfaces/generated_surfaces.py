# SPDX-License-Identifier: GPL-3.0-or-later
"""Generated surfaces in Blender: material, haptic surface, and a .blend with both."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ...blender.scene_info import metres_of
from ...errors import OutputError
from ...files.atomic import atomic_file
from ...files.staging import temporary_folder
from ...generation import generated
from ...generation.generated import GeneratedFiles
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
    surfaces.store_generated(obj, _relief(files))
    material = _material(files, obj)
    obj.active_material = material  # in the active slot; a new slot if there is none
    return material


def _relief(files: GeneratedFiles) -> surface_sources.SurfaceRelief:
    return surface_sources.SurfaceRelief(
        files.height, files.roughness, notes=files.notes, slope=files.slope
    )


def _material(files: GeneratedFiles, obj: bpy.types.Object) -> bpy.types.Material:
    """New material with the packed images as colour, roughness and displacement in real size; box
    projection without a UV map. The record is stored as a custom property.
    """
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
        image.pack()
        node = nodes.new("ShaderNodeTexImage")
        node.image, node.label = image, part.title()
        node.location = (-600.0, 300.0 - 300.0 * row)
        node.extension = "REPEAT" if files.height.tiles else "EXTEND"
        if not obj.data.uv_layers:
            node.projection = "BOX"
        links.new(placing, node.inputs["Vector"])
        sockets[part] = node.outputs["Color"]
    links.new(sockets["colour"], shader.inputs["Base Color"])
    links.new(sockets["roughness"], shader.inputs["Roughness"])
    relief = nodes.new("ShaderNodeDisplacement")
    relief.location = (-200.0, -300.0)
    relief.inputs["Midlevel"].default_value = 0.0
    unit = metres_of(bpy.context.scene)
    depth = float(files.height.heights_m.max() - files.height.heights_m.min())
    relief.inputs["Scale"].default_value = depth / unit
    links.new(sockets["height"], relief.inputs["Height"])
    links.new(relief.outputs["Displacement"], output.inputs["Displacement"])
    material["hfx_generated"] = files.path.read_text(encoding="utf-8")
    return material


def _tile_coordinates(
    files: GeneratedFiles, obj: bpy.types.Object, tree: bpy.types.NodeTree
) -> bpy.types.NodeSocket:
    """Socket of texture coordinates, 1 per generated tile, from nodes added to ``tree``: UV map
    scaled by its size, or object coordinates without one.
    """
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    coordinates.location, mapping.location = (-1000.0, 0.0), (-800.0, 0.0)
    size_mm = [1000.0 * length for length in files.height.size_m]
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


def write_blend(record: Path) -> Path:
    """Write a .blend next to a record: a 20 cm swatch of material and surface. Return the path.

    The open file is replaced by a new file.

    Raises InputError: a file of the record is missing or damaged. Raises OutputError: the .blend
    cannot be written.
    """
    bpy.ops.wm.read_homefile(use_empty=True)
    mesh = bpy.data.meshes.new("Swatch")
    corners = [(x, y, 0.0) for x, y in ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.uv.foreach_set("vector", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    swatch = bpy.data.objects.new("Swatch", mesh)
    bpy.context.scene.collection.objects.link(swatch)
    bpy.context.view_layer.update()
    apply_generated(swatch, record).asset_mark()
    path = record.with_name(record.name.removesuffix(generated.RECORD) + ".blend")
    # Blender writes to a temporary folder; the result is moved into place when complete.
    with temporary_folder() as folder:
        saved = os.path.join(folder, path.name)
        try:
            bpy.ops.wm.save_as_mainfile(filepath=saved, compress=True, copy=True)
        except RuntimeError as error:
            raise OutputError(f"{path}: Blender cannot save it ({error}).") from error
        with atomic_file(path) as file:
            file.write(Path(saved).read_bytes())
    return path
