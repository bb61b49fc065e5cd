# SPDX-License-Identifier: GPL-3.0-or-later
"""Posed vertices and bounding boxes."""

from __future__ import annotations

import numpy as np
import pytest
from engine_synthetic import BONES, affine, model, pose, skinned

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.scene import PoseBlock, SkinBinding, SurfaceAnchors
from hfx_blender.engine.skin.posing import LEAF_SIZE, SurfaceModel, clusters_of
from hfx_blender.engine.skin.skinned_model import SkinnedModel

TIMES = 4


def test_every_vertex_is_in_one_cluster_of_one_part() -> None:
    body = model()
    clusters = clusters_of(body)
    assert np.sort(np.concatenate(clusters)).tolist() == list(range(len(body)))
    for ids in clusters:
        assert 0 < len(ids) <= LEAF_SIZE
        assert (np.diff(ids) > 0).all()
        assert len(np.unique(body.part[ids])) == len(np.unique(body.side[ids])) == 1


def test_clusters_are_compact() -> None:
    """Halving a shipped model gives clusters of small extent."""
    body = load_model("hfx-vibration-1")
    sizes = [np.ptp(body.vertices[ids], axis=0).max() for ids in clusters_of(body)]
    assert max(sizes) < 1.0 and np.median(sizes) < 0.1  # metres; the legs are sparse
    assert len(sizes) < 4 * len(body) / LEAF_SIZE


def test_the_same_model_has_the_same_clusters() -> None:
    one, two = clusters_of(model()), clusters_of(model())
    assert all(a.tobytes() == b.tobytes() for a, b in zip(one, two, strict=True))


def test_skinned_points_are_those_of_the_formula() -> None:
    body, posed = model(), pose(TIMES)
    bound = SkinnedModel(body, SkinBinding(BONES))
    rows = np.array([0, 2, 3])
    expected = [skinned(body, posed, row) for row in rows]
    for k, ids in enumerate(bound.clusters):
        points = bound.cluster_points(k, posed, rows, posed.to_world[rows])
        assert points.shape == (3, len(rows), len(ids))
        for i in range(len(rows)):
            assert np.abs(points[:, i].T - expected[i][ids]).max() < 1e-12
    vertex_ids = np.array([3, 17, 400, 899], np.int32)
    for i, row in enumerate(rows):
        points = bound.points(vertex_ids, posed, int(row), posed.to_world[row])
        assert np.abs(points.T - expected[i][vertex_ids]).max() < 1e-12


def test_bones_may_come_in_another_order_with_others_between() -> None:
    body, posed = model(), pose(TIMES)
    order = [2, 0, 3, 1]
    names = ("extra", *(BONES[k] for k in order))
    bones = np.concatenate([np.full((TIMES, 1, 3, 4), 7.0), posed.bones[:, order]], axis=1)
    bound = SkinnedModel(body, SkinBinding(names))
    ids = np.arange(len(body), dtype=np.int32)
    pose_block = PoseBlock(posed.valid, posed.to_world, bones)
    points = bound.points(ids, pose_block, 1, posed.to_world[1])
    assert np.abs(points.T - skinned(body, posed, 1)).max() < 1e-12


def test_a_missing_bone_is_named() -> None:
    with pytest.raises(ValueError, match="leg"):
        SkinnedModel(model(), SkinBinding(("root", "arm", "tip")))


@pytest.mark.parametrize("seed", range(6))
def test_boxes_hold_their_clusters(seed: int) -> None:
    """Holds for mirrored, sheared and distant bones."""
    body, posed = model(seed=seed), pose(TIMES, seed=seed)
    if seed % 2:
        posed.bones[:, 1] *= -30.0
    bound = SkinnedModel(body, SkinBinding(BONES))
    rows = np.arange(TIMES)
    low, high, *_ = bound.outline.bounds(posed.bones, rows, posed.to_world[rows], None)
    assert low.shape == high.shape == (TIMES, len(bound.clusters), 3)
    for k in range(len(bound.clusters)):
        points = bound.cluster_points(k, posed, rows, posed.to_world[rows])
        slack = 1e-12 * np.abs(points).max()
        assert (points >= low[:, k].T[:, :, None] - slack).all()
        assert (points <= high[:, k].T[:, :, None] + slack).all()


def test_boxes_of_a_rigid_body_are_tight() -> None:
    body = model()
    still = np.broadcast_to(np.eye(4)[:3], (1, len(BONES), 3, 4))
    bound = SkinnedModel(body, SkinBinding(BONES))
    posed = PoseBlock(np.ones(1, bool), np.eye(4)[None], still)
    low, high, *_ = bound.outline.bounds(posed.bones, np.array([0]), np.eye(4)[None], None)
    for k, ids in enumerate(bound.clusters):
        assert np.allclose(low[0, k], body.vertices[ids].min(axis=0), atol=1e-12)
        assert np.allclose(high[0, k], body.vertices[ids].max(axis=0), atol=1e-12)


