# SPDX-License-Identifier: GPL-3.0-or-later
"""Random bodies with turning, stretching and mirroring bones, and random volumes."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np

from hfx_blender.engine.body.levels_and_cells import cell_of_skin
from hfx_blender.engine.body.model import PerceptualModel, load_model, load_skeleton
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.modality import MODALITIES
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
from hfx_blender.engine.tolerance import EXACT, PREVIEW, STANDARD, Tolerance, parse
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Sphere
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape

FALLOFFS = (
    Falloff(),
    Falloff(FalloffKind.LINEAR, 1.0),
    Falloff(FalloffKind.SMOOTH, 1.0),
    Falloff(FalloffKind.SMOOTH, 0.5),
    Falloff(FalloffKind.LINEAR, 0.3),
)

load = lru_cache(maxsize=8)(load_model)


def turn(rng: np.random.Generator, angle: float) -> np.ndarray:
    """Return a rotation by an angle about a random axis, (3, 3)."""
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


@dataclass(frozen=True)
class Volume:
    """Shape with a surface offset outwards on demand."""

    kind: str
    size_m: float
    place: np.ndarray
    turned: np.ndarray

    def grown(self, by_m: float) -> tuple[Shape, np.ndarray]:
        """Return the shape and the matrix; a size of at least 1e-9 m when shrunk away."""
        radius = max(self.size_m + by_m, 1e-9)
        shape, scale = Sphere(), np.full(3, radius)
        if self.kind == "cuboid":
            shape = Cuboid()
            scale = np.maximum(self.size_m * np.array([1.0, 0.5, 2.0]) + by_m, 1e-9)
        elif self.kind == "capsule":
            shape = Capsule(2.0 * self.size_m / radius)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.turned * scale, self.place
        return shape, matrix


@dataclass(frozen=True, eq=False)
class DistortedScene:
    """Body in one pose, and a volume for each kind of falloff."""

    model: PerceptualModel
    bones: np.ndarray  # (B, 3, 4)
    to_world: np.ndarray  # (4, 4)
    volumes: tuple[Volume, ...]

    @classmethod
    def drawn(cls, model: PerceptualModel, seed: int, strength: float) -> DistortedScene:
        """Draw a scene with bones turned by about ``strength`` rad and stretched by exp(0.4
        ``strength``).
        """
        rng = np.random.default_rng(seed)
        names, weights = model.bone_names, model.weights
        owners = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
        whole = np.maximum(np.bincount(weights.bones, weights.values, len(names)), 1e-9)
        bones = np.zeros((len(names), 3, 4))
        for bone in range(len(names)):
            mine = weights.bones == bone
            middle = weights.values[mine] @ model.vertices[owners[mine]] / whole[bone]
            linear = turn(rng, strength * rng.normal())
            linear = linear * np.exp(0.4 * strength * rng.normal(size=3))
            if rng.random() < 0.1 * strength:
                linear[:, 0] *= -1.0
            moved = middle + 0.03 * strength * rng.normal(size=3)
            bones[bone, :, :3], bones[bone, :, 3] = linear, moved - linear @ middle
        to_world = np.eye(4)
        to_world[:3, :3] = turn(rng, rng.uniform(0.0, np.pi)) * np.exp(0.3 * rng.normal())
        to_world[:3, 3] = rng.normal(size=3)
        return cls(model, bones, to_world, _volumes(model, bones, to_world, rng, (0.02, 2.0), 0.6))

    @classmethod
    def turned(cls, model: PerceptualModel, seed: int, strength: float) -> DistortedScene:
        """Draw a scene with bones turned at the joints by about ``strength`` radians, as in human
        poses.
        """
        rng = np.random.default_rng(seed)
        skeleton = load_skeleton()
        rest = skeleton.rest.astype(float)
        placed = np.zeros_like(rest)
        for bone, parent in enumerate(skeleton.parents.tolist()):
            turned = np.eye(4)
            turned[:3, :3] = turn(rng, strength * rng.normal())
            moved = placed[parent] @ np.linalg.inv(rest[parent]) if parent >= 0 else np.eye(4)
            placed[bone] = moved @ rest[bone] @ turned
        moves = (placed @ np.linalg.inv(rest))[:, :3]
        bones = moves[[skeleton.bone_names.index(name) for name in model.bone_names]]
        return cls(
            model, bones, np.eye(4), _volumes(model, bones, np.eye(4), rng, (0.01, 0.6), 0.5)
        )

    def felt(
        self, tolerance: Tolerance, grown_m: float = 0.0, which: np.ndarray | None = None
    ) -> np.ndarray:
        """Return weights by volume and vertex, with all volumes grown; zero outside ``which``."""
        weights = np.zeros((len(FALLOFFS), len(self.model)))
        for run in self.runs(tolerance, grown_m, which):
            for sample in run:
                weights[int(run.stream.effect_id[1:]), sample.vertices] = sample.weights
        return weights

    def runs(
        self, tolerance: Tolerance, grown_m: float = 0.0, which: np.ndarray | None = None
    ) -> list[SampleRun]:
        """Return the runs behind :meth:`felt`."""
        on = np.ones(len(FALLOFFS)) if which is None else which.astype(float)
        pose = PoseBlock(np.ones(1, bool), self.to_world[None], self.bones[None])
        placed = [volume.grown(grown_m) for volume in self.volumes]
        count = len(MODALITIES[self.model.modality].parameters)
        blocks = tuple(
            EffectBlock(on[k : k + 1], np.full((1, count), 20.0), matrix[None], (shape,))
            for k, (shape, matrix) in enumerate(placed)
        )
        engine = _engine(self.model, tolerance)
        return engine.evaluate(AnimationBlock(np.zeros(1, np.int64), blocks, (pose,)))

    def edges_m(self, tolerance: Tolerance) -> np.ndarray:
        """Accepted error of a contact's edge at each vertex, world, (V,).

        Vertex distances are measured in the pose; distances on skin are stretched by bones.
        """
        return np.minimum(
            tolerance.spacing_share * self._spacings_m, tolerance.distance_m * self._stretches
        )

    @cached_property
    def _skin(self) -> tuple[PerceptualModel, np.ndarray]:
        """Return the model of the surface cells, and the cell of each vertex."""
        if self.model.modality != "temperature":
            return self.model, np.arange(len(self.model))
        name, owner = cell_of_skin(self.model)
        assert load(name).bone_names == self.model.bone_names
        return load(name), owner

    @cached_property
    def _spacings_m(self) -> np.ndarray:
        """Distance from each vertex to the farthest neighbour or skin vertex of the cell, (V,)."""
        skin, owner = self._skin
        posed = _posed(self.model, self.bones, self.to_world, np.arange(len(self.model)))
        ends = self.model.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        spacings = np.zeros(len(self.model))
        own = _posed(skin, self.bones, self.to_world, np.arange(len(skin)))
        np.maximum.at(spacings, owner, np.linalg.norm(own - posed[owner], axis=1))
        lengths = np.linalg.norm(posed[ends[:, 0]] - posed[ends[:, 1]], axis=1)
        for end in ends.T:
            np.maximum.at(spacings, end, lengths)
        return spacings

    @cached_property
    def _stretches(self) -> np.ndarray:
        """Greatest stretch of the skin of each vertex by bones, over the cell, (V,)."""
        skin, owner = self._skin
        of_bones = np.linalg.norm(self.to_world[:3, :3] @ self.bones[:, :, :3], 2, axis=(1, 2))
        entries = np.repeat(np.arange(len(skin)), np.diff(skin.weights.offsets))
        mean = np.bincount(entries, skin.weights.values * of_bones[skin.weights.bones])
        stretches = np.zeros(len(self.model))
        np.maximum.at(stretches, owner, mean)
        return stretches


def excess(scene: DistortedScene, tolerance: Tolerance, exact: np.ndarray) -> float:
    """Return the excess over the stated tolerance, as a share of full strength; 0 if none.

    ``exact`` has the weights of the exact reference. A difference beyond the accepted share of
    strength is allowed between exact weights of volumes smaller and larger by the accepted
    distance.
    """
    actual = scene.felt(tolerance)
    wrong = np.abs(actual - exact) > tolerance.amplitude
    edges = scene.edges_m(tolerance)
    worst = 0.0
    while wrong.any():
        suspects = np.sort(edges[wrong.any(axis=0)])
        edge_m = float(suspects[3 * len(suspects) // 4])
        mine = wrong & (edges <= edge_m)
        which = mine.any(axis=1)
        smaller, larger = (scene.felt(EXACT, grown, which) for grown in (-edge_m, edge_m))
        off = np.maximum(smaller - actual, actual - larger)[mine] - tolerance.amplitude
        worst = max(worst, float(off.max()))
        wrong &= edges > edge_m
    return worst


@dataclass(frozen=True)
class Case:
    """Random scene and tolerance by seed."""

    seed: int
    modality: str
    is_distorted: bool
    strength: float
    tolerance: Tolerance

    @classmethod
    def of(cls, seed: int) -> Case:
        rng = np.random.default_rng(seed)
        modality = str(rng.choice(["temperature", "pressure", "vibration"]))
        is_distorted = bool(rng.random() < 0.5)
        strength = rng.uniform(0.0, 1.2 if is_distorted else 0.5)
        distance_mm, share = np.exp(rng.uniform(np.log([0.5, 0.5]), np.log([30.0, 20.0])))
        own = parse(f"{distance_mm:.2f}mm,10ms,{share:.2f}%")
        tolerance = (PREVIEW, STANDARD, own, own)[rng.integers(4)]
        return cls(seed, modality, is_distorted, float(strength), tolerance)

    @property
    def excess(self) -> float:
        """Return the excess of this case; see :func:`excess`."""
        make = DistortedScene.drawn if self.is_distorted else DistortedScene.turned
        scene = make(load(f"hfx-{self.modality}-1"), self.seed, self.strength)
        return excess(scene, self.tolerance, scene.felt(EXACT))


def _volumes(
    model: PerceptualModel,
    bones: np.ndarray,
    to_world: np.ndarray,
    rng: np.random.Generator,
    sizes_m: tuple[float, float],
    away: float,
) -> tuple[Volume, ...]:
    """Return volumes with centres at a share of the size away from a vertex."""
    volumes = []
    for _ in FALLOFFS:
        size_m = float(np.exp(rng.uniform(*np.log(sizes_m))))
        kind = str(rng.choice(["sphere", "cuboid", "capsule"]))
        vertex = rng.integers(len(model))
        point_m = _posed(model, bones, to_world, np.array([vertex]))[0]
        point_m = point_m + away * size_m * rng.normal(size=3)
        volumes.append(Volume(kind, size_m, point_m, turn(rng, rng.uniform(0.0, np.pi))))
    return tuple(volumes)


@lru_cache(maxsize=16)
def _engine(model: PerceptualModel, tolerance: Tolerance) -> Engine:
    effects = tuple(
        EffectDescription(f"v{k}", f"v{k}", model.modality, model.id, HapticVolume(falloff))
        for k, falloff in enumerate(FALLOFFS)
    )
    body = BodyDescription("anna", "Anna", SkinBinding(model.bone_names))
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, 199)
    return Engine(SceneDescription(time, (body,), effects), models=load, tolerance=tolerance)


def _posed(
    model: PerceptualModel, bones: np.ndarray, to_world: np.ndarray, vertices: np.ndarray
) -> np.ndarray:
    """Return world positions of some vertices, (n, 3)."""
    weights = model.weights
    posed = np.zeros((len(model), 3))
    owners = np.repeat(np.arange(len(model)), np.diff(weights.offsets))
    is_owner = np.isin(owners, vertices)
    owners, values = owners[is_owner], weights.values[is_owner].astype(float)
    matrices = bones[weights.bones[is_owner]]
    moved = np.einsum("eij,ej->ei", matrices[..., :3], model.vertices[owners]) + matrices[..., 3]
    np.add.at(posed, owners, values[:, None] * moved)
    posed /= np.maximum(np.bincount(owners, values, len(model)), 1e-9)[:, None]
    return posed[vertices] @ to_world[:3, :3].T + to_world[:3, 3]
