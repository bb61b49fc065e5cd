# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies of one vertex and of 200,000, without weights, with a thousand bones; 10,000 volumes."""

from __future__ import annotations

import numpy as np
import pytest
from extreme_cases import SHAPES, body_of, feel, still, volume
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import SkinWeights
from hfx_blender.engine.scene import PoseBlock, SkinBinding
from hfx_blender.engine.skin.skinned_model import SkinnedModel
from hfx_blender.engine.volume.shape import Falloff, FalloffKind


def ball(radius_m: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = np.diag([radius_m, radius_m, radius_m, 1.0])
    matrix[:3, 3] = centre
    return matrix


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("name", SHAPES)
def test_a_body_of_very_few_vertices(name, count):
    model = body_of(np.arange(3.0 * count).reshape(count, 3))
    for k in range(count):
        matrices = np.stack([ball(0.5, model.vertices[k]), ball(0.5, (0.0, 50.0, 0.0))])
        for falloff in (Falloff(), Falloff(FalloffKind.LINEAR)):
            samples = feel(model, volume(matrices, SHAPES[name]), falloff=falloff)
            assert np.flatnonzero(samples.weights[0, 0]).tolist() == [k]
            assert not samples.weights[0, 1].any() and samples.warnings == {}


@pytest.mark.filterwarnings("error")
def test_a_body_of_vertices_that_are_all_in_one_place():
    model = body_of(np.zeros((1000, 3)))
    samples = feel(model, volume(ball(0.1)[None], SHAPES["sphere"]))
    assert (samples.weights[0, 0] == 1.0).all()


def test_a_body_of_200_000_vertices(rng):
    model = body_of(rng.uniform((-0.3, -0.15, 0.0), (0.3, 0.15, 1.8), (200_000, 3)))
    matrix = ball(0.1, (0.1, 0.0, 1.2))
    samples = feel(model, volume(matrix[None], SHAPES["sphere"]))
    way = np.linalg.norm(model.vertices - matrix[:3, 3], axis=1) - 0.1
    sure = np.abs(way) > 1e-9
    np.testing.assert_array_equal(samples.weights[0, 0, sure] > 0, way[sure] < 0.0)
    assert np.count_nonzero(samples.weights) > 1000
    assert samples.engine.counters.vertices_posed < 20_000, "only what the volume can reach"


def bones_of(count: int, vertices: np.ndarray, rng: np.random.Generator) -> tuple:
    """Return weights of four random bones out of ``count`` for every vertex."""
    chosen = np.sort(
        np.stack([rng.choice(count, 4, replace=False) for _ in range(len(vertices))]), axis=1
    )
    shares = rng.dirichlet(np.ones(4), len(vertices)).astype(np.float32)
    offsets = np.arange(0, 4 * len(vertices) + 1, 4, dtype=np.int32)
    names = tuple(f"bone {k}" for k in range(count))
    return names, SkinWeights(offsets, chosen.ravel().astype(np.int32), shares.ravel()), shares


def test_a_body_of_a_thousand_bones(rng):
    points = rng.uniform(-0.5, 0.5, (800, 3))
    names, weights, shares = bones_of(1000, points, rng)
    model = body_of(points, names, weights)
    bones = np.tile(np.eye(4)[:3], (1, 1000, 1, 1)) + 0.1 * rng.normal(size=(1, 1000, 3, 4))
    pose = PoseBlock(np.ones(1, bool), np.eye(4)[None], bones)
    samples = feel(model, volume(ball(0.45)[None], SHAPES["sphere"]), pose)
    homogeneous = np.hstack([model.vertices.astype(float), np.ones((800, 1))])
    shares = shares.astype(float) / shares.astype(float).sum(axis=1, keepdims=True)
    blended = np.einsum("vk,vkij->vij", shares, bones[0, weights.bones.reshape(-1, 4)])
    way = np.linalg.norm(np.einsum("vij,vj->vi", blended, homogeneous), axis=1) - 0.45
    sure = np.abs(way) > 1e-9
    np.testing.assert_array_equal(samples.weights[0, 0, sure] > 0, way[sure] < 0.0)
    assert 50 < np.count_nonzero(samples.weights) < 750


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), silent=st.floats(0.0, 1.0))
def test_vertices_without_weights_never_yield_nan(seed, silent):
    """A vertex without weights stays in the rest pose, as in Blender; the rest is correct."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (60, 3))
    names, weights, _ = bones_of(5, points, rng)
    is_weighted = rng.random(60) >= silent
    lists = [weights.bones.reshape(-1, 4)[k] if is_weighted[k] else [] for k in range(60)]
    values = [weights.values.reshape(-1, 4)[k] if is_weighted[k] else [] for k in range(60)]
    offsets = np.concatenate([[0], np.cumsum([len(item) for item in lists])]).astype(np.int32)
    sparse = SkinWeights(
        offsets,
        np.concatenate([np.zeros(0), *lists]).astype(np.int32),
        np.concatenate([np.zeros(0), *values]).astype(np.float32),
    )
    turn = np.tile(np.eye(4)[:3], (1, 5, 1, 1))
    turn[:, :, 2, 3] = 0.25  # all bones lift by 0.25 m
    pose = PoseBlock(np.ones(1, bool), np.eye(4)[None], turn)
    samples = feel(body_of(points, names, sparse), volume(ball(0.4)[None], SHAPES["sphere"]), pose)
    lifted = points.astype(np.float32) + np.where(is_weighted, 0.25, 0.0)[:, None] * (0, 0, 1)
    way = np.linalg.norm(lifted, axis=1) - 0.4
    sure = np.abs(way) > 1e-6
    np.testing.assert_array_equal(samples.weights[0, 0, sure] > 0, way[sure] < 0.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("share", [0.0, 1e-45])
def test_weights_that_sum_to_next_to_nothing(share):
    weights = SkinWeights(
        np.array([0, 1, 2], np.int32), np.array([0, 0], np.int32), np.array([1, share], np.float32)
    )
    model = body_of(np.zeros((2, 3)), ("root",), weights)
    samples = feel(model, volume(ball(0.1)[None], SHAPES["sphere"]))
    assert samples.weights[0, 0].tolist() == [1.0, 1.0]


def test_missing_bones_are_named():
    weights = SkinWeights(
        np.array([0, 1], np.int32), np.array([1], np.int32), np.array([1], np.float32)
    )
    model = body_of(np.zeros((1, 3)), ("root", "hand"), weights)
    with pytest.raises(ValueError, match=r"missing.*hand"):
        SkinnedModel(model, SkinBinding(("root",)))


def test_ten_thousand_volumes(rng):
    """Twenty volumes on the body, the rest scattered: the result equals single evaluations."""
    model = body_of(rng.uniform((-0.3, -0.15, 0.0), (0.3, 0.15, 1.8), (500, 3)))
    places = rng.uniform(3.0, 1000.0, (10_000, 3)) * rng.choice([-1.0, 1.0], (10_000, 3))
    near = np.sort(rng.choice(10_000, 20, replace=False))
    places[near] = model.vertices[rng.choice(500, 20)]
    effects = [volume(ball(0.1, position)[None], SHAPES["sphere"]) for position in places]
    samples = feel(model, effects)
    indices = np.flatnonzero(samples.weights.any(axis=(1, 2)))
    assert indices.tolist() == near.tolist() and samples.warnings == {}
    for k in near:
        alone = feel(model, effects[k])
        np.testing.assert_array_equal(alone.weights[0], samples.weights[k])
    assert len(samples.runs) == 20


def test_hundreds_of_volumes_in_one_place():
    model = body_of(np.zeros((1, 3)))
    effects = [volume(ball(0.1)[None], SHAPES["cuboid"])] * 300
    assert (feel(model, effects, still(1)).weights == 1.0).all()
