# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the avatar with haptic colours, at the key moments of the demo.

Cycles renders on the processor, so neither display nor GPU is needed.
"""

from __future__ import annotations

from math import atan2, cos, pi, radians, sin
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from mathutils.kdtree import KDTree

from hfx_blender.authoring.effects import effects
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.colouring import COLOURS, Spread
from hfx_blender.engine.samples import Sample
from hfx_blender.engine.track import TrackHeader, TrackReader
from hfx_blender.processes import blender_session

from ..felt_shares import avatar_colours
from .garage import FPS, TASKS, Task

SIZE = (480, 600)
FELT = "hfx_felt"

# Camera: angle from the walker's front (left positive, degrees), distance, height (m).
_VIEWS = {
    "T1": (-35.0, 4.4, 1.9),
    "T2": (165.0, 3.4, 1.7),
    "T3": (60.0, 4.6, 1.7),
    "T4": (-55.0, 3.6, 1.5),
}


def draw(scene_file: Path, track_file: Path, folder: Path) -> list[Path]:
    """Render a picture for each task and a sheet ``felt.png``; returns all paths."""
    blender_session.open_blend(scene_file)
    scene = bpy.context.scene
    set_up_rendering(scene)
    body = effects.bodies_of(scene)[0]
    show_felt_colours(body.hfx.avatar)
    with TrackReader(track_file) as track:
        for task in TASKS:
            frame = task.telling_s * FPS
            scene.frame_set(int(frame), subframe=frame % 1.0)
            samples = track.samples_at(task.telling_s)
            colour_by_samples(body.hfx.avatar, samples, track.header)
            tubes = [_tube(effects_by_id(scene)[s.stream.effect_id]) for s in samples]
            aim(scene, body, task)
            scene.render.filepath = str(folder / f"{task.name}.png")
            _render(scene)
            for tube in filter(None, tubes):
                bpy.data.objects.remove(tube)
    files = [folder / f"{task.name}.png" for task in TASKS]
    _side_by_side(files, folder / "felt.png")
    return [*files, folder / "felt.png"]


def effects_by_id(scene: bpy.types.Scene) -> dict[str, bpy.types.Object]:
    """Effects of the scene by their ids in the track."""
    objects = effects.effects_of(scene)
    ids = effects.unique_ids([*effects.bodies_of(scene), *objects])
    return {ids[obj]: obj for obj in objects}


def set_up_rendering(scene: bpy.types.Scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 8
    scene.cycles.max_bounces = 3
    scene.cycles.use_denoising = True
    scene.cycles.seed = 0
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    for name in dir(scene.render):  # no file name, date and time in the pictures
        if name.startswith("use_stamp_"):
            setattr(scene.render, name, False)


def _render(scene: bpy.types.Scene) -> None:
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError:
        if not scene.cycles.use_denoising:
            raise
        # Distribution builds lack OpenImageDenoise: more samples instead.
        scene.cycles.use_denoising = False
        scene.cycles.samples = 32
        bpy.ops.render.render(write_still=True)


def show_felt_colours(avatar: bpy.types.Object) -> None:
    avatar.data.attributes.new(FELT, "FLOAT_COLOR", "POINT")
    material = bpy.data.materials.new(FELT)
    if not material.node_tree:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    colour = nodes.new("ShaderNodeAttribute")
    colour.attribute_name = FELT
    links.new(colour.outputs["Color"], shader.inputs["Base Color"])
    links.new(colour.outputs["Color"], shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 0.12
    shader.inputs["Roughness"].default_value = 0.7
    avatar.data.materials.clear()
    avatar.data.materials.append(material)


def colour_by_samples(avatar: bpy.types.Object, samples: list[Sample], header: TrackHeader) -> None:
    rest = load_avatar().vertices
    models = {s.stream.model_id: load_model(s.stream.model_id) for s in samples}
    colours = avatar_colours(
        samples,
        {key: _spread(rest, model.vertices) for key, model in models.items()},
        {key: len(model) for key, model in models.items()},
        frozenset(effect.id for effect in header.effects if effect.is_contact),
    )
    flat = np.ones((len(colours), 4), np.float32)
    flat[:, :3] = colours
    avatar.data.attributes[FELT].data.foreach_set("color", flat.ravel())
    avatar.data.update()


def _spread(avatar: np.ndarray, model: np.ndarray, count: int = 3) -> Spread:
    """Interpolation from a model's to an avatar's vertices, by the nearest ``count``."""
    tree = KDTree(len(model))
    for index, vertex in enumerate(model.tolist()):
        tree.insert(vertex, index)
    tree.balance()
    neighbours = [tree.find_n(vertex, count) for vertex in avatar.tolist()]
    return Spread.of_neighbours(
        np.array([[index for _, index, _ in row] for row in neighbours]),
        np.array([[distance for _, _, distance in row] for row in neighbours]),
    )


def _tube(effect: bpy.types.Object) -> bpy.types.Object | None:
    """Add a volume's wireframe as thin glowing tubes, as Blender renders no wires; else None."""
    if effect.hfx.kind != "VOLUME":
        return None
    curve = bpy.data.curves.new("Wire", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = 0.006
    for edge in effect.data.edges:
        spline = curve.splines.new("POLY")
        spline.points.add(1)
        for point, vertex in zip(spline.points, edge.vertices, strict=True):
            point.co = (*(effect.matrix_world @ effect.data.vertices[vertex].co), 1.0)
    material = bpy.data.materials.new("Wire")
    if not material.node_tree:
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Emission Color"].default_value = (*COLOURS[effect.hfx.modality], 1.0)
    shader.inputs["Emission Strength"].default_value = 1.2
    shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    curve.materials.append(material)
    tube = bpy.data.objects.new("Wire", curve)
    tube.visible_shadow = False
    bpy.context.scene.collection.objects.link(tube)
    return tube


def aim(scene: bpy.types.Scene, body: bpy.types.Object, task: Task) -> None:
    angle, distance, height = _VIEWS[task.name]
    front = body.matrix_world.to_3x3() @ Vector((0.0, -1.0, 0.0))
    heading = atan2(front.y, front.x) + radians(angle)
    target = body.matrix_world.translation + Vector((0.0, 0.0, 0.95))
    camera = scene.camera
    camera.location = target + Vector(
        (cos(heading) * distance, sin(heading) * distance, height - 0.95)
    )
    camera.rotation_mode = "QUATERNION"
    camera.rotation_quaternion = (target - camera.location).to_track_quat("-Z", "Y")
    camera.data.angle = pi / 4.2


def _side_by_side(files: list[Path], path: Path) -> None:
    width, height = SIZE
    sheet = np.zeros((height, width * len(files), 4), np.float32)
    for k, file in enumerate(files):
        picture = bpy.data.images.load(str(file))
        pixels = np.zeros(width * height * 4, np.float32)
        picture.pixels.foreach_get(pixels)
        sheet[:, k * width : (k + 1) * width] = pixels.reshape(height, width, 4)
    together = bpy.data.images.new("felt", sheet.shape[1], height)
    together.pixels.foreach_set(sheet.ravel())
    together.filepath_raw = str(path)
    together.file_format = "PNG"
    together.save()
