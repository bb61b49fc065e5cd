# SPDX-License-Identifier: GPL-3.0-or-later
"""Preparation of a body model before evaluation: the compiled library equals numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from both_ways import in_numpy, needs_library
from coverage_synthetic import ball, sheet
from distorted_scenes import load
from engine_synthetic import BONES
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.clusters import clusters_of
from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.native.skin_table import table_of
from hfx_blender.engine.scene import SkinBinding
from hfx_blender.engine.skin.bound_weights import BoneBoxes, BoundWeights
from hfx_blender.engine.skin.cell_coverage import SkinCoverage, finer_id
from hfx_blender.engine.skin.cell_sizes import CellSizes
from hfx_blender.engine.skin.skin_mesh import SkinMesh
from hfx_blender.engine.skin.skin_table import SkinTable
from hfx_blender.engine.skin.skinned_model import SkinnedModel
from hfx_blender.engine.tolerance import PREVIEW, STANDARD, Tolerance

pytestmark = needs_library

FINE = Tolerance("fine", 0.001, 0.25, 0.002, 0.0)
_OF_CLUSTERS = ("starts", "place_counts", "unit_counts", "cell_starts", "bulge_m", "most_samples")
_OF_PLACES = ("vertices", "cell_of", "unit_shares", "vertex_shares", "reaches", "means")
_OF_QUADS = (
    *("quad_starts", "is_ringed", "unit_of", "around", "steps", "finest", "heights_m", "wholes"),
    "quads",
)
ALL = (*_OF_CLUSTERS, *_OF_PLACES, *_OF_QUADS)


def crumpled(seed: int, count: int = 260) -> PerceptualModel:
    """Triangles anyhow: some without area, some twice, fans, edges of many; and any weights."""
    rng = np.random.default_rng(seed)
    triangles = rng.integers(0, count, (2 * count, 3)).astype(np.int32)
    near = rng.integers(0, count - 3, count)
    triangles[:count] = near[:, None] + rng.permuted(np.tile([0, 1, 2], (count, 1)), axis=1)
    triangles[-9:] = triangles[:9]
    triangles[-20:-9, 1] = triangles[-20:-9, 0]
    triangles[count : count + 30, 0] = 7
    sizes = rng.integers(0, 4, count)
    bones = np.concatenate([np.sort(rng.permutation(4)[:n]) for n in sizes]).astype(np.int32)
    values = rng.uniform(0.1, 1.0, len(bones)).astype(np.float32)
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    normals = rng.normal(size=(count, 3))
    return replace(
        sheet(2),
        vertices=np.round(rng.normal(0.0, 0.03, (count, 3)), 3).astype(np.float32),
        triangles=triangles,
        normals=(normals / np.linalg.norm(normals, axis=1)[:, None]).astype(np.float32),
        areas_m2=rng.uniform(0.0, 1e-4, count).astype(np.float32),
        part=rng.integers(0, 2, count).astype(np.uint8),
        side=np.zeros(count, np.uint8),
        weights=SkinWeights(offsets, bones, values),
    )


def _skins(name: str, tolerance: Tolerance = STANDARD) -> list[SkinCoverage]:
    """A skin compiled, and the same without the library."""
    if name == "ball":
        model, finer = ball(0.1, 3), None
    elif name.isdigit():
        model, finer = crumpled(int(name)), None
    else:
        model = load(name)
        fine = finer_id(model, tolerance)
        finer = None if fine is None else load(fine)
    made = [SkinCoverage(model, tolerance, finer)]
    with in_numpy():
        made.append(SkinCoverage(model, tolerance, finer))
    return made


NAMES = ("ball", "hfx-temperature-1", "hfx-pressure-1", "1", "2")


# Clusters


def _assert_same_lists(found: list[np.ndarray], expected: list[np.ndarray]) -> None:
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(0, 300),
    leaf_size=st.sampled_from([1, 2, 9, 128, 1000]),
    digits=st.sampled_from([0, 1, 7]),
    loaded=st.booleans(),
)
def test_clusters_are_those_of_numpy(seed, count, leaf_size, digits, loaded):
    """Includes many vertices that share a coordinate."""
    rng = np.random.default_rng(seed)
    vertices = np.round(rng.normal(0.0, 1.0, (count, 3)), digits).astype(np.float32)
    vertices[rng.random((count, 3)) < 0.1] = -0.0
    some = np.arange(count) % 3 if count else np.zeros(0)
    model = replace(
        sheet(2), vertices=vertices, part=some.astype(np.uint8), side=np.zeros(count, np.uint8)
    )
    load = rng.integers(0, 6, count) if loaded else None
    found = clusters_of(model, leaf_size, load)
    with in_numpy():
        expected = clusters_of(model, leaf_size, load)
    _assert_same_lists(found, expected)


@pytest.mark.parametrize("name", ["hfx-vibration-1", "hfx-pressure-1"])
def test_clusters_of_a_shipped_model_are_those_of_numpy(name):
    found = clusters_of(load(name))
    with in_numpy():
        expected = clusters_of(load(name))
    _assert_same_lists(found, expected)


# Bones


def _clusters(model: PerceptualModel, seed: int) -> list[np.ndarray]:
    """Some of its vertices, some in two clusters, not in order."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 60, 12)
    return [rng.permutation(len(model))[:n].astype(np.int32) for n in sizes]


