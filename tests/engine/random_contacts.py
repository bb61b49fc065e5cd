# SPDX-License-Identifier: GPL-3.0-or-later
"""Small random scenes of one volume and one body, evaluated by the engine and the reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from coverage_synthetic import ball
from engine_synthetic import BONES

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.reference.boundary import nearest
from hfx_blender.engine.reference.cells import Skin
from hfx_blender.engine.reference.contact import Body, Contact, Volume, contact
from hfx_blender.engine.reference.pose import is_rotating, moved, world_points
from hfx_blender.engine.samples import Sample, SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    FittedModel,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SurfaceAnchors,
    SurfaceBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import EXACT, PAPER, Tolerance
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape

ROWS = 4
RATE_HZ = 100
STEPS = (8, 16, 4, 32, 2, 64, 1)
"""Numbers of straight steps that the engine may follow turning in."""

NEAR = 1e-5
"""Difference of weights, and of details as shares of the volume's size, that is none."""

_FALLOFFS = (
    Falloff(),
    Falloff(),
    Falloff(FalloffKind.LINEAR),
    Falloff(FalloffKind.SMOOTH),
    Falloff(FalloffKind.LINEAR, 0.3),
    Falloff(FalloffKind.SMOOTH, 0.6),
    Falloff(FalloffKind.SMOOTH, 0.0),
)
_RECORDS = (*[()] * 7, ("depth",), ("surface", "depth"), ("impact", "depth"))


