# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounding boxes of skin and volumes, and the overlaps reported by the broad phase."""

from __future__ import annotations

import numpy as np
import pytest
from both_ways import needs_library
from hypothesis import given, settings
from hypothesis import strategies as st
from moving_scenes import moving_scene
from test_compiled_contact import TOLERANCES, load

from hfx_blender.engine.active_rows import FARTHEST
from hfx_blender.engine.contact import broad_phase
from hfx_blender.engine.contact.broad_phase import volume_boxes
from hfx_blender.engine.contact.compiled_target import PlacedTarget
from hfx_blender.engine.contact.reachable_bounds import ReachableBounds, bounds_of
from hfx_blender.engine.counters import Counters
from hfx_blender.engine.kinematics.placement_motion import largest_stretch, turned_by
from hfx_blender.engine.native import cluster_bounds as native_bounds
from hfx_blender.engine.scene import PoseBlock, SkinBinding
from hfx_blender.engine.skin.cell_coverage import BoundSkins
from hfx_blender.engine.skin.skinned_model import BoundWeights, SkinnedModel

pytestmark = needs_library


def _skin(model, tolerance):
    skins = BoundSkins(load, tolerance, Counters())
    scene, _ = moving_scene(model, 0, 0.0, 0.0)
    return skins.of(scene.bodies[0], model.id)


def _boxes(skin, pose, rows):
    """Return cluster boxes, and the hulls of the boxes transformed by each bone."""
    weights = BoundWeights.of(skin.skin.surface, skin.binding.bone_names)
    ends, bones, least, most = weights.clusters(skin.skin.outlines).bone_boxes
    centres, halves = (least + most) / 2, (most - least) / 2
    still = np.tile(np.eye(4)[:3], (len(pose.bones), 1, 1, 1))
    posed = np.concatenate([pose.bones, still], axis=1)[rows][:, bones]
    to_world, margins = pose.to_world[rows], skin.skin.margins_m
    with np.errstate(all="ignore"):
        linear = to_world[:, None, :3, :3] @ posed[..., :3]
        middles = np.einsum("npij,pj->npi", linear, centres)
        middles += np.einsum("nij,npj->npi", to_world[:, :3, :3], posed[..., 3])
        middles += to_world[:, None, :3, 3]
        reaches = np.einsum("npij,pj->npi", np.abs(linear), halves)
        stretches = largest_stretch(linear.reshape(-1, 3, 3)).reshape(linear.shape[:2])
        bulges = (np.maximum.reduceat(stretches, ends[:-1], axis=1) * margins)[..., None]
        low = np.minimum.reduceat(middles - reaches, ends[:-1], axis=1) - bulges
        high = np.maximum.reduceat(middles + reaches, ends[:-1], axis=1) + bulges
        expected = ReachableBounds.around(rows, low, high)
    return bounds_of(skin, pose, rows).boxes, expected.boxes


# Skin


@pytest.mark.parametrize("modality", ["vibration", "temperature"])
@pytest.mark.parametrize("count", [0, 1, 6])
def test_boxes_of_skin_contain_the_posed_vertices(modality, count):
    model = load(f"hfx-{modality}-1")
    skin = _skin(model, TOLERANCES[1])
    assert skin.skin.margins_m is not None and skin.skin.margins_m.any()
    _, block = moving_scene(model, 5, 0.4, 1.0)
    rows = np.array([4, 0, 3, 1, 5, 2])[:count]
    actual, expected = _boxes(skin, block.poses[0], rows)
    for first, second in zip(actual, expected, strict=True):
        np.testing.assert_allclose(first, second, rtol=0, atol=1e-12)
    low, high, of_rows, of_clusters = actual
    assert (of_rows[:, 0] == low.min(axis=1, initial=np.inf)).all()
    assert (of_rows[:, 1] == high.max(axis=1, initial=-np.inf)).all()
    assert (of_clusters[:, 0] == low.min(axis=0, initial=np.inf)).all()
    assert (of_clusters[:, 1] == high.max(axis=0, initial=-np.inf)).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_nan_affects_only_the_clusters_of_its_bones(value):
    model = load("hfx-pressure-1")
    skin = _skin(model, TOLERANCES[1])
    _, block = moving_scene(model, 5, 0.4, 1.0)
    pose = block.poses[0]
    bones = pose.bones.copy()
    bones[2, skin.surface.cluster_bones(7)[0], 0, 1] = value
    pose = PoseBlock(pose.valid, pose.to_world, bones)
    actual, expected = _boxes(skin, pose, np.arange(6))
    sure = np.isfinite(expected[0]) & (np.abs(expected[0]) < 1e100)
    assert sure.any() and not sure.all() and (sure == (np.abs(actual[0]) < 1e100)).all()
    for first, second in zip(actual[:2], expected[:2], strict=True):
        np.testing.assert_allclose(first[sure], second[sure], rtol=0, atol=1e-12)
        assert (np.isnan(first) == np.isnan(second)).all()
    if np.isnan(value):  # finite at the other rows
        assert np.isfinite(actual[3]).all()
        np.testing.assert_allclose(actual[3], expected[3], rtol=0, atol=1e-12)