@pytest.mark.parametrize("seed", range(5))
def test_boxes_of_bones_are_those_of_numpy(seed):
    model = crumpled(seed)
    weights, clusters = BoundWeights.of(model, ("extra", *BONES)), _clusters(model, seed)
    assert (weights.bones == weights.bone_count).any(), "some rest"
    found = BoneBoxes.of(weights, clusters)
    with in_numpy():
        expected = BoneBoxes.of(weights, clusters)
    for name in ("ends", "bones", "low", "high", "used", "slots"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for one, other in zip(found.of_bones, expected.of_bones, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.ends.dtype == found.bones.dtype == np.int64


@pytest.mark.parametrize("seed", range(5))
def test_what_bones_do_to_clusters_is_what_numpy_says(seed):
    model = crumpled(seed)
    bound = SkinnedModel(model, SkinBinding(BONES), _clusters(model, seed))
    found = bound.native_clusters(np.array([11, 3, 4]))
    found = bound.native_clusters(np.array([4, 0, 11]))
    for cluster in (0, 3, 4, 11):
        entry_bones, factors, firsts = bound.cluster_entries(cluster)
        bones = bound.cluster_bones(cluster)
        arrays = found.arrays_of(cluster)
        np.testing.assert_array_equal(bones[arrays[0]], entry_bones)
        np.testing.assert_array_equal(arrays[2], [*firsts, len(entry_bones)])
        owners = np.repeat(np.arange(len(firsts)), np.diff(arrays[2]))
        np.testing.assert_array_equal(arrays[1][:, None] * arrays[3][owners], factors)
        np.testing.assert_array_equal(arrays[4], bones)
        np.testing.assert_array_equal(arrays[5], bound._moved(cluster))
        pointers = found.table[cluster]
        assert pointers.bone_count == len(bones)
        told = [getattr(pointers, name) for name, _ in pointers._fields_[:-1]]
        assert told == [array.ctypes.data for array in arrays]
    assert not found.table[1].weights, "nobody asked for it"


@pytest.mark.parametrize("name", ["ball", "1"])
def test_neighbours_learnt_later_have_arrays_of_their_own(name):
    skin, _ = _skins(name)
    bound, some = SkinnedModel(skin.surface, SkinBinding(BONES), skin.outlines), np.array([0, 1])
    before = bound.native_clusters(some).arrays_of(0)[6:]
    skin.table.need(some)
    after = bound.native_clusters(some, skin.table).arrays_of(0)
    assert not any(array.any() for array in before)
    units = int(skin.table.unit_counts[0])
    expected = bound.links(0, skin.table)
    np.testing.assert_allclose(after[6], expected.distances, rtol=1e-12, atol=1e-15)
    by_bone = after[7].reshape(-1, units)
    np.testing.assert_allclose(by_bone, expected.differences, rtol=1e-12, atol=1e-15)
    assert len(after[6]) == units and after[6].any()


# Skin


@pytest.mark.parametrize("name", NAMES)
def test_outlines_and_margins_are_those_of_numpy(name):
    found, expected = _skins(name)
    _assert_same_lists(found.outlines, expected.outlines)
    np.testing.assert_array_equal(found.margins_m, expected.margins_m)
    assert found.margins_m.any()


@pytest.mark.parametrize("tolerance", [STANDARD, PREVIEW, FINE], ids=lambda each: each.name)
@pytest.mark.parametrize("name", NAMES)
def test_a_filled_table_is_that_of_numpy(name, tolerance):
    tables = [skin.table for skin in _skins(name, tolerance)]
    count = len(tables[0].unit_counts)
    some = np.random.default_rng(5).permutation(count)[: max(count // 2, 1)]
    tables[0].need(some)
    tables[0].need(np.arange(count))  # the others, after them
    with in_numpy():
        tables[1].need(some)
        tables[1].need(np.arange(count))
    for name in (*ALL, "sample_starts"):
        one, other = (getattr(table, name) for table in tables)
        assert one.dtype == other.dtype, name
        np.testing.assert_array_equal(one, other, err_msg=name)
    used = int(tables[1]._sample_count)
    assert used == tables[0]._sample_count
    np.testing.assert_array_equal(*(table.samples[:, :used] for table in tables))


def test_filling_leaves_what_others_look_at_where_it_is():
    table = _skins("hfx-pressure-1")[0].table
    table.need(np.array([0, 1]))
    known, samples = table_of(table), table.samples
    kept = samples.copy()
    table.need(np.arange(60))
    assert table.samples is not samples and table_of(table) is not known
    np.testing.assert_array_equal(samples, kept)
    assert any(each is samples for each in known.kept) and known.samples == samples.ctypes.data


def _grown(skin: SkinCoverage) -> tuple[SkinTable, list[SkinnedModel]]:
    """The skin on a body that is not quite the model: its bones are, its vertices are moved."""
    bound = []
    for model, clusters in ((skin.surface, skin.outlines), (skin.model, skin.clusters)):
        move = np.random.default_rng(3).uniform(0.98, 1.03, model.vertices.shape)
        moved = replace(model, vertices=(model.vertices * move).astype(np.float32))
        bound.append(SkinnedModel(moved, SkinBinding(model.bone_names), clusters))
    return skin.table, bound


@pytest.mark.parametrize("name", NAMES)
def test_groups_of_cells_are_those_of_numpy(name):
    skin, _ = _skins(name)
    table, (surface, vertices) = _grown(skin)
    sizes = CellSizes(table, surface, None if skin.surface is skin.model else vertices)
    clusters = np.arange(len(skin.clusters))[::7]
    sizes.pointers(clusters[:2])
    sizes.pointers(clusters)
    assert sizes.pointers(clusters)[1].count == 0 or 1 in clusters
    for cluster in clusters.tolist():
        starts, *found = sizes._native.arrays_of(cluster)
        expected = sizes._of(cluster)
        np.testing.assert_array_equal(np.diff(starts), expected.counts)
        np.testing.assert_array_equal(found[2], expected.bones)
        others = expected.distances, expected.boxes, expected.shares, expected.changes
        for one, other in zip((*found[:2], *found[3:]), others, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
        assert sizes.pointers(clusters)[cluster].count == len(expected.counts)


def test_corners_are_listed_by_their_vertices():
    mesh = SkinMesh.of(sheet(3))
    for vertex in range(len(mesh.vertices)):
        corners = mesh.corners[mesh.starts[vertex] : mesh.starts[vertex + 1]]
        assert (mesh.triangles.ravel()[corners] == vertex).all() and (np.diff(corners) > 0).all()
    assert len(np.unique(mesh.corners)) == mesh.triangles.size


@pytest.mark.parametrize("corner", [-1, 9])
def test_a_triangle_of_no_vertex_is_refused_before_it_is_looked_at(corner):
    model = sheet(2)
    model.triangles[3, 1] = corner
    with pytest.raises(ValueError):
        SkinMesh.of(model)


def test_several_skins_of_a_model_share_its_weights():
    model = ball(0.1, 1)
    one, other = (BoundWeights.of(model, BONES) for _ in range(2))
    assert one is other
    assert BoundWeights.of(model, (*BONES, "more")) is not one
    assert BoundWeights.of(replace(model), BONES) is not one
