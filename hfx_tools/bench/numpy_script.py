# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison with a user's script of numpy and scipy for volumes with a formula.

The script poses every vertex of the scene's perceptual models by one sparse float32 product, and
tests the vertices within a volume's world box in the volume's local space: the faster of two
usual scripts. Engine and script get bones and volumes from Blender; the time of stepping the
scene is shown apart. Seconds are processor time of one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import pi
from typing import Any, Final

import bpy
import numpy as np
from scipy.sparse import csr_array

from hfx_blender.authoring.effects import effects
from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.tolerance import PAPER, STANDARD, Tolerance
from hfx_blender.reading.scene_reader import SceneReader

from . import export_cost
from .scenes import MODALITIES, empty_scene, move, volume

_FRAMES: Final = 240
_SHAPES: Final = ("SPHERE", "CUBOID", "CYLINDER", "CAPSULE")
TOLERANCES: Final = {PAPER: 3.0, STANDARD: 2.0}
"""Target of each tolerance: script time / engine time."""

VerticesInside = dict[tuple[int, str], I64]
"""Vertices inside, by frame and name of the volume."""


@dataclass(frozen=True, eq=False)
class _Frame:
    bones: F64  # (B, 3, 4) rest pose to world
    matrices: dict[str, F64]  # of volumes, (4, 4) local space to world


class _Script:
    """Bodies, volumes and skins of a scene, for the script."""

    def __init__(self) -> None:
        self.body = next(o for o in bpy.context.scene.objects if o.hfx.role == "BODY")
        self.volumes = effects.effects_of(bpy.context.scene)
        self.model_of = {
            obj.name: effects.model_id_for(obj.hfx.modality, None) for obj in self.volumes
        }
        self.tests = {obj.name: _test_of(obj.hfx) for obj in self.volumes}
        names = [bone.name for bone in self.body.pose.bones]
        models = {model_id: load_model(model_id) for model_id in {*self.model_of.values()}}
        self.halves = {obj.name: _half_edges(obj.hfx) for obj in self.volumes}
        self.skins = {model_id: _skin(model, names) for model_id, model in models.items()}

    def read(self) -> _Frame:
        """Read bones and volumes at the scene's current frame."""
        graph = bpy.context.view_layer.depsgraph
        body = self.body.evaluated_get(graph)
        columns = np.zeros(len(body.pose.bones) * 16, np.float32)
        body.pose.bones.foreach_get("matrix_channel", columns)
        bones = np.array(body.matrix_world) @ columns.reshape(-1, 4, 4).transpose(0, 2, 1)
        placed = {v.name: np.array(v.evaluated_get(graph).matrix_world) for v in self.volumes}
        return _Frame(bones[:, :3], placed)

    def inside(self, frame: _Frame) -> dict[str, I64]:
        """Vertices inside each volume, ascending, by name."""
        bones = frame.bones.transpose(0, 2, 1).reshape(-1, 3).astype(np.float32)
        posed = {model_id: (skin @ bones).T.copy() for model_id, skin in self.skins.items()}
        inside_ids = {}
        for name, matrix in frame.matrices.items():
            points, half = posed[self.model_of[name]], self.halves[name]
            reach, middle = np.abs(matrix[:3, :3]) @ half, matrix[:3, 3]
            # World box of the volume, 0.1 % larger for float32.
            near = np.flatnonzero(
                (np.abs(points - middle[:, None].astype(np.float32)) <= 1.001 * reach[:, None]).all(
                    axis=0
                )
            )
            to_local = np.linalg.inv(matrix)
            local = to_local[:3, :3] @ points[:, near] + to_local[:3, 3:]
            inside_ids[name] = near[self.tests[name](local)]
        return inside_ids


def _skin(model: PerceptualModel, names: list[str]) -> csr_array:
    """Sparse (V, 4 B) float32: its product with columns of matrices (4 B, 3) poses the vertices."""
    count = len(model)
    owner = np.repeat(np.arange(count), np.diff(model.weights.offsets))
    number = np.array([names.index(name) for name in model.bone_names])[model.weights.bones]
    weights = model.weights.values / np.bincount(owner, model.weights.values, count)[owner]
    rest = np.column_stack([model.vertices, np.ones(count)])[owner] * weights[:, None]
    columns = 4 * number[:, None] + np.arange(4)
    rows = np.repeat(owner, 4)
    entries = rest.ravel().astype(np.float32), (rows, columns.ravel())
    return csr_array(entries, shape=(count, 4 * len(names)))


