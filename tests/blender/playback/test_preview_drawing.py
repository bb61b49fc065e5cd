# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview drawn off screen by the graphics card, compared pixel by pixel.

Runs in a separate process, as Blender ends the process if there is no graphics driver.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.colouring import COLOURS
from hfx_blender.playback.preview import card_shaders

SIZE = 400
OPACITY = 0.8

SCRIPT = f"""
import json, os, sys
from hfx_blender.processes import blender_session
bpy = blender_session.start()
import gpu
import numpy as np
from mathutils import Matrix
from hfx_blender.playback.preview.preview import preview

bpy.ops.wm.read_homefile(use_empty=True)
if hasattr(gpu, "init"):
    gpu.init()
else:  # a picture starts it, too
    render = bpy.context.scene.render
    render.engine, render.resolution_x, render.resolution_y = "BLENDER_WORKBENCH", 8, 8
    bpy.context.scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.ops.render.render()
scene = bpy.context.scene
bpy.ops.hfx.add_avatar()
body = bpy.context.object
bpy.ops.hfx.add_painted(modality="pressure", name="Squeeze")
bpy.ops.hfx.fill_part(part="all")
effect = bpy.context.object
effect.hfx.pressure = 6.0
scene.hfx.preview_opacity = {OPACITY}
scene.hfx.devices.add().name = "pressure_vest"
body.location.x = 0.25
body.scale = (0.5, 0.5, 0.5)
buffer = gpu.types.GPUOffScreen({SIZE}, {SIZE})
view = Matrix.LocRotScale((0.25, -5.0, 0.5), Matrix.Rotation(np.pi / 2, 3, "X"), None).inverted()
projection = Matrix(((2, 0, 0, 0), (0, 2, 0, 0), (0, 0, -0.1, 0), (0, 0, 0, 1)))  # a metre

def picture():
    bpy.context.view_layer.update()
    preview.invalidate()
    preview.describe()
    with buffer.bind():
        frame = gpu.state.active_framebuffer_get()
        frame.clear(color=(0.0, 0.0, 0.0, 1.0), depth=1.0)
        gpu.matrix.load_matrix(view)
        gpu.matrix.load_projection_matrix(projection)
        preview.draw_over(scene)
        pixels = frame.read_color(0, 0, {SIZE}, {SIZE}, 4, 0, "FLOAT")
    return np.array(pixels.to_list(), np.float32).reshape({SIZE}, {SIZE}, 4)[:, :, :3]

manager = bpy.context.window_manager
found = {{}}
manager.hfx_show_actuators = False
found["skin"] = picture()
manager.hfx_show_actuators, manager.hfx_preview = True, False
found["glowing"] = picture()
effect.hfx.pressure = 0.0
effect.update_tag()
found["silent"] = picture()
(discs,) = preview.content.discs("PAPER")
at = np.array(discs.matrix) @ np.append(discs.rows[0, 0, :3], 1.0)
np.savez(sys.argv[1], first=at[:3], radius=discs.looks.radii[0], **found)
print(json.dumps(preview.content.fault))
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("drawn") / "pictures.npz"
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(path)], capture_output=True, text=True, timeout=120
    )
    if ran.returncode < 0 and "Traceback" not in ran.stderr:
        pytest.skip("no graphics driver")
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout.splitlines()[-1]) == ""
    assert "Error:" not in ran.stderr.replace("EGL Error", "") and "constants" not in ran.stdout
    return np.load(path)


def pixel(x: float, z: float) -> tuple[int, int]:
    """Row and column of a place in the world."""
    return round(z * SIZE), round((x - 0.25 + 0.5) * SIZE)


def test_skin_that_is_felt_is_coloured_and_darker_where_it_is_seen_from_the_side(
    pictures: Any,
) -> None:
    skin, full = pictures["skin"], np.array(COLOURS["pressure"]) * OPACITY
    row, column = pixel(0.25, 0.15)  # the lower legs of a body half as tall
    across = skin[row]
    seen = across[across.max(axis=1) > 0.0]
    light = seen[:, 1] / full[1]
    assert np.abs(seen - light[:, None] * full).max() < 2.0 / 255.0, "one colour, more or less"
    assert 0.9 < light.max() < 1.01 and 0.5 < light.min() < 0.75
    assert len(seen) > 20 and not across[column].any(), "two legs"
    row, column = pixel(0.25, 0.62)
    assert skin[row, column, 1] > 0.9 * full[1], "the chest"


def profile(picture: np.ndarray, pictures: Any) -> np.ndarray:
    """Profile from the first actuator's middle to the right, over two and a half radii."""
    x, _, z = pictures["first"]
    row, column = pixel(x, z)
    return picture[row, column : column + round(2.5 * float(pictures["radius"]) * SIZE)]


def test_a_silent_actuator_is_a_dark_disc_with_a_bright_rim(pictures: Any) -> None:
    silent = profile(pictures["silent"], pictures)
    assert silent[0] == pytest.approx([0.06, 0.06, 0.07], abs=1.01 / 255)
    assert 0.2 < silent.max() <= 0.35 + 0.65 * 0.07
    assert not silent[-5:].any(), "and nothing around it"


def test_an_actuator_glows_in_its_colour_beyond_its_rim(pictures: Any) -> None:
    silent, glowing = (profile(pictures[name], pictures) for name in ("silent", "glowing"))
    assert glowing[0, 1] > 0.5 and glowing[0, 1] > glowing[0, 0] + 0.2
    halo = glowing[(silent.max(axis=1) == 0.0) & (glowing.max(axis=1) > 0.1)]
    assert len(halo) >= 1
    assert (halo[:, 1] > 5.0 * halo[:, 0]).all()


def test_discs_are_fans_of_their_rings_each_seen_from_outside() -> None:
    corners, triangles = card_shaders.disc_geometry(3)
    radii = np.array([0.0, 0.8, 1.0, 1.0, 2.0])
    at = corners[:, :2] * radii[corners[:, 2].astype(int)][:, None]
    a, b, c = (at[triangles[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    area = (ux * vy - uy * vx) / 2.0
    polygon = 0.5 * card_shaders.CORNERS * np.sin(2.0 * np.pi / card_shaders.CORNERS)
    # Rings 2 and 3 share an edge: together both cover the outermost ring.
    assert np.abs(area).sum() == pytest.approx(3 * polygon * 4.0)
    assert (corners[triangles[:, 0], 3] == corners[triangles[:, 2], 3]).all()
    assert sorted(set(corners[:, 3])) == [0.0, 1.0, 2.0]