def test_weights_that_are_off_by_rounding_do_not_shrink_a_far_body() -> None:
    """float32 weights sum to 1 within 1e-7; at a distance of 1000 km, the error would be 0.1 m."""
    body = model()
    bound = SkinnedModel(body, SkinBinding(BONES))
    shift = np.eye(4)[:3].copy()
    shift[:, 3] = (1e6, 0.0, 0.0)
    posed = PoseBlock(np.ones(1, bool), np.eye(4)[None], np.broadcast_to(shift, (1, 4, 3, 4)))
    ids = np.arange(len(body), dtype=np.int32)
    points = bound.points(ids, posed, 0, np.eye(4))
    assert np.abs(points[0] - 1e6 - body.vertices[:, 0]).max() < 1e-8


# Bodies bound to a surface


def _surface(seed: int = 5) -> tuple[SurfaceAnchors, PoseBlock]:
    rng = np.random.default_rng(seed)
    count = len(model())
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    corners = np.stack([rng.permutation(40)[:3] for _ in range(count)]).astype(np.int32)
    anchors = SurfaceAnchors(corners, weights, rng.normal(0.0, 0.01, count))
    surface = rng.uniform(-1.0, 1.0, (TIMES, 40, 3)).astype(np.float32)
    to_world = np.stack([affine(rng) for _ in range(TIMES)])
    return anchors, PoseBlock(np.ones(TIMES, bool), to_world, surface=surface)


def test_surface_points_are_those_of_the_formula() -> None:
    anchors, posed = _surface()
    bound = SurfaceModel(model(), anchors)
    rows = np.array([1, 3])
    expected = np.zeros((len(rows), len(model()), 3))
    for i, row in enumerate(rows):
        for v in range(len(model())):
            a, b, c = posed.surface[row, anchors.corners[v]].astype(np.float64)
            normal = np.cross(b - a, c - a)
            local = anchors.weights[v] @ np.stack([a, b, c])
            local += anchors.offset_m[v] * normal / np.linalg.norm(normal)
            expected[i, v] = posed.to_world[row, :3, :3] @ local + posed.to_world[row, :3, 3]
    low, high = bound.bounds_around(bound.places(posed, rows), posed.to_world[rows])
    for k, ids in enumerate(bound.clusters):
        points = bound.cluster_points(k, posed, rows, posed.to_world[rows])
        assert np.abs(points.transpose(1, 2, 0) - expected[:, ids]).max() < 1e-12
        assert (expected[:, ids] >= low[:, k, None] - 1e-12).all()
        assert (expected[:, ids] <= high[:, k, None] + 1e-12).all()
    ids = np.array([0, 5, 899], np.int32)
    points = bound.points(ids, posed, 3, posed.to_world[3])
    assert np.abs(points.T - expected[1, ids]).max() < 1e-12


def test_a_collapsed_triangle_gives_a_point_of_the_triangle() -> None:
    anchors, posed = _surface()
    posed.surface[:] = 0.25
    points = SurfaceModel(model(), anchors).points(
        np.arange(9, dtype=np.int32), posed, 0, np.eye(4)
    )
    assert np.abs(points - 0.25).max() < 1e-15


def test_pairs_of_clusters_and_rows_are_posed_one_after_the_other() -> None:
    body, posed = model(), pose(TIMES)
    anchors, ridden = _surface()
    rows, clusters, at = np.array([3, 0, 2]), np.array([0, 2, 2, 5]), np.array([1, 0, 2, 1])
    for bound, pose_block in (
        (SkinnedModel(body, SkinBinding(BONES)), posed),
        (SurfaceModel(body, anchors), ridden),
    ):
        pair_points = bound.pair_points(clusters, at, pose_block, rows, pose_block.to_world[rows])
        expected = [
            bound.points(bound.clusters[cluster], pose_block, row, pose_block.to_world[row])
            for cluster, row in zip(clusters.tolist(), rows[at].tolist(), strict=True)
        ]
        assert pair_points == pytest.approx(np.concatenate(expected, axis=1), abs=1e-12)


def test_a_box_holds_every_cluster() -> None:
    body, posed = model(), pose(4)
    bound = SkinnedModel(body, SkinBinding(BONES))
    rows = np.arange(4)
    to_world = posed.to_world[rows]
    low, high = bound.outline.bounds(posed.bones, rows, to_world, None)[2].transpose(1, 0, 2)
    points = [
        bound.cluster_points(k, posed, rows, posed.to_world[rows])
        for k in range(len(bound.clusters))
    ]
    every = np.concatenate(points, axis=2)  # (3, n, V)
    assert (every.min(axis=2).T >= low - 1e-9).all()
    assert (every.max(axis=2).T <= high + 1e-9).all()
    assert ((high - low) < 3.0 * np.ptp(every, axis=2).T).all()
