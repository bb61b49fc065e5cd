# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of arbitrary points, one volume, the engine's result, and exact answers in fractions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

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
    SurfaceBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import Falloff, Shape

SHAPES: dict[str, Shape] = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "capsule": Capsule(0.75),
}
TIME = TimeBase(Fraction(24), Fraction(100), 1, 1, 48)


def body_of(
    points: np.ndarray,
    bone_names: tuple[str, ...] = ("root",),
    weights: SkinWeights | None = None,
) -> PerceptualModel:
    """Return a model of these vertices (V, 3), by default weighted to the first bone."""
    count = len(points)
    if weights is None:
        weights = SkinWeights(
            np.arange(count + 1, dtype=np.int32),
            np.zeros(count, np.int32),
            np.ones(count, np.float32),
        )
    nothing: dict[str, Any] = {
        "triangles": np.zeros((0, 3), np.int32),
        "normals": np.tile(np.array([0, 0, 1], np.float32), (count, 1)),
        "areas_m2": np.full(count, 1e-4, np.float32),
        "part": np.zeros(count, np.uint8),
        "side": np.zeros(count, np.uint8),
        "mirror": np.arange(count, dtype=np.int32),
        "avatar_vertices": np.zeros((count, 3), np.int32),
        "avatar_weights": np.zeros((count, 3), np.float32),
        "avatar_offset_m": np.zeros(count, np.float32),
        "provenance": {},
    }
    return PerceptualModel(
        id="extreme",
        modality="pressure",
        vertices=np.asarray(points, np.float32),
        bone_names=bone_names,
        weights=weights,
        **nothing,
    )


def person(rng: np.random.Generator, count: int = 250) -> PerceptualModel:
    """Return points in a box of the size of a person."""
    return body_of(rng.uniform((-0.3, -0.15, 0.0), (0.3, 0.15, 1.8), (count, 3)))


def still(times: int, bones: int = 1) -> PoseBlock:
    """Return poses of a body at rest at the origin."""
    return PoseBlock(
        np.ones(times, bool),
        np.tile(np.eye(4), (times, 1, 1)),
        np.tile(np.eye(4)[:3], (times, bones, 1, 1)),
    )


def volume(
    matrices: np.ndarray, shape: Shape, levels: float = 1.0, values: float = 5.0
) -> EffectBlock:
    """Return a block of a pressure volume with these matrices, (T, 4, 4)."""
    count = len(matrices)
    return EffectBlock(
        np.full(count, levels), np.full((count, 1), values), np.array(matrices), (shape,)
    )


@dataclass
class Felt:
    """Results of the engine: weights of every vertex at every time, and warnings."""

    weights: np.ndarray  # (effects, T, V)
    warnings: dict[str, int]
    runs: list[SampleRun]
    engine: Engine


def feel(
    model: PerceptualModel,
    effects: EffectBlock | list[EffectBlock],
    pose: PoseBlock | None = None,
    *,
    falloff: Falloff | None = None,
    time: TimeBase = TIME,
    binding: SkinBinding | SurfaceBinding | None = None,
    **options: Any,
) -> Felt:
    """Evaluate volumes against one body by vertices only, as in the paper."""
    binding = binding or SkinBinding(model.bone_names)
    effects = effects if isinstance(effects, list) else [effects]
    times = len(effects[0].levels)
    pose = still(times) if pose is None else pose
    described = tuple(
        EffectDescription(
            f"v{k}", f"v{k}", "pressure", model.id, HapticVolume(falloff or Falloff())
        )
        for k in range(len(effects))
    )
    scene = SceneDescription(time, (BodyDescription("anna", "Anna", binding),), described)
    options.setdefault("tolerance", PAPER)
    engine = Engine(scene, models=lambda _: model, **options)
    runs = engine.evaluate(AnimationBlock(np.arange(times), tuple(effects), (pose,)))
    weights = np.zeros((len(effects), times, len(model)))
    for run in runs:
        for index, sample in zip(run.indices, run, strict=True):
            assert np.isfinite(sample.weights).all() and np.isfinite(sample.parameters).all()
            assert 0.0 < sample.level <= 1.0
            weights[int(run.stream.effect_id[1:]), index, sample.vertices] = sample.weights
    return Felt(weights, engine.counters.warnings | engine.counters.flattened, runs, engine)


# Exact answers


Exact = list[Fraction]


def exact(values: Any) -> Any:
    """Return an array as nested lists of fractions, exact for floats."""
    if isinstance(values, np.ndarray):
        return exact(values.tolist())
    return [exact(v) for v in values] if isinstance(values, list) else Fraction(values)


def exact_inverse(matrix: np.ndarray) -> list[Exact]:
    """Return the exact inverse of an affine matrix by cofactors: 3 rows of 4."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = exact(matrix[:3])
    cofactors = [
        [e * i - f * h, c * h - b * i, b * f - c * e],
        [f * g - d * i, a * i - c * g, c * d - a * f],
        [d * h - e * g, b * g - a * h, a * e - b * d],
    ]
    determinant = a * cofactors[0][0] + b * cofactors[1][0] + c * cofactors[2][0]
    rows = [[value / determinant for value in row] for row in cofactors]
    return [[*row, -(row[0] * x + row[1] * y + row[2] * z)] for row in rows]


def exact_product(matrix: list[Exact], point: Exact) -> Exact:
    """Return an affine matrix (3 rows of 4) times a point."""
    x, y, z = point
    return [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix]


def exact_way(shape: Shape, point: Exact) -> Fraction:
    """Exact distance of a point of shape space past the boundary: below 0 inside, squared where
    round.

    Rational for every shape: roots are avoided by comparing squares.
    """
    x, y, z = (abs(value) for value in point)
    if isinstance(shape, Cuboid):
        return max(x, y, z) - 1
    if isinstance(shape, Sphere):
        return x * x + y * y + z * z - 1
    if isinstance(shape, Cylinder):
        return max(x * x + y * y, z * z) - 1
    assert isinstance(shape, Capsule)
    beyond = max(z - Fraction(shape.half_segment), Fraction(0))
    return x * x + y * y + beyond * beyond - 1


def exact_ways(
    shape: Shape, matrix: np.ndarray, to_world: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return :func:`exact_way` of rest-space points (V, 3) of a rigid body."""
    into, placed = exact_inverse(matrix), exact(to_world[:3])
    return np.array(
        [
            float(exact_way(shape, exact_product(into, exact_product(placed, point))))
            for point in exact(points.astype(np.float64))
        ]
    )


def moved(pose: PoseBlock, by: np.ndarray) -> PoseBlock:
    """Return poses moved by a matrix (4, 4)."""
    return replace(pose, to_world=by @ pose.to_world)