def _half_edges(hfx: Any) -> F64:
    """Half edges (3,) of a volume's box in its local space."""
    if hfx.shape == "CUBOID":
        return np.array(hfx.size) / 2.0
    radius = hfx.radius
    along = {"SPHERE": radius, "CYLINDER": hfx.height / 2.0}
    return np.array([radius, radius, along.get(hfx.shape, max(hfx.height / 2.0, radius))])


def _test_of(hfx: Any) -> Callable[[F64], Any]:
    """Test of points (3, N) in a volume's local space."""
    radius, half, size = hfx.radius, hfx.height / 2.0, _half_edges(hfx)[:, None]
    if hfx.shape == "SPHERE":
        return lambda p: (p * p).sum(axis=0) <= radius**2
    if hfx.shape == "CUBOID":
        return lambda p: (np.abs(p) <= size).all(axis=0)
    if hfx.shape == "CYLINDER":
        return lambda p: (p[0] ** 2 + p[1] ** 2 <= radius**2) & (np.abs(p[2]) <= half)

    def in_capsule(p: F64) -> Any:
        beyond = np.maximum(np.abs(p[2]) - max(half - radius, 0.0), 0.0)
        return p[0] ** 2 + p[1] ** 2 + beyond**2 <= radius**2

    return in_capsule


def measure(
    *, short: bool = False, progress: Callable[[float], None] = lambda share: None
) -> list[dict[str, Any]]:
    """Compare engine and script in each scene, built in a new file; milliseconds a frame."""
    frames = 24 if short else _FRAMES
    rows = []
    for number, (name, build) in enumerate(_SCENES.items()):
        build(frames)
        rows.append({"scene": name, **_compare_scene(frames)})
        progress((number + 1) / len(_SCENES))
    return rows


def _compare_scene(frames: int) -> dict[str, Any]:
    scene, script = bpy.context.scene, _Script()
    scene.frame_set(0)
    begin = time.process_time()
    poses = []
    for frame in range(frames):
        scene.frame_set(frame)
        poses.append(script.read())
    stepping = time.process_time() - begin
    script.inside(poses[0])
    begin = time.process_time()
    inside_ids = [script.inside(pose) for pose in poses]
    taken = time.process_time() - begin
    script_ids = {
        (k, name): ids for k, by_name in enumerate(inside_ids) for name, ids in by_name.items()
    }
    row: dict[str, Any] = {
        "volumes": len(script.volumes),
        "stepping": 1e3 * stepping / frames,
        "script": 1e3 * taken / frames,
        "inside": sum(map(len, script_ids.values())),
    }
    for tolerance in TOLERANCES:
        seconds, engine_ids = _time_engine(tolerance, frames)
        row[tolerance.name] = 1e3 * seconds / frames
        if tolerance is PAPER:
            no_vertices = np.zeros(0, np.int64)
            pairs = ((ids, engine_ids.get(key, no_vertices)) for key, ids in script_ids.items())
            row["differs"] = sum(len(np.setxor1d(*pair)) for pair in pairs)
    return row


def _time_engine(tolerance: Tolerance, frames: int) -> tuple[float, VerticesInside]:
    """Processor seconds of the engine alone, without reading, and the vertices inside."""
    scene = bpy.context.scene
    reader = SceneReader(scene, rate_hz=Fraction(scene.render.fps), tolerance=tolerance)
    blocks = list(reader.blocks())
    Engine(reader.description, tolerance=tolerance).evaluate(blocks[0])  # loads modules and models
    engine = Engine(reader.description, tolerance=tolerance)
    begin = time.process_time()
    runs = [run for _, block_runs in engine.evaluated(blocks) for run in block_runs]
    seconds = time.process_time() - begin
    names = {effect.id: effect.name for effect in reader.description.effects}
    inside_ids = {
        (index, names[run.stream.effect_id]): sample.vertices.astype(np.int64)
        for run in runs
        for index, sample in zip(run.indices.tolist(), run, strict=True)
    }
    return seconds, inside_ids


