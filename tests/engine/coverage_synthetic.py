# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin with a covered area known by hand, and scenes of one volume on the skin."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from engine_synthetic import BONES, model

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import STANDARD, Tolerance
from hfx_blender.engine.volume.shape import Falloff, Shape

SIDE_M = 0.3


def _skin(vertices: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> PerceptualModel:
    count = len(vertices)
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    thirds = np.repeat(np.linalg.norm(cross, axis=1) / 6.0, 3)
    one_bone = SkinWeights(
        np.arange(count + 1, dtype=np.int32),
        np.zeros(count, np.int32),
        np.ones(count, np.float32),
    )
    return replace(
        model(count),
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.int32),
        normals=normals.astype(np.float32),
        areas_m2=np.bincount(triangles.ravel(), thirds, count).astype(np.float32),
        part=np.zeros(count, np.uint8),
        side=np.zeros(count, np.uint8),
        weights=one_bone,
    )


def sheet(steps: int = 12) -> PerceptualModel:
    """Return a flat square of skin in the plane z = 0, facing up."""
    ticks = np.linspace(-SIDE_M / 2, SIDE_M / 2, steps + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    at = np.arange((steps + 1) ** 2).reshape(steps + 1, -1)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return _skin(vertices, triangles, np.tile([0.0, 0.0, 1.0], (x.size, 1)))


def ball(radius_m: float = 0.1, rounds: int = 3) -> PerceptualModel:
    """Return a sphere of skin about the origin: a subdivided icosahedron."""
    g = (1 + 5**0.5) / 2
    points = np.array([[s, t * g, 0.0] for s in (-1, 1) for t in (-1, 1)])
    points = np.concatenate([points, np.roll(points, 1, 1), np.roll(points, 2, 1)])
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.abs(gaps - 2.0) < 1e-6
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i)
        for k in range(j)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    corners = points[np.array(faces)]
    for _ in range(rounds):
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
        corners = corners / np.linalg.norm(corners, axis=2, keepdims=True)
    out = np.einsum("fi,fi->f", np.cross(corners[:, 1], corners[:, 2]), corners[:, 0]) < 0
    corners[out] = corners[out][:, ::-1]
    unit, triangles = np.unique(np.round(corners.reshape(-1, 3), 9), axis=0, return_inverse=True)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return _skin(radius_m * unit, triangles.reshape(-1, 3), unit)


def rigid(times: int, to_world: np.ndarray | None = None) -> PoseBlock:
    """Return poses of a rigid body; ``to_world`` (4, 4) or (T, 4, 4)."""
    matrices = np.broadcast_to(np.eye(4) if to_world is None else to_world, (times, 4, 4))
    bones = np.tile(np.eye(4)[:3], (times, len(BONES), 1, 1))
    return PoseBlock(np.ones(times, bool), matrices.copy(), bones)


def evaluated(
    body: PerceptualModel,
    shape: Shape,
    matrices: np.ndarray,
    *,
    tolerance: Tolerance = STANDARD,
    falloff: Falloff | None = None,
    posed: PoseBlock | None = None,
    rate_hz: int = 100,
    bones: tuple[str, ...] = BONES,
    cuts: tuple[int, ...] = (),
    levels: np.ndarray | None = None,
    **options: Any,
) -> tuple[np.ndarray, list[SampleRun], Engine]:
    """Evaluate one volume against one body: weights (T, V), the runs, the engine.

    ``cuts`` split time into blocks, each with the row before as history.
    """
    times = len(matrices)
    count = 2 if body.modality == "vibration" else 1
    effect = EffectDescription(
        "e", "Effect", body.modality, body.id, HapticVolume(falloff or Falloff())
    )
    scene = SceneDescription(
        TimeBase(Fraction(rate_hz), Fraction(rate_hz), 0, 0, max(times, 1000)),
        (BodyDescription("b", "Body", SkinBinding(bones)),),
        (effect,),
    )
    options.setdefault("models", {body.id: body}.__getitem__)
    engine = Engine(scene, tolerance=tolerance, **options)
    posed = rigid(times) if posed is None else posed
    levels = np.ones(times) if levels is None else levels
    weights, runs = np.zeros((times, len(body))), []
    for begin, end in zip((0, *cuts), (*cuts, times), strict=True):
        history = int(begin > 0)
        part = slice(begin - history, end)
        animated = EffectBlock(
            levels[part], np.ones((times, count))[part], matrices[part], (shape,)
        )
        assert posed.bones is not None
        pose = PoseBlock(posed.valid[part], posed.to_world[part], posed.bones[part])
        block = AnimationBlock(np.arange(times)[part], (animated,), (pose,), history)
        for run in engine.evaluate(block):
            runs.append(run)
            for index, sample in zip(run.indices.tolist(), run, strict=True):
                assert begin <= index < end
                assert (np.diff(sample.vertices) > 0).all()
                weights[index, sample.vertices] = sample.weights
    assert ((weights >= 0.0) & (weights <= 1.0)).all()
    return weights, runs, engine


def placed(scale: Any, at: Any, turn: np.ndarray | None = None) -> np.ndarray:
    """Return a placing matrix, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if turn is None else turn) * np.broadcast_to(scale, 3)
    matrix[:3, 3] = at
    return matrix


def moved_along(matrix: np.ndarray, way: Any, times: int) -> np.ndarray:
    """Return the matrix at equal steps from the start to ``way`` further, (T, 4, 4)."""
    matrices = np.repeat(matrix[None], times, axis=0)
    matrices[:, :3, 3] += np.linspace(0.0, 1.0, times)[:, None] * np.asarray(way, float)
    return matrices
