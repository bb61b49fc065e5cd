# SPDX-License-Identifier: GPL-3.0-or-later
"""Small synthetic bodies for tests of the engine, and helpers for results."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.reference.pose import world_points
from hfx_blender.engine.scene import PoseBlock, SkinBinding

BONES = ("root", "arm", "leg", "tip")


def model(count: int = 900, seed: int = 1, modality: str = "vibration") -> PerceptualModel:
    """Return points in a person-sized box, each weighted to one to three of four bones."""
    rng = np.random.default_rng(seed)
    vertices = rng.uniform((-0.3, -0.15, 0.0), (0.3, 0.15, 1.8), (count, 3)).astype(np.float32)
    sizes = rng.integers(1, 4, count)
    bones = np.concatenate([np.sort(rng.permutation(len(BONES))[:n]) for n in sizes])
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    values = rng.uniform(0.1, 1.0, len(bones))
    values /= np.repeat(np.add.reduceat(values, offsets[:-1]), sizes)
    nothing: dict[str, Any] = {
        "triangles": np.zeros((0, 3), np.int32),
        "normals": np.zeros((count, 3), np.float32),
        "areas_m2": np.ones(count, np.float32),
        "mirror": np.arange(count, dtype=np.int32),
        "avatar_vertices": np.zeros((count, 3), np.int32),
        "avatar_weights": np.zeros((count, 3), np.float32),
        "avatar_offset_m": np.zeros(count, np.float32),
        "provenance": {},
    }
    return PerceptualModel(
        id=f"test-{modality}",
        modality=modality,
        vertices=vertices,
        part=rng.integers(0, 3, count).astype(np.uint8),
        side=rng.integers(0, 3, count).astype(np.uint8),
        bone_names=BONES,
        weights=SkinWeights(offsets, bones.astype(np.int32), values.astype(np.float32)),
        **nothing,
    )


def affine(rng: np.random.Generator, spread: float = 0.3) -> np.ndarray:
    """Return a random affine matrix near the identity, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3] += rng.normal(0.0, spread, (3, 4))
    return matrix


def pose(times: int, seed: int = 2, bones: int = len(BONES)) -> PoseBlock:
    """Return poses with independent motion of every bone, and of the whole body."""
    rng = np.random.default_rng(seed)
    matrices = np.stack([[affine(rng)[:3] for _ in range(bones)] for _ in range(times)])
    return PoseBlock(np.ones(times, bool), np.stack([affine(rng) for _ in range(times)]), matrices)


def skinned(body: PerceptualModel, posed: PoseBlock, row: int) -> np.ndarray:
    """Return world positions by definition, (V, 3)."""
    return world_points(body, SkinBinding(BONES), posed, row).T
