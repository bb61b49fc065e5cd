# SPDX-License-Identifier: GPL-3.0-or-later
"""Walking avatars among volumes of all kinds, as a scene for both engine and core."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.body.model import load_model, load_skeleton
from hfx_blender.engine.response_filters.controls import (
    CONTROLS,
    WIDTH,
    About,
    Filter,
    FilterKind,
    Operation,
)
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
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape
from hfx_tools.body_building.walk_cycle import load_walk

F64 = npt.NDArray[np.float64]
RATE_HZ = 90
_SHAPES: tuple[Shape, ...] = (Cuboid(), Sphere(), Cylinder(), Capsule(1.5))
_FALLOFFS = (
    Falloff(),
    Falloff(FalloffKind.LINEAR, 0.6),
    Falloff(FalloffKind.SMOOTH, 1.0),
)
_PARAMETERS = {
    "vibration": [12.0, 80.0],
    "pressure": [8.0],
    "temperature": [50.0],
    "wind": [6.0, 0.0, -1.0, 0.0],
}


def stage(
    kind: FilterKind, operation: Operation, *values: float, about: About = About.CENTRE
) -> tuple[Filter, F64]:
    """Return a filter and the controls; missing values get defaults."""
    controls = np.zeros(WIDTH)
    for k, control in enumerate(CONTROLS[kind]):
        controls[k] = values[k] if k < len(values) else control.default
    rings_s = 1.5 if kind is FilterKind.IMPACT else 0.0
    return Filter(kind, operation, about, rings_s), controls


RESPONSES: tuple[tuple[tuple[Filter, F64], ...], ...] = (
    (),
    (
        stage(FilterKind.IMPACT, Operation.MULTIPLY, 1.0, 0.0, 0.15, 0.5),
        stage(FilterKind.PROXIMITY, Operation.MAXIMUM, 0.3, 0.12, 1.5),
    ),
    (
        stage(FilterKind.SPEED, Operation.MULTIPLY, 0.8, 0.1, 1.2),
        stage(FilterKind.DISTANCE, Operation.MULTIPLY, 1.0, 0.0, 0.4),
        stage(FilterKind.SINE, Operation.MULTIPLY, 0.7, 3.0, 0.8, 0.2, about=About.TIME),
    ),
    (
        stage(FilterKind.IMPACT, Operation.ADD, 0.9, 0.03, 0.1, 0.7),
        stage(FilterKind.SINE, Operation.MULTIPLY, 0.6, 0.11, 0.9, about=About.AXIS),
    ),
)


@dataclass(frozen=True, eq=False)
class Walk:
    """A walking body among volumes."""

    scene: SceneDescription
    block: AnimationBlock
    matrices: F64  # (T, B, 3, 4) rest space to world


def walk(seed: int, seconds: float, volumes: int = 12, *, responds: bool = False) -> Walk:
    """Return a body of random size on a random walk through volumes, by seed."""
    random = np.random.default_rng(seed)
    count = int(seconds * RATE_HZ)
    time = TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 0, 0, count - 1)
    bones = _cycle(count, random.random())
    to_world = _way(count, random)
    effects, blocks = [], []
    for k in range(volumes):
        effect, block = _volume(k, count, to_world, random, responds)
        effects.append(effect)
        blocks.append(block)
    binding = SkinBinding(load_skeleton().bone_names)
    scene = SceneDescription(time, (BodyDescription("b", "Walker", binding),), tuple(effects))
    pose = PoseBlock(np.ones(count, np.bool_), to_world, bones)
    world = np.einsum("tij,tbjk->tbik", to_world[:, :3, :3], bones)
    world[..., 3] += to_world[:, None, :3, 3]
    return Walk(scene, AnimationBlock(np.arange(count), tuple(blocks), (pose,)), world)


def _volume(
    k: int, count: int, to_world: F64, random: np.random.Generator, responds: bool
) -> tuple[EffectDescription, EffectBlock]:
    """Return a volume moving around the body, or standing in the way."""
    modality = tuple(_PARAMETERS)[k % 4]
    model = load_model(f"hfx-{'pressure' if modality == 'wind' else modality}-1")
    shape = _SHAPES[k // 4 % 4]
    linear = np.linalg.qr(random.normal(size=(3, 3)))[0] * random.uniform(0.08, 0.45, 3)
    if isinstance(shape, Capsule):
        linear = linear / np.linalg.norm(linear, axis=0) * random.uniform(0.08, 0.25)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = linear
    swing = np.sin(np.arange(count)[:, None] / RATE_HZ * random.uniform(0.5, 3.0, 3))
    local = random.uniform([-0.5, -0.4, 0.2], [0.5, 0.4, 1.6]) + 0.4 * swing
    matrices[:, :3, 3] = np.einsum("tij,tj->ti", to_world[:, :3, :3], local) + to_world[:, :3, 3]
    if k % 3 == 0:
        matrices[:, :3, 3] = matrices[count // 2, :3, 3]
    response = RESPONSES[k % len(RESPONSES)] if responds else ()
    area = HapticVolume(_FALLOFFS[k % 3], tuple(item for item, _ in response))
    controls = np.array([values for _, values in response]).reshape(len(response), WIDTH)
    effect = EffectDescription(f"e{k}", f"Volume {k}", modality, model.id, area)
    block = EffectBlock(
        np.full(count, random.uniform(0.5, 1.0)),
        np.tile(_PARAMETERS[modality], (count, 1)),
        matrices,
        (shape,),
        response=np.tile(controls, (count, 1, 1)) if response else None,
    )
    return effect, block


def bouncing(
    hits: tuple[tuple[float, float, float], ...],
    filters: tuple[tuple[Filter, F64], ...],
    *,
    radius_m: float = 0.03,
    count: int = 70,
) -> Walk:
    """Return a still body hit on the belly by a ball: (time, height, depth) per bounce, at 1 m/s.

    Without falloff, every vertex reached has full strength.
    """
    model = load_model("hfx-vibration-1")
    times = np.arange(count) / RATE_HZ
    matrices = np.tile(np.diag([radius_m] * 3 + [1.0]), (count, 1, 1))
    nearest = np.abs(times[:, None] - [time_s for time_s, _, _ in hits]).argmin(axis=1)
    for k, (time_s, z, depth_m) in enumerate(hits):
        belly = (np.abs(model.vertices[:, 0]) < 0.01) & (np.abs(model.vertices[:, 2] - z) < 0.012)
        skin = float(model.vertices[belly, 1].min())
        rows = nearest == k
        away = np.abs(times[rows] - time_s) - depth_m
        matrices[rows, 1, 3], matrices[rows, 2, 3] = skin - radius_m - away, z
    area = HapticVolume(Falloff(), tuple(item for item, _ in filters))
    effect = EffectDescription("ball", "Ball", "vibration", model.id, area)
    response = np.tile(np.array([values for _, values in filters]), (count, 1, 1))
    animated = EffectBlock(
        np.ones(count),
        np.tile(_PARAMETERS["vibration"], (count, 1)),
        matrices,
        (Sphere(),),
        response=response,
    )
    names = load_skeleton().bone_names
    still = np.tile(np.eye(4)[:3], (count, len(names), 1, 1))
    pose = PoseBlock(np.ones(count, np.bool_), np.tile(np.eye(4), (count, 1, 1)), still)
    scene = SceneDescription(
        TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 0, 0, count - 1),
        (BodyDescription("b", "Anna", SkinBinding(names)),),
        (effect,),
    )
    return Walk(scene, AnimationBlock(np.arange(count), (animated,), (pose,)), still)


def _way(count: int, random: np.random.Generator) -> F64:
    """Return placements of a body of random size walking a curve, (T, 4, 4)."""
    scale, bend = random.uniform(0.7, 1.2), random.uniform(-0.6, 0.6)
    heading = random.uniform(0.0, 6.3) + bend * np.arange(count) / RATE_HZ
    step = 1.1 * scale / RATE_HZ * np.column_stack([np.sin(heading), -np.cos(heading)])
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(heading)
    matrices[:, 1, 0], matrices[:, 0, 1] = np.sin(heading), -np.sin(heading)
    matrices[:, :3, :3] *= scale
    matrices[:, :2, 3] = np.cumsum(step, axis=0) + random.uniform(-2.0, 2.0, 2)
    return matrices


def _cycle(count: int, phase: float) -> F64:
    """Return bones of the walk cycle, rest space to posed armature space, (T, B, 3, 4)."""
    skeleton, cycle = load_skeleton(), load_walk()
    rest = skeleton.rest.astype(np.float64)
    at = (np.arange(count) / RATE_HZ * cycle.rate_hz + phase * len(cycle.rotations)) % len(
        cycle.rotations
    )
    turns = {name: k for k, name in enumerate(cycle.bone_names)}
    posed = np.zeros((count, len(rest), 4, 4))
    for k, name in enumerate(skeleton.bone_names):
        parent = int(skeleton.parents[k])
        above = posed[:, parent] @ np.linalg.inv(rest[parent]) if parent >= 0 else np.eye(4)[None]
        own = np.tile(np.eye(4), (count, 1, 1))
        if name in turns:
            own[:, :3, :3] = _turned(cycle.rotations[:, turns[name]].astype(np.float64), at)
        posed[:, k] = above @ rest[k] @ own
    return np.asarray((posed @ np.linalg.inv(rest))[:, :, :3])


def _turned(rotations: F64, at: F64) -> F64:
    """Return rotation matrices (T, 3, 3) of a cycle of quaternions (w, x, y, z) at some phases."""
    low = at.astype(int)
    share = (at - low)[:, None]
    first, second = rotations[low], rotations[(low + 1) % len(rotations)]
    second = np.where((first * second).sum(axis=1, keepdims=True) < 0.0, -second, second)
    w, x, y, z = (q := (1 - share) * first + share * second).T / np.linalg.norm(q, axis=1)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