@dataclass(frozen=True, eq=False)
class RandomContact:
    """Random scene by ``seed``, with the results of engine and reference."""

    seed: int
    asked: Tolerance | None = None  # instead of a random tolerance

    def _rng(self, part: int) -> np.random.Generator:
        """Return a random generator for one part of the scene, independent of order."""
        return np.random.default_rng([part, self.seed])

    def __str__(self) -> str:
        shapes = "+".join(type(shape).__name__ for shape in self.animated.shapes)
        binding = type(self.body.binding).__name__
        facts = self.falloff.kind.value, self.falloff.share, self.tolerance.name, self.record
        return f"seed {self.seed}: {shapes} on {binding}, {facts}"

    # The scene

    @cached_property
    def model(self) -> PerceptualModel:
        """Return bumpy skin of 12 or 42 vertices, 1 to 8 mm apart."""
        rng = self._rng(1)
        ball_model = ball(
            float(np.exp(rng.uniform(np.log(0.001), np.log(0.008)))), int(rng.integers(2))
        )
        bumps = 1.0 + 0.25 * np.sin(ball_model.vertices @ rng.normal(0.0, 200.0, (3, 4))).mean(
            axis=1
        )
        vertices = (ball_model.vertices * bumps[:, None] * rng.uniform(0.6, 1.4, 3)).astype(
            np.float32
        )
        triangles = ball_model.triangles[
            rng.random(len(ball_model.triangles)) < 0.9
        ]  # some are missing
        count = len(ball_model)
        sizes = rng.integers(0, 4, count) if rng.random() < 0.2 else rng.integers(1, 4, count)
        bones = np.concatenate([np.sort(rng.permutation(len(BONES))[:n]) for n in sizes])
        weights = SkinWeights(
            np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
            bones.astype(np.int32),
            rng.uniform(0.1, 1.0, len(bones)).astype(np.float32),
        )
        areas = (ball_model.areas_m2 * rng.uniform(0.3, 2.0, count)).astype(np.float32)
        return replace(
            ball_model, vertices=vertices, triangles=triangles, areas_m2=areas, weights=weights
        )

    @cached_property
    def body(self) -> BodyDescription:
        rng, model = self._rng(2), self.model
        kind = rng.choice(["bones", "bones", "fitted", "surface"])
        nothing = SurfaceAnchors(np.zeros((0, 3), np.int32), np.zeros((0, 3)), np.zeros(0))
        if kind == "surface":
            weights = rng.uniform(-0.2, 1.0, (len(model), 3))
            anchors = SurfaceAnchors(
                np.arange(3 * len(model), dtype=np.int32).reshape(-1, 3),
                weights / weights.sum(axis=1, keepdims=True),
                rng.normal(0.0, 0.001, len(model)),
            )
            return BodyDescription("b", "B", SurfaceBinding({model.id: anchors}, "drawn so"))
        fitted = {}
        if kind == "fitted":
            moved_a_bit = model.vertices * rng.uniform(0.7, 1.3, 3).astype(np.float32)
            fitted[model.id] = FittedModel(
                model.id, model.content_hash, moved_a_bit, BONES[::-1], model.weights, nothing
            )
        return BodyDescription("b", "B", SkinBinding((*BONES, "more"), fitted))

    @cached_property
    def pose(self) -> PoseBlock:
        rng, model = self._rng(3), self.model
        bend, still = rng.uniform(0.0, 0.3), rng.random() < 0.2
        to_world = np.stack([_placing(rng, 0.2 * bend) for _ in range(ROWS)])
        to_world[:, :3, 3] *= 0.02
        scale, far = np.exp(rng.uniform(-2.0, 2.0)), 10.0 ** rng.uniform(-3.0, 3.0)
        to_world = _placing(rng, 0.5, scale, far * rng.normal(size=3)) @ to_world
        if still:
            to_world[:] = to_world[0]
        if isinstance(self.body.binding, SkinBinding):
            bones = np.stack(
                [[_placing(rng, bend)[:3] for _ in range(len(BONES) + 1)] for _ in range(ROWS)]
            )
            bones[..., 3] *= 0.01
            return PoseBlock(np.ones(ROWS, bool), to_world, bones[[0] * ROWS] if still else bones)
        base = np.repeat(model.vertices, 3, axis=0)
        base = base + rng.normal(0.0, 0.002, base.shape)
        moves = np.stack([_placing(rng, bend) for _ in range(ROWS)])
        surface = np.einsum("tij,aj->tai", moves[:, :3, :3], base)
        surface = (surface + 0.003 * moves[:, None, :3, 3]).astype(np.float32)
        surface = surface[[0] * ROWS] if still else surface
        return PoseBlock(np.ones(ROWS, bool), to_world, None, surface)

    @cached_property
    def animated(self) -> EffectBlock:
        rng, model = self._rng(4), self.model
        shapes: list[Shape] = [
            *(Cuboid(), Sphere(), Cylinder(), Capsule(float(rng.uniform(0.0, 2.0)))),
            _star(rng, model),
        ]
        chosen = rng.permutation(len(shapes))[: 1 + (rng.random() < 0.2)]
        which = rng.integers(0, len(chosen), ROWS).astype(np.int32)
        points = [world_points(model, self.body.binding, self.pose, row) for row in range(ROWS)]
        size = np.linalg.norm(points[0].std(axis=1))
        turning = rng.choice([0.0, 0.0, 0.3, 1.5])
        matrices, base = [], _placing(rng, 0.6, size * np.exp(rng.uniform(-2.0, 0.7)))
        base[:3, :3] = base[:3, :3] * rng.uniform(0.1, 1.0, 3)
        if rng.random() < 0.2:
            base[:3, 0] *= -1.0
        fast = rng.choice([0.0, 0.3, 2.0])
        for row in range(ROWS):
            matrix = base.copy()
            matrix[:3, :3] = _turn(rng, turning * rng.normal()) @ base[:3, :3]
            target = points[row][:, rng.integers(len(model))] if fast else points[0][:, 0]
            matrix[:3, 3] = target + size * (0.2 + fast) * rng.normal(size=3) * bool(fast)
            matrices.append(matrix)
        levels = np.where(rng.random(ROWS) < 0.1, 0.0, 1.0)
        return EffectBlock(
            levels,
            np.ones((ROWS, 2)),
            np.stack(matrices),
            tuple(shapes[k] for k in chosen),
            which,
        )

    @cached_property
    def falloff(self) -> Falloff:
        return _FALLOFFS[self._rng(5).integers(len(_FALLOFFS))]

    @cached_property
    def tolerance(self) -> Tolerance:
        """Exact or the paper's tolerance, both defined by the reference."""
        if self.asked is not None:
            return self.asked
        return PAPER if self._rng(6).random() < 0.2 else EXACT

    @cached_property
    def record(self) -> tuple[str, ...]:
        return _RECORDS[self._rng(7).integers(len(_RECORDS))]

    @cached_property
    def indices(self) -> np.ndarray:
        """Sample indices, sometimes with a gap."""
        gap = self._rng(8).random() < 0.2
        return np.arange(ROWS) + (np.arange(ROWS) > 1) * gap

    # Results

    def runs(self) -> list[SampleRun]:
        """Return the engine's runs."""
        model, effect = self.model, HapticVolume(self.falloff)
        described = EffectDescription("e", "Effect", model.modality, model.id, effect)
        time = TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 0, 0, 99)
        engine = Engine(
            SceneDescription(time, (self.body,), (described,)),
            tolerance=self.tolerance,
            models={model.id: model}.__getitem__,
            record=self.record,
        )
        return engine.evaluate(AnimationBlock(self.indices, (self.animated,), (self.pose,)))

    def by_engine(self) -> dict[int, Sample]:
        """Return the samples by row."""
        return {
            int(np.searchsorted(self.indices, index)): sample
            for run in self.runs()
            for index, sample in zip(run.indices, run, strict=True)
        }

    def by_reference(self, row: int) -> Iterator[Contact]:
        """Yield contacts at one row, for each number of steps allowed between samples."""
        body = Body(Skin.of(self.model), self.body.binding, self.pose)
        if self.tolerance is PAPER:
            body = replace(body, fineness=None)
        before, steps = self.before(row), (1,)
        if before is not None:
            matrices, to_world = self.animated.matrices, self.pose.to_world
            is_turning = is_rotating(matrices[before], matrices[row])
            is_turning |= is_rotating(to_world[before], to_world[row])
            steps = STEPS if is_turning else steps
        volume, with_details = Volume(self.animated, self.falloff), bool(self.record)
        for step in steps:
            yield contact(body, volume, row, before, steps=step, with_details=with_details)

    def before(self, row: int) -> int | None:
        """Return the row at the start of the motion, or None for tests of vertices only."""
        if self.tolerance is PAPER or row == 0 or self.animated.levels[row - 1] == 0.0:
            return None
        return row - 1 if self.indices[row - 1] == self.indices[row] - 1 else None

    @cached_property
    def difference(self) -> float:
        """Return the largest difference of any weight or detail."""
        actual, most = self.by_engine(), 0.0
        for row in range(ROWS):
            sample = actual.get(row)
            if self.animated.levels[row] == 0.0:
                assert sample is None
                continue
            weights, apart = np.zeros(len(self.model)), np.full(len(self.model), np.inf)
            details = np.zeros(0)
            if sample is not None:
                weights[sample.vertices] = sample.weights
                details = np.full(len(sample.vertices), np.inf if self.record else 0.0)
            # Each cluster of vertices has its own number of steps.
            for samples in self.by_reference(row):
                mine = np.abs(weights - samples.weights)
                apart = np.minimum(apart, mine)
                if sample is not None and self.record:
                    near = np.flatnonzero(mine[sample.vertices] < NEAR)
                    differences = self._detail_differences(row, sample, near, samples)
                    details[near] = np.minimum(details[near], differences)
                if max(apart.max(), details.max(initial=0.0)) < NEAR:
                    break
            most = max(most, float(apart.max()), float(details.max(initial=0.0)))
        return most

    def _detail_differences(
        self, row: int, sample: Sample, which: np.ndarray, felt: Contact
    ) -> np.ndarray:
        """Return the largest difference of the details of each vertex; lengths as shares of the
        volume's size. ``which`` (n,) are places in the sample's vertices."""
        shape, matrix = (
            self.animated.shapes[self.animated.shape_index[row]],
            self.animated.matrices[row],
        )
        size = np.linalg.norm(matrix[:3, :3])
        vertices, depth_m = sample.vertices[which], sample.depth_m[which]
        depths = nearest(shape, felt.details.places[:, vertices], matrix)[2]
        apart = np.abs(depth_m - depths) / size
        if sample.surface is not None:
            # For several equally deep points, the engine may have chosen another.
            surface = sample.surface[which]
            inwards = sample.surface_normals[which] * depth_m[:, None]
            back = moved(np.linalg.inv(matrix), (surface - inwards).T.astype(float))
            rounding = 4e-7 * np.abs(sample.surface).max()  # float32
            away = np.abs(nearest(shape, back, matrix)[2] - depth_m)
            apart = np.maximum(apart, np.maximum(away - rounding, 0.0) / size)
        if sample.impact is not None:
            since, times_s = felt.details.since[vertices], sample.impact.times_s[which]
            began = ~np.isnan(since)
            apart[began != ~np.isnan(times_s)] = np.inf
            times = self.indices[row] / RATE_HZ + (since - 1.0) / RATE_HZ
            late = np.abs(times_s - times)[began] * RATE_HZ
            apart[began] = np.maximum(apart[began], late)
            if not isinstance(shape, MeshVolume):
                # At 0 the shape itself changed, so the first point inside is undefined.
                began = since > 0.0
                at = vertices[began]
                normals = _normals_at(shape, felt.details.entries[:, at], matrix)
                ways = matrix[:3, :3] @ felt.details.ways[:, at]
                speeds = np.maximum(-(ways * normals).sum(axis=0), 0.0) * RATE_HZ
                most = np.linalg.norm(ways, axis=0) * RATE_HZ
                off = np.abs(sample.impact.speeds_m_s[which][began] - speeds) / most
                apart[began] = np.maximum(apart[began], off)
        return apart


