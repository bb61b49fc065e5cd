# SPDX-License-Identifier: GPL-3.0-or-later
"""Example of haptic surfaces: a board of 4 x 4 squares of four materials (Liu and Gu 2025).

Gravel, metal, fabric and wood, each once in every row and column, with an optional cover for
blind tests. The board slides under a fingertip of a standing avatar, square after square, ready
for playback and export.
"""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np

from hfx_blender.authoring.effects import effects
from hfx_blender.authoring.surfaces import surfaces
from hfx_blender.avatars import bodies
from hfx_blender.blender.compat import new_fcurve, set_keys
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.texture.haptic_map import (
    STANDARD_GRAVITY,
    DeviceRange,
    SurfaceRenderer,
    SurfaceTexture,
)
from hfx_blender.engine.texture.procedural import MATERIALS
from hfx_blender.engine.texture.stroke import line
from hfx_blender.engine.texture.stroke_rendering import render_stroke
from hfx_blender.errors import OutputError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.formats.signals import stroke_files

from ..command_process.temporary_folder import temporary_folder
from .scene_file import forget_folders

SQUARES = 4
SQUARE_M = 0.05
CHOSEN = ("gravel-fine", "metal-brushed", "fabric-corduroy", "wood-oak")
ORDER = ((0, 1, 2, 3), (2, 3, 0, 1), (3, 2, 1, 0), (1, 0, 3, 2))
"""A Latin square: each material once in every row and column."""

_COLOURS = {
    "gravel": (0.35, 0.33, 0.3),
    "metal": (0.62, 0.64, 0.68),
    "fabric": (0.12, 0.2, 0.45),
    "wood": (0.4, 0.22, 0.1),
}
_TEXELS = 256
_SPEED_M_S = 0.1
_TIP_M = 0.012  # half width of a fingertip
_FPS = 50
_RATE_HZ = 200


def save(path: Path) -> list[str]:
    """Build the example in a new file and save it; returns the names of all squares.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    bpy.ops.wm.read_homefile(use_empty=True)
    squares = build(bpy.context)
    forget_folders()
    with temporary_folder() as folder:
        blend_file = os.path.join(folder, "board.blend")
        try:
            bpy.ops.wm.save_as_mainfile(filepath=blend_file, compress=True, copy=True)
        except RuntimeError as error:
            raise OutputError(f"{path}: Blender cannot save it ({error}).") from error
        with atomic_file(path) as file:
            file.write(Path(blend_file).read_bytes())
    return [obj.name for obj in squares]


def build(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Add avatar, board and the board's motion to a scene; returns the squares, row by row."""
    scene = context.scene
    scene.render.fps, scene.hfx.rate = _FPS, _RATE_HZ
    body, _ = bodies.add_avatar(context)
    fingertip_m = _fingertip() + np.array(body.matrix_world.translation)
    board = bpy.data.objects.new("Board", None)
    board.empty_display_size = SQUARE_M
    collection = bpy.data.collections.new("Board")
    scene.collection.children.link(collection)
    collection.objects.link(board)
    materials = {name: _material(name) for name in CHOSEN}
    first: dict[str, bpy.types.Object] = {}
    squares = []
    for row, kinds in enumerate(ORDER):
        for column, kind in enumerate(kinds):
            name = CHOSEN[kind]
            title = _title(row, column, kind)
            square = _add_square(collection, title, first.get(name))
            if name not in first:
                first[name] = square
                square.data.materials.append(materials[name])
                _add_haptic_surface(square, name)
            square.parent = board
            middle = (SQUARES - 1) / 2.0
            square.location = ((column - middle) * SQUARE_M, (row - middle) * SQUARE_M, 0.0)
            squares.append(square)
    _add_cover(collection, board)
    _add_slide(scene, board, fingertip_m)
    effects.store_unique_ids()
    return squares


def _fingertip() -> F64:
    """Lowest point (3,) of the avatar's fingers in rest space: a level board's first contact."""
    model = load_model(effects.model_id_for("vibration", None))
    fingers = np.flatnonzero(np.asarray(model.part) == PARTS.index("fingers"))
    tip = model.vertices[fingers[np.argmin(model.vertices[fingers, 2])]]
    return np.asarray(tip, np.float64)


def _add_square(
    collection: bpy.types.Collection, title: str, like: bpy.types.Object | None
) -> bpy.types.Object:
    """Add a square; ``like`` is a square of the same material, for a shared mesh and maps."""
    if like is None:
        half = SQUARE_M / 2.0
        mesh = bpy.data.meshes.new(title.split()[0])
        corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        uv = np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32)
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv)
        square = bpy.data.objects.new(title, mesh)
    else:
        square = like.copy()
        square.name = title
    collection.objects.link(square)
    return square


def _add_haptic_surface(square: bpy.types.Object, name: str) -> None:
    square.hfx.surface.resolution = _TEXELS
    surfaces.add_surface(square, "PROCEDURAL")
    square.hfx.surface.procedural = name
    surfaces.make_maps(square)
    if MATERIALS[name].kind == "metal":  # too smooth for recognition by touch alone
        square.hfx.surface.sound = _friction_sound(name)