def test_bones_that_the_pose_has_not_rest():
    model = load("hfx-pressure-1")
    bound = SkinnedModel(model, SkinBinding(model.bone_names))
    boxes = bound.outline.bounds(
        np.zeros((1, 0, 3, 4)), np.zeros(1, np.int64), np.eye(4)[None], None
    )
    for cluster in (0, 9):
        places = model.vertices[bound.clusters[cluster]].astype(np.float64)
        np.testing.assert_allclose(boxes[0][0, cluster], places.min(axis=0), atol=1e-12)
        np.testing.assert_allclose(boxes[1][0, cluster], places.max(axis=0), atol=1e-12)


def test_nothing_has_no_box():
    none, boxes = np.zeros(0, np.int64), np.zeros((0, 3))
    outline = native_bounds.Outline(none, np.zeros(3, np.int64), none, boxes, boxes)
    low, high, of_rows, of_clusters = outline.bounds(
        np.zeros((1, 2, 3, 4)), np.zeros(1, np.int64), np.eye(4)[None], np.ones(2)
    )
    assert (low == np.inf).all() and (high == -np.inf).all()
    assert (of_rows[:, 0] == np.inf).all() and (of_clusters[:, 1] == -np.inf).all()


# Volumes

numbers = st.floats(-10.0, 10.0) | st.sampled_from([0.0, 1e-95, 1e95, 1e13, np.nan, np.inf])


@settings(max_examples=150, deadline=None)
@given(st.data(), st.integers(0, 3), st.integers(1, 4))
def test_boxes_of_volumes_are_around_their_corners_wherever_they_turn(data, volumes, rows):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**31)))
    matrices = np.tile(np.eye(4), (volumes, rows, 1, 1))
    matrices[..., :3, :] = rng.normal(size=(volumes, 1, 3, 4))
    if data.draw(st.booleans()):
        matrices[..., :3, :3] += 0.1 * rng.normal(size=(volumes, rows, 3, 3))
    matrices[..., :3, 3] += rng.normal(size=(volumes, rows, 3))
    for volume in range(volumes):
        if data.draw(st.booleans()):
            at = data.draw(
                st.tuples(st.integers(0, rows - 1), st.integers(0, 2), st.integers(0, 3))
            )
            matrices[volume, *at] = data.draw(numbers)
    levels = np.array(rng.integers(-1, 2, (volumes, rows)), np.float64)
    low = rng.normal(size=(volumes, 3))
    limits = np.stack([low, low + rng.random((volumes, 3))], axis=1)
    low_m, high_m, is_sure = volume_boxes(matrices, levels, limits)
    picks = np.stack(np.meshgrid(*[[0, 1]] * 3), axis=-1).reshape(-1, 3)
    for volume in range(volumes):
        on = levels[volume] > 0.0
        linear, origins = matrices[volume, :, :3, :3], matrices[volume, :, :3, 3]
        with np.errstate(all="ignore"):
            lengths = np.linalg.norm(linear, axis=1)
            usable = np.abs(np.linalg.det(linear)) >= 0.05 * lengths.prod(axis=1)
            usable &= ((lengths > 1e-90) & (lengths < 1e90)).all(axis=1)
            usable &= np.isfinite(origins).all(axis=1)
        assert is_sure[volume] == usable[on].all()
        if not (is_sure[volume] and on.any()):
            continue
        corners = limits[volume][picks, [0, 1, 2]]
        places = np.einsum("tij,cj->tci", linear[on], corners) + origins[on][:, None]
        most = np.abs(limits[volume]).max(axis=0)  # from the shape's origin
        arms = np.linalg.norm(np.abs(linear[on]) @ most, axis=1)
        turns = (linear[1:] != linear[:-1]).any()
        swing = arms.max() if turns else 0.0
        ends = places.min(axis=(0, 1)) - swing, places.max(axis=(0, 1)) + swing
        near = 1e-9 + 1e-11 * np.abs(places).max()
        np.testing.assert_allclose(low_m[volume], ends[0], rtol=1e-12, atol=near)
        np.testing.assert_allclose(high_m[volume], ends[1], rtol=1e-12, atol=near)


# Both


