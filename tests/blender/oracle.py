# SPDX-License-Identifier: GPL-3.0-or-later
"""A slow reference, sharing only the models' data with the engine.

Perceptual models are mesh objects deformed by Blender; their evaluated vertices, in float64
and world space, are tested with exact formulas, meshes with libigl's exact winding number.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import bpy
import igl
import numpy as np

from hfx_blender.blender import compat
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.counters import Counters
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.samples import Sample
from hfx_blender.engine.scene import AnimationBlock
from hfx_blender.engine.tolerance import PAPER, Tolerance
from hfx_blender.reading.scene_reader import SceneReader
from hfx_tools.demo import walking

BOUNDARY_M = 1e-5
"""Vertices nearer to a boundary than this may fall on either side."""


# Results of the engine


@dataclass
class Evaluation:
    """All samples of a scene, by effect name and sample index."""

    reader: SceneReader
    counters: Counters
    samples: dict[str, dict[int, Sample]] = field(default_factory=dict)
    blocks: list[AnimationBlock] = field(default_factory=list)

    def of(self, effect: str, index: int) -> Sample | None:
        return self.samples.get(effect, {}).get(index)

    def levels(self, effect: str) -> dict[int, float]:
        return {index: sample.level for index, sample in self.samples.get(effect, {}).items()}


def evaluate(
    scene: Any,
    *,
    record: Iterable[str] = (),
    frames: tuple[int, int] | None = None,
    rate_hz: int | Fraction = 10,
    tolerance: Tolerance = PAPER,
) -> Evaluation:
    """Read and evaluate a scene as the export does; vertices are inside or not by default."""
    record = frozenset(record)
    reader = SceneReader(
        scene,
        frames=frames,
        rate_hz=Fraction(rate_hz),
        with_positions="positions" in record,
        with_velocities="velocities" in record,
        tolerance=tolerance,
    )
    engine = Engine(reader.description, record=record, tolerance=tolerance)
    names = {effect.id: effect.name for effect in reader.description.effects}
    result = Evaluation(reader, engine.counters)
    for block in reader.blocks():
        result.blocks.append(block)
        for run in engine.evaluate(block):
            mine = result.samples.setdefault(names[run.stream.effect_id], {})
            for index, sample in zip(run.indices.tolist(), run, strict=True):
                assert index not in mine, "a time came twice"
                mine[index] = sample
    return result


# Results of Blender


def set_time(scene: Any, frame: Fraction) -> None:
    whole = frame.numerator // frame.denominator
    scene.frame_set(whole, subframe=float(frame - whole))


def model_object(scene: Any, body: Any, modality: str) -> Any:
    """A perceptual model as a mesh object with an armature modifier."""
    model = load_model(f"hfx-{modality}-1")
    mesh = bpy.data.meshes.new(f"Oracle {modality}")
    mesh.from_pydata(model.vertices.tolist(), [], [])
    obj = bpy.data.objects.new(mesh.name, mesh)
    scene.collection.objects.link(obj)
    groups = [obj.vertex_groups.new(name=name) for name in model.bone_names]
    owners = np.repeat(np.arange(len(model)), np.diff(model.weights.offsets))
    for vertex, bone, value in zip(
        owners.tolist(), model.weights.bones.tolist(), model.weights.values.tolist(), strict=True
    ):
        groups[bone].add([vertex], value, "REPLACE")
    obj.parent = body
    obj.modifiers.new("Armature", "ARMATURE").object = body
    return obj


def unit_of(scene: Any) -> float:
    """Metres of a Blender unit."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else settings.scale_length


def world_matrix(scene: Any, obj: Any) -> np.ndarray:
    """Evaluated local space to world metres, (4, 4) float64."""
    evaluated = obj.evaluated_get(scene.view_layers[0].depsgraph)
    return np.diag([unit_of(scene)] * 3 + [1.0]) @ np.array(evaluated.matrix_world, np.float64)


