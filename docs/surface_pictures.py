# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the example board of haptic surfaces: ``python docs/surface_pictures.py``.

The picture shows the board of ``hfx texture board``, rendered by Cycles.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

PICTURE = Path(__file__).resolve().parent / "pictures" / "surface_board.png"
SIZE = (720, 450)
SAMPLES = 8


def main() -> None:
    from hfx_blender.processes import blender_session

    bpy = blender_session.start()
    from hfx_tools.demo import board

    bpy.ops.wm.read_homefile(use_empty=True)
    board.build(bpy.context)
    scene = bpy.context.scene
    scene.frame_set(round(0.55 * scene.frame_end))
    middle = bpy.data.objects["Board"].matrix_world.translation.copy()
    _camera(bpy, middle)
    _light(bpy, middle)
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", SAMPLES
    scene.cycles.use_denoising = True
    render.resolution_x, render.resolution_y = SIZE
    render.image_settings.file_format = "PNG"
    render.filepath = str(PICTURE)
    bpy.ops.render.render(write_still=True)
    sys.stdout.write(f"wrote {PICTURE}\n")


def _camera(bpy: Any, middle: Any) -> None:
    from mathutils import Vector

    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = middle + Vector((0.16, -0.3, 0.3))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens = 50.0
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def _light(bpy: Any, middle: Any) -> None:
    from mathutils import Vector

    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.energy, lamp.size = 6.0, 0.2
    lamp_object = bpy.data.objects.new("Lamp", lamp)
    lamp_object.location = middle + Vector((-0.5, 0.2, 0.35))  # low: the relief throws shadows
    lamp_object.rotation_euler = (middle - lamp_object.location).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(lamp_object)
    world = bpy.data.worlds.new("World")
    world.color = (0.06, 0.06, 0.07)
    bpy.context.scene.world = world


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