def test_rows_without_boxes_or_a_pose_are_refused():
    model = load("hfx-pressure-1")
    skin = _skin(model, TOLERANCES[1])
    scene, block = moving_scene(model, 3, 0.0, 0.0)
    pose, animated, rows = block.poses[0], block.effects[0], np.arange(6)
    target = PlacedTarget(
        *(animated.shapes, animated.shape_index, animated.matrices, pose.to_world, rows),
        *(scene.effects[0].area.falloff, 0.0, FARTHEST),
    )
    boxes, none = bounds_of(skin, pose, rows).boxes, np.zeros(6, np.bool_)
    for row_subset in (np.arange(5), np.zeros(0, np.int64)):
        with pytest.raises(IndexError, match="row 5 has no boxes"):
            broad_phase.CompiledBroadPhase(
                target, skin.surface.outline, row_subset, boxes, none, ~none, 0.0, True, False
            )
    broad = broad_phase.CompiledBroadPhase(
        target, skin.surface.outline, rows, boxes, none, ~none, 0.0, True, False
    )
    broad.overlaps()
    with pytest.raises(IndexError, match="row 5 of a pose of 5"):
        broad.reach(pose.bones[:5], skin.used_bones, skin.own_outline, None)


def _check_bones(reached, skin, pose, target):
    """Check the completeness of the relevant bones."""
    still = np.tile(np.eye(4)[:3], (len(pose.bones), 1, 1, 1))
    posed = np.concatenate([pose.bones, still], axis=1)[target.rows][:, skin.used_bones.ids]
    to_shape = target.part("body_to_shape")[:, None]
    whole = to_shape[..., :3, :3] @ posed
    whole[..., 3] += to_shape[..., :3, 3]
    stretches = np.linalg.norm(whole[..., :3], 2, axis=(2, 3))
    for model in {skin.surface, skin.vertices}:
        bones = [*map(model.cluster_bones, reached.clusters.tolist()), np.zeros(0, np.int64)]
        slots = np.searchsorted(skin.used_bones.ids, np.concatenate(bones))
        matrix = reached.bones.matrices[:, slots]
        np.testing.assert_allclose(matrix, whole[:, slots], rtol=1e-9, atol=1e-12)
        matrix = reached.bones.stretches[:, slots]
        assert (matrix >= stretches[:, slots] * (1.0 - 1e-12)).all()
        assert (
            matrix <= 1.8 * stretches[:, slots] + 1e-12
        ).all()  # no more than by Frobenius' norm


@pytest.mark.parametrize("tolerance", TOLERANCES, ids=lambda each: each.name)
@pytest.mark.parametrize("modality", ["pressure", "temperature"])
def test_lists_of_clusters_are_those_of_the_pairs_and_their_bones_are_known(modality, tolerance):
    model = load(f"hfx-{modality}-1")
    skin = _skin(model, tolerance)
    scene, block = moving_scene(model, 3, 0.3, 0.4)
    pose, rows, count = block.poses[0], np.arange(6), 0
    bounds = bounds_of(skin, pose, rows)
    for effect, animated in zip(scene.effects, block.effects, strict=True):
        falloff, follows = effect.area.falloff, rows > 0
        target = PlacedTarget(
            *(animated.shapes, animated.shape_index, animated.matrices, pose.to_world),
            *(rows, falloff, tolerance.amplitude, FARTHEST),
        )
        assert target.is_usable.all()
        ways = animated.matrices, pose.to_world
        turns = [turned_by(way[:-1], way[1:]) for way in ways]
        np.testing.assert_allclose(target.part("turns")[:, 1:], turns, atol=1e-9)
        broad = broad_phase.CompiledBroadPhase(
            *(target, skin.surface.outline, bounds.rows, bounds.boxes, follows, rows < 6),
            *(skin.skin.edge_m, skin.skin.is_split, False),
        )
        met, sizes = broad.overlaps(), None
        if not falloff.is_flat and skin.skin.is_split and tolerance.amplitude > 0.0:
            sizes = skin.cell_groups(met)
        reached = broad.reach(pose.bones, skin.used_bones, skin.own_outline, sizes)
        _check_bones(reached, skin, pose, target)
        pairs = reached.pairs
        is_wide = (pairs.how == broad_phase.COVERED) | (pairs.steps > 0)
        by_vertex = pairs.how == broad_phase.BY_VERTEX
        assert reached.clusters.tolist() == np.unique(pairs.clusters).tolist()
        assert reached.wide.tolist() == np.unique(pairs.clusters[is_wide]).tolist()
        assert reached.by_vertex.tolist() == np.unique(pairs.clusters[by_vertex]).tolist()
        assert reached.most_steps == pairs.steps.max(initial=0)
        count += len(pairs.clusters)
    assert count