def as_text(rows: list[dict[str, Any]]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    text = ", ".join(f"{times:g} at {tolerance.name}" for tolerance, times in TOLERANCES.items())
    lines = [
        f"volumes with a formula, processor ms a frame; times a numpy script (to reach: {text}):",
        f"  {'scene':24}{'stepping':>9}{'script':>9}"
        + "".join(f"{tolerance.name:>10}{'times':>7}" for tolerance in TOLERANCES)
        + "   inside  other answers",
    ]
    for row in rows:
        times = "".join(
            f"{row[tolerance.name]:10.2f}{row['script'] / row[tolerance.name]:7.1f}"
            for tolerance in TOLERANCES
        )
        name = f"{row['scene']} ({row['volumes']})"
        lines.append(
            f"  {name:24}{row['stepping']:9.2f}{row['script']:9.2f}{times}"
            f"{row['inside']:9}  {row['differs']}"
        )
    return "\n".join(lines)


def _bend(body: Any, rng: np.random.Generator, strength: float, frames: int) -> None:
    """Key random rotations of all bones at the first and the last frame."""
    for frame in (0, frames - 1):
        for bone in body.pose.bones:
            bone.rotation_mode = "XYZ"
            bone.rotation_euler = rng.normal(0.0, strength, 3)
            bone.keyframe_insert("rotation_euler", frame=frame)


def _point_near_body(rng: np.random.Generator) -> Any:
    return rng.uniform((-0.6, -0.25, 0.1), (0.6, 0.25, 1.8))


def _build_many(frames: int) -> None:
    """Build 200 volumes, half of them moving, around a bending body."""
    scene = empty_scene("Many", 24, frames / 24)
    rng = np.random.default_rng(11)
    _bend(bpy.context.object, rng, 0.25, frames)
    for k in range(200):
        size, position = float(rng.uniform(0.03, 0.4)), _point_near_body(rng)
        obj = volume(
            *(MODALITIES[k % 4], _SHAPES[k // 4 % 4], tuple(position)),
            radius=size / 2,
            height=1.7 * size,
            size=(size, 0.4 * size, 1.2 * size),
        )
        obj.rotation_euler, obj.scale = rng.uniform(0, 2 * pi, 3), rng.uniform(0.6, 1.5, 3)
        if k % 2:
            move(
                obj,
                [(0, tuple(position)), (frames - 1, tuple(position + rng.normal(0, 0.15, 3)))],
            )
    scene.frame_set(0)


def _build_rig(frames: int) -> None:
    """Build the walker of :mod:`export_cost` with five volumes moving along."""
    from ..demo import garage

    garage.build()
    (body,) = (obj for obj in bpy.data.objects if obj.hfx.role == "BODY")
    export_cost.add_volumes(body)
    bpy.context.scene.frame_end = frames - 1


def _build_sheared(frames: int) -> None:
    """Build ten turning volumes, half with falloff, under rotated, unevenly scaled parents."""
    scene = empty_scene("Sheared", 24, frames / 24)
    rng = np.random.default_rng(21)
    _bend(bpy.context.object, rng, 0.3, frames)
    for k in range(10):
        obj = volume(
            *(MODALITIES[k % 4], _SHAPES[k % 4], (0.0, 0.0, 0.0)),
            radius=0.12,
            height=0.5,
            size=(0.2, 0.3, 0.3),
        )
        obj.rotation_euler = rng.uniform(0, 6, 3)
        if k % 2:
            obj.hfx.falloff, obj.hfx.falloff_share = "smooth", 0.6
        for position in ((0.0, 0.0, 0.0), _point_near_body(rng)):
            parent = bpy.data.objects.new("Parent", None)
            scene.collection.objects.link(parent)
            parent.scale = rng.uniform(0.3, 2.5, 3) * rng.choice([-1, 1], 3)
            parent.location, parent.rotation_euler = position, rng.uniform(0, 6, 3)
            child = obj if obj.parent is None else obj.parent
            child.parent = parent
        for frame in (0, frames - 1):
            obj.parent.rotation_euler = rng.uniform(0, 6, 3)
            obj.parent.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_set(0)


_SCENES: Final = {
    "many volumes": _build_many,
    "rig": _build_rig,
    "sheared, turning": _build_sheared,
}
