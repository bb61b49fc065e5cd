# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison with the usual solutions for mesh volumes: evaluated meshes, vertex by vertex.

One avatar walks through one mesh volume. Each method computes, for every frame, the vertices of
the perceptual model (45,000) inside the mesh.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Final

import bpy
import numpy as np

from hfx_blender.avatars import model_mesh
from hfx_blender.engine.arrays import F64, Bool
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.reading.scene_reader import SceneReader

from ..demo.walking import add_walk

Progress = Callable[[float], None]

_MODEL: Final = "hfx-vibration-1"
_FPS: Final = 24


def measure(*, short: bool = False, progress: Progress = lambda share: None) -> dict[str, Any]:
    """Measure all methods on a scene built in a new file; plain data."""
    frames = 8 if short else 24
    scene, model_object, volume = _scene(frames)
    ways: dict[str, Callable[[], dict[int, Bool]]] = {
        "hfx": lambda: _test_by_engine(scene, frames),
        "evaluated mesh + BVHTree": lambda: _test_stepped(
            scene, model_object, volume, frames, _by_bvh
        ),
    }
    import trimesh

    if trimesh.ray.has_embree:
        ways["evaluated mesh + trimesh.contains"] = lambda: _test_stepped(
            scene, model_object, volume, frames, _by_trimesh
        )
    rows: list[dict[str, Any]] = []
    answers: dict[str, dict[int, Bool]] = {}
    for name, work in ways.items():
        if name == "hfx":  # the engine does not need the model as a mesh
            model_object.hide_viewport = True
            work()  # builds voxels and skin once per scene; the rivals have no such caches
        start = time.perf_counter()
        answers[name] = work()
        seconds = time.perf_counter() - start
        model_object.hide_viewport = False
        rows.append({"way": name, "ms_per_frame": 1e3 * seconds / frames})
        progress(len(rows) / len(ways))
    for row in rows:
        rival_answer, engine_answer = answers[row["way"]], answers["hfx"]
        row["inside"] = int(sum(is_inside.sum() for is_inside in rival_answer.values()))
        row["differs"] = int(
            sum(np.count_nonzero(rival_answer[f] != engine_answer[f]) for f in range(frames))
        )
        row["times_hfx"] = row["ms_per_frame"] / rows[0]["ms_per_frame"]
    return {
        "frames": frames,
        "vertices": len(load_model(_MODEL)),
        "triangles": len(volume.data.loop_triangles) or len(volume.data.polygons),
        "ways": rows,
        "left_out": [] if trimesh.ray.has_embree else ["trimesh.contains needs embreex or rtree"],
    }


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    lines = [
        f"{result['vertices']} vertices of a walking avatar in a mesh of {result['triangles']} "
        f"faces, {result['frames']} frames:",
        f"  {'way':36} {'ms/frame':>9} {'times hfx':>9}  inside  other answers",
    ]
    lines += [
        f"  {row['way']:36} {row['ms_per_frame']:9.1f} {row['times_hfx']:9.1f}  "
        f"{row['inside']:6}  {row['differs']}"
        for row in result["ways"]
    ]
    return "\n".join([*lines, *(f"  ({text})" for text in result["left_out"])])


def _scene(frames: int) -> tuple[Any, Any, Any]:
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = _FPS
    scene.frame_start, scene.frame_end = 0, frames - 1
    bpy.ops.hfx.add_avatar()
    body = bpy.context.object
    add_walk(body, ((0.0, -0.3, 0.0), (0.0, 0.3, 0.0)), 0, frames)
    bpy.ops.mesh.primitive_torus_add(
        major_segments=150,
        minor_segments=90,
        major_radius=0.45,
        minor_radius=0.25,
        location=(0.0, 0.0, 1.1),
    )
    bpy.ops.hfx.volume_from_mesh(modality="vibration", name="Ring")
    volume = bpy.context.object
    posed = model_mesh.add_posed(bpy.context, body, load_model(_MODEL), "Model")
    return scene, posed, volume


def _test_by_engine(scene: Any, frames: int) -> dict[int, Bool]:
    """Vertices inside, (V,) Booleans by frame, from the engine at the paper's tolerance."""
    reader = SceneReader(scene, rate_hz=Fraction(scene.render.fps), tolerance=PAPER)
    engine = Engine(reader.description, tolerance=PAPER)
    count = len(load_model(_MODEL))
    inside = {frame: np.zeros(count, np.bool_) for frame in range(frames)}
    for block in reader.blocks():
        for run in engine.evaluate(block):
            for index, sample in zip(run.indices.tolist(), run, strict=True):
                inside[index][sample.vertices] = True
    return inside


def _test_stepped(
    scene: Any, posed: Any, volume: Any, frames: int, test: Callable[[Any, F64], Bool]
) -> dict[int, Bool]:
    """Vertices inside, (V,) Booleans by frame, from evaluated meshes of a stepped scene."""
    inside = {}
    for frame in range(frames):
        scene.frame_set(frame)
        layer = bpy.context.evaluated_depsgraph_get()
        inside[frame] = test(volume.evaluated_get(layer), _world_points(posed.evaluated_get(layer)))
    return inside


def _world_points(evaluated: Any) -> F64:
    points = np.zeros(len(evaluated.data.vertices) * 3, np.float32)
    evaluated.data.vertices.foreach_get("co", points)
    matrix = np.array(evaluated.matrix_world, np.float64)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def _by_bvh(volume: Any, points: F64) -> Bool:
    """Test points by the nearest face and its normal, the usual solution in forums."""
    from mathutils import Vector
    from mathutils.bvhtree import BVHTree

    tree = BVHTree.FromPolygons(
        [volume.matrix_world @ vertex.co for vertex in volume.data.vertices],
        [polygon.vertices for polygon in volume.data.polygons],
    )
    inside = np.zeros(len(points), np.bool_)
    for k, point in enumerate(points.tolist()):
        nearest, normal, _, _ = tree.find_nearest(point)
        inside[k] = (Vector(point) - nearest).dot(normal) <= 0.0
    return inside


def _by_trimesh(volume: Any, points: F64) -> Bool:
    import trimesh

    volume.data.calc_loop_triangles()
    triangles = np.zeros(len(volume.data.loop_triangles) * 3, np.int32)
    volume.data.loop_triangles.foreach_get("vertices", triangles)
    mesh = trimesh.Trimesh(_world_points(volume), triangles.reshape(-1, 3), process=False)
    return np.asarray(mesh.contains(points), np.bool_)
