# SPDX-License-Identifier: GPL-3.0-or-later
"""Generated surfaces as .blend files."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from hfx_blender.authoring.surfaces import generated_surfaces
from hfx_blender.errors import OutputError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.generation import generated

from ..command_process.temporary_folder import temporary_folder
from ..demo.scene_file import forget_folders


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
    generated_surfaces.apply_generated(swatch, record).asset_mark()
    path = record.with_name(record.name.removesuffix(generated.RECORD) + ".blend")
    # Blender writes to a temporary folder; the result is moved into place when complete.
    with temporary_folder() as folder:
        saved = os.path.join(folder, path.name)
        forget_folders()
        try:
            bpy.ops.wm.save_as_mainfile(filepath=saved, compress=True, copy=True)
        except RuntimeError as error:
            raise OutputError(f"{path}: Blender cannot save it ({error}).") from error
        with atomic_file(path) as file:
            file.write(Path(saved).read_bytes())
    return path
