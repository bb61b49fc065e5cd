# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies in distorted poses, moving and turning, with flying, turning and changing volumes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from distorted_scenes import FALLOFFS, DistortedScene, turn

from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.modality import MODALITIES
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

ROWS = 6
SHAPES = (Cuboid(), Sphere(), Cylinder(), Capsule(1.5))


def moving_scene(
    model: PerceptualModel, seed: int, strength: float, speed: float
) -> tuple[SceneDescription, AnimationBlock]:
    """Return a body moving between two distorted poses, and flying, turning volumes."""
    rng = np.random.default_rng(seed)
    ends = [DistortedScene.drawn(model, seed + k, strength) for k in range(2)]
    shares = np.linspace(0.0, speed, ROWS)[:, None, None, None]
    bones = (1.0 - shares) * ends[0].bones + shares * ends[1].bones
    to_world = np.repeat(ends[0].to_world[None], ROWS, 0)
    if rng.random() < 0.5:  # the body turns and moves
        for k in range(ROWS):
            to_world[k, :3, :3] = turn(np.random.default_rng(seed), 0.05 * k) @ to_world[k, :3, :3]
            to_world[k, :3, 3] += 0.02 * k
    effects, blocks = [], []
    count = len(MODALITIES[model.modality].parameters)
    for k, (falloff, volume) in enumerate(zip(FALLOFFS, ends[0].volumes, strict=True)):
        flight, spin = 0.3 * speed * rng.normal(size=3), 0.4 * speed * float(rng.random() < 0.5)
        axis = int(rng.integers(1 << 31))
        matrices = np.repeat(volume.grown(0.0)[1][None], ROWS, 0)
        matrices[:, :3, :3] *= np.exp(0.5 * rng.normal(size=3))
        for row in range(ROWS):
            about = turn(np.random.default_rng(axis), spin * row)
            matrices[row, :3, :3] = about @ matrices[row, :3, :3]
            matrices[row, :3, 3] += row * flight
        which = rng.integers(len(SHAPES), size=ROWS) if k % 2 else np.full(ROWS, k // 2)
        levels, parameters = np.ones(ROWS), np.full((ROWS, count), 20.0)
        blocks.append(EffectBlock(levels, parameters, matrices, SHAPES, which))
        area = HapticVolume(falloff)
        effects.append(EffectDescription(f"v{k}", f"v{k}", model.modality, model.id, area))
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, 199)
    body = BodyDescription("anna", "Anna", SkinBinding(model.bone_names))
    scene = SceneDescription(time, (body,), tuple(effects))
    poses = (PoseBlock(np.ones(ROWS, bool), to_world, bones),)
    return scene, AnimationBlock(np.arange(ROWS), tuple(blocks), poses)