def local_vertices(scene: Any, obj: Any) -> np.ndarray:
    """Evaluated vertices, local space, (V, 3) float64."""
    mesh = obj.evaluated_get(scene.view_layers[0].depsgraph).to_mesh()
    flat = np.zeros(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(np.float64)


def world_vertices(scene: Any, obj: Any) -> np.ndarray:
    """Evaluated vertices, world metres, (V, 3) float64."""
    matrix = world_matrix(scene, obj)
    return local_vertices(scene, obj) @ matrix[:3, :3].T + matrix[:3, 3]


def triangles(scene: Any, obj: Any) -> np.ndarray:
    mesh = obj.evaluated_get(scene.view_layers[0].depsgraph).to_mesh()
    mesh.calc_loop_triangles()
    flat = np.zeros(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("vertices", flat)
    return flat.reshape(-1, 3).astype(np.int64)


@dataclass(frozen=True)
class Verdict:
    """Points against a volume at one time."""

    inside: np.ndarray  # (V,) bool
    clear: np.ndarray  # (V,) bool: at least BOUNDARY_M from the boundary
    weights: np.ndarray | None  # (V,) falloff where inside; None for meshes


def judge(scene: Any, effect: Any, points: np.ndarray) -> Verdict:
    """Mask of the points (V, 3), world metres, inside an effect's volume at the scene's time."""
    if effect.hfx.shape == "MESH":
        return _judge_mesh(scene, effect, points)
    hfx = effect.evaluated_get(scene.view_layers[0].depsgraph).hfx
    matrix = world_matrix(scene, effect)
    to_local = np.linalg.inv(matrix[:3, :3])  # rows are the gradients of the local coordinates
    local = (points - matrix[:3, 3]) @ to_local.T
    # Each shape as a set of constraints g(p) <= 1; |g - 1| / |gradient| is, to first order, the
    # world distance to the surface g = 1, and exact for planes.
    along = np.abs(local[:, 2])
    gradient_z = np.broadcast_to(to_local[2], local.shape)
    if hfx.shape == "CUBOID":
        half = np.array(hfx.size, np.float64) / 2
        values = np.abs(local) / half
        gradients = [np.broadcast_to(to_local[i] / half[i], local.shape) for i in range(3)]
    elif hfx.shape == "CYLINDER":
        radial = np.linalg.norm(local[:, :2], axis=1)
        values = np.stack([radial / hfx.radius, along / (hfx.height / 2)], axis=1)
        outwards = local[:, :2] / np.maximum(radial, 1e-12)[:, None]
        gradients = [outwards @ to_local[:2] / hfx.radius, gradient_z / (hfx.height / 2)]
    else:  # a sphere is a capsule without a segment
        segment = max(hfx.height / 2 - hfx.radius, 0.0) if hfx.shape == "CAPSULE" else 0.0
        foot = np.zeros_like(local)
        foot[:, 2] = np.clip(local[:, 2], -segment, segment)
        away = np.linalg.norm(local - foot, axis=1)
        values = (away / hfx.radius)[:, None]
        outwards = (local - foot) / np.maximum(away, 1e-12)[:, None]
        gradients = [outwards @ to_local / hfx.radius]
    slopes = np.stack([np.linalg.norm(g, axis=1) for g in gradients], axis=1)
    distances = np.abs(values - 1.0) / np.maximum(slopes, 1e-12)
    largest = values.max(axis=1)
    return Verdict(
        largest <= 1.0, (distances > BOUNDARY_M).all(axis=1), _falloff(hfx, 1.0 - largest)
    )


def _falloff(hfx: Any, rise: np.ndarray) -> np.ndarray:
    if hfx.falloff == "none":
        return np.ones_like(rise)
    t = np.clip(rise / hfx.falloff_share, 0.0, 1.0)
    return t if hfx.falloff == "linear" else 3 * t**2 - 2 * t**3


def _judge_mesh(scene: Any, effect: Any, points: np.ndarray) -> Verdict:
    corners, faces = world_vertices(scene, effect), triangles(scene, effect)
    low, high = corners.min(axis=0) - 1e-3, corners.max(axis=0) + 1e-3
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    inside, clear = np.zeros(len(points), bool), np.ones(len(points), bool)
    if len(near):
        # Winding number of a turned copy: only zero or non-zero matters, not the sign.
        inside[near] = np.rint(np.abs(igl.winding_number(corners, faces, points[near]))) > 0
        squared = igl.point_mesh_squared_distance(points[near], corners, faces)[0]
        clear[near] = np.sqrt(squared) > BOUNDARY_M
    return Verdict(inside, clear, None)


def mesh_depths(scene: Any, effect: Any, points: np.ndarray) -> np.ndarray:
    """World distance of points (V, 3) to the surface of a mesh volume, (V,)."""
    corners, faces = world_vertices(scene, effect), triangles(scene, effect)
    return np.sqrt(igl.point_mesh_squared_distance(points, corners, faces)[0])


# Building scenes with the user's operators


def add_volume(name: str, modality: str, shape: str, location: Any, **settings: Any) -> Any:
    done = bpy.ops.hfx.add_volume(
        modality=modality, shape=shape, name=name, location=location, **settings
    )
    assert done == {"FINISHED"}
    return bpy.context.object


def add_mesh_volume(name: str, modality: str, source: Any) -> Any:
    bpy.context.view_layer.objects.active = source
    assert bpy.ops.hfx.volume_from_mesh(modality=modality, name=name) == {"FINISHED"}
    assert bpy.context.object.data == source.data
    return bpy.context.object


def add_painted(name: str, modality: str, body: Any, part: str = "all") -> Any:
    bpy.context.view_layer.objects.active = body
    assert bpy.ops.hfx.add_painted(modality=modality, name=name) == {"FINISHED"}
    assert bpy.ops.hfx.fill_part(part=part) == {"FINISHED"}
    return bpy.context.object


def add_clip(effect: Any, start: float, end: float, **fades: float) -> Any:
    """A clip from frame to frame; fades in frames."""
    bpy.context.view_layer.objects.active = effect
    render = bpy.context.scene.render
    # Seconds of playback: Blender plays frames of the animation more slowly, or faster.
    fps = render.fps / render.fps_base * render.frame_map_old / render.frame_map_new
    fades = {name: value / fps for name, value in fades.items()}
    assert bpy.ops.hfx.add_clip(start=start, duration=(end - start) / fps, **fades) == {"FINISHED"}
    return [strip for track in effect.animation_data.nla_tracks for strip in track.strips][-1]


def add_avatar() -> Any:
    assert bpy.ops.hfx.add_avatar() == {"FINISHED"}
    return bpy.context.object


def add_walk(body: Any, places: list[tuple[float, float, float]], start: int, end: int) -> None:
    walking.add_walk(body, places, start, end)


def bend(body: Any, seed: int, strength: float = 0.6) -> None:
    """Turn every bone by a random angle, radians of standard deviation ``strength``."""
    turns = np.random.default_rng(seed).normal(0.0, strength, (len(body.pose.bones), 3))
    for bone, turn in zip(body.pose.bones, turns, strict=True):
        bone.rotation_mode = "XYZ"
        bone.rotation_euler = turn


def key(owner: Any, path: str, keys: Iterable[tuple[float, Any]]) -> None:
    """Keyframes of a property; those of a bool are steps, as in all Blenders but 4.4.0."""
    holder, _, name = path.rpartition(".")
    target = owner.path_resolve(holder) if holder else owner
    for frame, value in keys:
        setattr(target, name, value)
        owner.keyframe_insert(path, frame=frame)
    if isinstance(target.path_resolve(name), bool):
        curve = compat.fcurve_of(owner.id_data, target.path_from_id(name))
        assert curve is not None, path
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"


def empty(scene: Any, name: str = "Empty", parent: Any = None) -> Any:
    obj = bpy.data.objects.new(name, None)
    scene.collection.objects.link(obj)
    obj.parent = parent
    return obj
