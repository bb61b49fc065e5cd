# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts are invariant under motion, mirroring, and division into blocks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from extreme_cases import SHAPES, Felt, body_of, feel, moved, volume
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import SkinWeights, load_model
from hfx_blender.engine.scene import EffectBlock, PoseBlock
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

BONES = ("root", "arm.L", "arm.R")
TIMES = 7
FALLOFF = Falloff(FalloffKind.SMOOTH, 0.7)
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
OTHER_SIDE = [0, 2, 1]  # bones


def symmetric(seed: int) -> tuple[object, np.ndarray]:
    """Return a symmetric body and the mirror table."""
    rng = np.random.default_rng(seed)
    half = rng.uniform((0.02, -0.15, 0.0), (0.3, 0.15, 1.8), (150, 3))
    points = np.concatenate([half, half * (-1.0, 1.0, 1.0)])
    table = np.concatenate([np.arange(150, 300), np.arange(150)]).astype(np.int32)
    share = rng.uniform(0.1, 0.9, 150)
    values = np.stack([share, 1.0 - share], axis=1)
    bones = np.concatenate([np.tile([0, 1], 150), np.tile([0, 2], 150)])
    weights = SkinWeights(
        np.arange(0, 601, 2, dtype=np.int32),
        bones.astype(np.int32),
        np.concatenate([values, values]).ravel().astype(np.float32),
    )
    return body_of(points, BONES, weights), table


def rigid(rng: np.random.Generator, reach_m: float = 1.0) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = q * np.sign(np.linalg.det(q))
    matrix[:3, 3] = reach_m * rng.normal(size=3)
    return matrix


def animated(rng: np.random.Generator) -> tuple[np.ndarray, PoseBlock]:
    """Return a volume passing through a body with bending bones, both moving through the world."""
    bones = np.tile(np.eye(4)[:3], (TIMES, len(BONES), 1, 1))
    bones += 0.1 * rng.normal(size=bones.shape)
    pose = PoseBlock(np.ones(TIMES, bool), np.stack([rigid(rng) for _ in range(TIMES)]), bones)
    middle = np.tile(np.eye(4), (TIMES, 1, 1))
    middle[:, :3, :3] *= 0.4
    middle[:, :3, :3] += 0.1 * rng.normal(size=(TIMES, 3, 3))
    middle[:, :3, 3] = (0.0, 0.0, 0.9) + 0.1 * rng.normal(size=(TIMES, 3))
    return pose.to_world @ middle, pose


def assert_same(one: Felt, two: Felt, weights: np.ndarray, band: float) -> None:
    """Check equality up to rounding; with falloff, a vertex may change sides where faint."""
    assert one.warnings == two.warnings == {}
    assert one.weights.any()
    assert np.abs(one.weights - weights).max() < band


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), reach=st.floats(-3.0, 6.0))
def test_contacts_stay_when_everything_is_moved(name, seed, reach):
    rng = np.random.default_rng(seed)
    model, _ = symmetric(seed)
    matrices, pose = animated(rng)
    carry = rigid(rng, 10.0**reach)
    here = feel(model, volume(matrices, SHAPES[name]), pose, falloff=FALLOFF)
    there = feel(model, volume(carry @ matrices, SHAPES[name]), moved(pose, carry), falloff=FALLOFF)
    # float64 at 1e6 m has steps of 1e-10 m, which is 1e-9 of a volume of 0.1 m.
    assert_same(here, there, there.weights, 1e-7)


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_contacts_of_the_mirror_image_are_those_of_the_mirror_table(name, seed):
    rng = np.random.default_rng(seed)
    model, table = symmetric(seed)
    matrices, pose = animated(rng)
    flip = MIRROR[:3, :3]
    bones = np.empty_like(pose.bones)
    for k, second in enumerate(OTHER_SIDE):
        bones[:, k, :, :3] = flip @ pose.bones[:, second, :, :3] @ flip
        bones[:, k, :, 3] = pose.bones[:, second, :, 3] @ flip
    mirrored = PoseBlock(pose.valid, MIRROR @ pose.to_world @ MIRROR, bones)
    here = feel(model, volume(matrices, SHAPES[name]), pose, falloff=FALLOFF)
    there = feel(model, volume(MIRROR @ matrices, SHAPES[name]), mirrored, falloff=FALLOFF)
    assert_same(here, there, there.weights[:, :, table], 1e-7)


def test_a_mirrored_volume_on_a_shipped_model_touches_the_mirrored_vertices():
    """Vertices of the shipped models are symmetric only to a tenth of a millimetre."""
    model = load_model("hfx-pressure-1")
    matrix = np.diag([0.12, 0.3, 0.25, 1.0])
    matrix[:3, 3] = (0.25, 0.0, 1.2)
    ways = {}
    for side in (1.0, -1.0):
        flipped = np.diag([side, 1.0, 1.0, 1.0]) @ matrix
        effect = volume(flipped[None], SHAPES["sphere"])
        local = (model.vertices - flipped[:3, 3]) / np.diag(flipped)[:3]
        pose = PoseBlock(
            np.ones(1, bool),
            np.eye(4)[None],
            np.tile(np.eye(4)[:3], (1, len(model.bone_names), 1, 1)),
        )
        ways[side] = np.linalg.norm(local, axis=1), feel(model, effect, pose).weights[0, 0] > 0
    (way, left), (_, right) = ways[1.0], ways[-1.0]
    sure = np.abs(way - 1.0) > 0.002
    np.testing.assert_array_equal(left[sure], right[model.mirror][sure])
    assert 100 < np.count_nonzero(left) < len(model) / 4


def cut(effect: EffectBlock, pose: PoseBlock, rows: list[int]) -> tuple[EffectBlock, PoseBlock]:
    return (
        EffectBlock(
            effect.levels[rows], effect.parameters[rows], effect.matrices[rows], effect.shapes
        ),
        PoseBlock(pose.valid[rows], pose.to_world[rows], pose.bones[rows]),
    )


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cuts=st.sets(st.integers(1, TIMES - 1)))
def test_contacts_do_not_depend_on_how_time_is_split(name, seed, cuts):
    """Exact equality: an export in parts equals a single export."""
    rng = np.random.default_rng(seed)
    model, _ = symmetric(seed)
    matrices, pose = animated(rng)
    effect = volume(matrices, SHAPES[name])
    whole = feel(model, effect, pose, falloff=FALLOFF)
    ends = [0, *sorted(cuts), TIMES]
    for first, stop in pairwise(ends):
        rows = list(range(first, stop))
        part = feel(model, *cut(effect, pose, rows), falloff=FALLOFF)
        np.testing.assert_array_equal(part.weights[0], whole.weights[0, rows])