def _friction_sound(name: str) -> bpy.types.Sound:
    """Make one second of sound of a nail on a material, from the height profile at audio rate."""
    field, _ = MATERIALS[name].make(_TEXELS)
    texture = SurfaceTexture(field, None, SurfaceRenderer.DIRECT)
    path_ = line((0.0, 0.0), np.pi / 3.0, _SPEED_M_S, _SPEED_M_S)
    stroke = render_stroke(texture, path_, waveform_rate_hz=stroke_files.WAV_RATE_HZ)
    peak = float(np.abs(stroke.waveform_m_s2).max()) / STANDARD_GRAVITY
    loud = DeviceRange(amplitude_g=(0.0, max(2.0 * peak, 1e-9)))
    with temporary_folder() as folder:
        path = Path(folder) / f"{name}.wav"
        stroke_files.write(stroke, path_, loud, path)
        sound = bpy.data.sounds.load(str(path))
        sound.pack()
    sound.name = f"{name} friction"
    return sound


def _material(name: str) -> bpy.types.Material:
    """Make a matching render material, with the relief as bump map in physical scale."""
    kind = MATERIALS[name].kind
    material = bpy.data.materials.new(MATERIALS[name].title)
    material.diffuse_color = (*_COLOURS[kind], 1.0)
    if material.node_tree is None:  # never None from Blender 5.0 on
        material.use_nodes = True
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (*_COLOURS[kind], 1.0)
    shader.inputs["Metallic"].default_value = float(kind == "metal")
    shader.inputs["Roughness"].default_value = max(MATERIALS[name].roughness, 0.25)
    field, _ = MATERIALS[name].make(_TEXELS)
    depth = float(np.ptp(field.heights_m)) or 1.0
    image = bpy.data.images.new(f"{name} relief", _TEXELS, _TEXELS, is_data=True)
    pixels = np.ones((_TEXELS, _TEXELS, 4), np.float32)
    pixels[..., :3] = ((field.heights_m - field.heights_m.min()) / depth)[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    picture = tree.nodes.new("ShaderNodeTexImage")
    picture.image = image
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    scale = tree.nodes.new("ShaderNodeVectorMath")
    scale.operation = "SCALE"
    scale.inputs["Scale"].default_value = SQUARE_M / MATERIALS[name].size_m
    tree.links.new(coordinates.outputs["UV"], scale.inputs[0])
    tree.links.new(scale.outputs[0], picture.inputs["Vector"])
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = depth
    tree.links.new(picture.outputs["Color"], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return material


def _add_cover(collection: bpy.types.Collection, board: bpy.types.Object) -> None:
    """Add a hidden cover over the squares, for tests of touch alone."""
    half = SQUARE_M * SQUARES / 2.0
    mesh = bpy.data.meshes.new("Cover")
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    cover = bpy.data.objects.new("Cover", mesh)
    cover.location.z = 0.0005
    cover.parent = board
    cover.hide_render = True
    collection.objects.link(cover)
    cover.hide_set(True)


def crossings() -> list[tuple[str, float, float]]:
    """Title, begin and end in seconds of each square, in the order of the stroke.

    In this time the fingertip touches no other square.
    """
    reach, crossed = SQUARE_M * (SQUARES / 2.0 - 0.2), []
    row_s = (2.0 * reach + SQUARE_M) / _SPEED_M_S
    edges = np.clip(SQUARE_M * (np.arange(SQUARES + 1) - SQUARES / 2.0), -reach, reach)
    since_s = row_s * np.arange(SQUARES)[:, None] + (edges + reach) / _SPEED_M_S
    for row, kinds in enumerate(ORDER):
        order = range(SQUARES) if row % 2 == 0 else range(SQUARES - 1, -1, -1)
        for step, column in enumerate(order):
            begin_s, end_s = since_s[row, step : step + 2].tolist()
            tip_s = _TIP_M / _SPEED_M_S
            crossed.append((_title(row, column, kinds[column]), begin_s + tip_s, end_s - tip_s))
    return crossed


def _title(row: int, column: int, kind: int) -> str:
    return f"{MATERIALS[CHOSEN[kind]].kind.title()} {row + 1}{column + 1}"


def _add_slide(scene: bpy.types.Scene, board: bpy.types.Object, fingertip_m: F64) -> None:
    """Key the board's motion so that the fingertip crosses every square, row after row."""
    reach = SQUARE_M * (SQUARES / 2.0 - 0.2)
    turning_points: list[tuple[float, float]] = []
    for row in range(SQUARES):
        y = (row - (SQUARES - 1) / 2.0) * SQUARE_M
        ends = (-reach, reach) if row % 2 == 0 else (reach, -reach)
        turning_points += [(x, y) for x in ends]
    points = np.array(turning_points)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    frames = np.concatenate([[0.0], np.cumsum(lengths)]) / _SPEED_M_S * _FPS
    scene.frame_start, scene.frame_end = 0, int(np.ceil(frames[-1]))
    board.location = (*(fingertip_m[:2] - points[0]), fingertip_m[2] - 0.0005)
    action = bpy.data.actions.new("Slide")
    board.animation_data_create().action = action
    for axis in range(2):
        values = fingertip_m[axis] - points[:, axis]
        curve = new_fcurve(board, action, "location", axis)
        set_keys(curve, list(zip(frames.tolist(), values.tolist(), strict=True)))