class StretchedContact(RandomContact):
    """Random contact with skin stretched up to six times by bones; bulges stretch as well."""

    @cached_property
    def pose(self) -> PoseBlock:
        pose_block = super().pose
        if pose_block.bones is None:
            return pose_block
        bones = pose_block.bones.copy()
        bones[..., :3] = bones[..., :3] * np.exp(self._rng(9).uniform(-0.3, 1.8, 3))
        return replace(pose_block, bones=bones)


def _placing(
    rng: np.random.Generator, spread: float, scale: float = 1.0, offset: object = None
) -> np.ndarray:
    """Return a random affine matrix near the identity, scaled, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (np.eye(3) + rng.normal(0.0, spread, (3, 3)))
    matrix[:3, 3] = rng.normal(0.0, spread, 3) if offset is None else offset
    return matrix


def _turn(rng: np.random.Generator, angle: float) -> np.ndarray:
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _star(rng: np.random.Generator, model: PerceptualModel) -> MeshVolume:
    """Return a closed, non-convex mesh: a dented ball of 80 triangles."""
    dented = ball(1.0, 1)
    dents = rng.uniform(0.4, 1.2, len(dented))
    return MeshVolume(dented.vertices.astype(float) * dents[:, None], dented.triangles, "star")


def _normals_at(shape: Shape, points: np.ndarray, to_world: np.ndarray) -> np.ndarray:
    """Return outward unit normals (3, N), world space, of a convex shape at boundary points."""
    directions = points.copy()
    if isinstance(shape, Cuboid):
        directions[np.abs(points) < np.abs(points).max(axis=0)] = 0.0
    elif isinstance(shape, Cylinder):
        is_cap = np.abs(points[2]) > np.hypot(points[0], points[1])
        directions[:2, is_cap] = 0.0
        directions[2, ~is_cap] = 0.0
    elif isinstance(shape, Capsule):
        directions[2] -= np.clip(points[2], -shape.half_segment, shape.half_segment)
    normals = np.linalg.inv(to_world[:3, :3]).T @ directions
    unit: np.ndarray = normals / np.linalg.norm(normals, axis=0)
    return unit
