# SPDX-License-Identifier: GPL-3.0-or-later
"""Preparation of a body model before evaluation, compared with the reference."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from both_ways import needs_library
from coverage_synthetic import ball, sheet
from distorted_scenes import load
from engine_synthetic import BONES
from hypothesis import given, settings
from hypothesis import strategies as st
from moving_scenes import moving_scene

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights
from hfx_blender.engine.counters import Counters
from hfx_blender.engine.reference.cells import Fineness, Samples, Skin, cells_of
from hfx_blender.engine.reference.pose import world_points
from hfx_blender.engine.scene import SkinBinding
from hfx_blender.engine.skin.cell_coverage import BoundSkins, SkinCoverage, finer_id
from hfx_blender.engine.skin.posing import clusters_of
from hfx_blender.engine.skin.skin_table import SkinMesh
from hfx_blender.engine.skin.skinned_model import BoundWeights, SkinnedModel
from hfx_blender.engine.tolerance import STANDARD, Tolerance

pytestmark = needs_library

FINE = Tolerance("fine", 0.001, 0.25, 0.002, 0.0)


def crumpled(seed: int, count: int = 260) -> PerceptualModel:
    """Return random triangles and weights: some triangles flat, repeated, in fans or on shared
    edges.
    """
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


def _skin(name: str, tolerance: Tolerance = STANDARD) -> SkinCoverage:
    if name == "ball":
        return SkinCoverage(ball(0.1, 3), tolerance)
    if name.isdigit():
        return SkinCoverage(crumpled(int(name)), tolerance)
    model = load(name)
    fine = finer_id(model, tolerance)
    return SkinCoverage(model, tolerance, None if fine is None else load(fine))


NAMES = ("ball", "hfx-temperature-1", "1")


# Clusters


def _halved(ids: np.ndarray, points: np.ndarray, load: np.ndarray, most: int) -> list[list[int]]:
    """Return halves at the median of the longest axis, recursively."""
    if len(ids) <= 1 or load[ids].sum() <= most:
        return [sorted(ids.tolist())]
    axis = np.argmax(np.ptp(points[ids], axis=0))
    ids = ids[np.argsort(points[ids, axis], kind="stable")]
    parts = np.split(ids, [len(ids) // 2])
    return [cluster for part in parts for cluster in _halved(part, points, load, most)]


def _clusters_of(model: PerceptualModel, load: np.ndarray | None) -> list[list[int]]:
    label = 4 * model.part.astype(int) + model.side
    load = np.ones(len(model), int) if load is None else load
    parts = (np.flatnonzero(label == value) for value in np.unique(label))
    return [item for part in parts for item in _halved(part, model.vertices, load, 128)]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(0, 300),
    digits=st.sampled_from([0, 1, 7]),
    heaviest=st.sampled_from([None, 0, 1, 5, 50, 300]),
)
def test_clusters_are_halves_of_halves(seed, count, digits, heaviest):
    """Includes many vertices with a common coordinate, and clusters from one vertex to a whole
    part.
    """
    rng = np.random.default_rng(seed)
    vertices = np.round(rng.normal(0.0, 1.0, (count, 3)), digits).astype(np.float32)
    vertices[rng.random((count, 3)) < 0.1] = -0.0
    parts = np.arange(count) % 3 if count else np.zeros(0)
    model = replace(
        sheet(2), vertices=vertices, part=parts.astype(np.uint8), side=np.zeros(count, np.uint8)
    )
    load = None if heaviest is None else rng.integers(0, heaviest + 1, count)
    actual = clusters_of(model, load)
    assert [entry.tolist() for entry in actual] == _clusters_of(model, load)


def test_clusters_of_a_shipped_model_are_halves_of_halves():
    model = load("hfx-pressure-1")
    assert [item.tolist() for item in clusters_of(model)] == _clusters_of(model, None)


# Bones


def _clusters(model: PerceptualModel, seed: int) -> list[np.ndarray]:
    """Return unordered clusters of some vertices; some vertices are in two clusters."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 60, 12)
    return [rng.permutation(len(model))[:n].astype(np.int32) for n in sizes]


@pytest.mark.parametrize("seed", range(5))
def test_boxes_of_bones_contain_the_weighted_vertices(seed):
    model = crumpled(seed)
    weights, clusters = BoundWeights.of(model, ("extra", *BONES)), _clusters(model, seed)
    assert (weights.bones == weights.bone_count).any(), "some rest"
    starts, bones, low, high = weights.clusters(clusters).bone_boxes
    assert starts.dtype == bones.dtype == np.int64
    pair = 0
    for k, ids in enumerate(clusters):
        moved: dict[int, list[np.ndarray]] = {}
        for vertex in ids.tolist():
            for bone in weights.bones[weights.offsets[vertex] : weights.offsets[vertex + 1]]:
                moved.setdefault(int(bone), []).append(weights.rest[vertex, :3])
        assert starts[k] == pair
        for bone, places in sorted(moved.items()):
            assert bones[pair] == bone
            np.testing.assert_array_equal(low[pair], np.min(places, axis=0))
            np.testing.assert_array_equal(high[pair], np.max(places, axis=0))
            pair += 1


def _weights(bound, cluster):
    """Return weights (n, B) by vertex and bone of a cluster, and rest positions (n, 3)."""
    ids, bones, known = bound.clusters[cluster], bound.cluster_bones(cluster), bound._weights
    weights = np.zeros((len(ids), len(bones)))
    for k, vertex in enumerate(ids.tolist()):
        entries = slice(known.offsets[vertex], known.offsets[vertex + 1])
        weights[k, np.searchsorted(bones, known.bones[entries])] = known.values[entries]
    return weights, known.rest[ids, :3]


def _moved(bound, cluster):
    """Return mean weights of a cluster's bones, and homogeneous centre and radius of the box, (B,
    6).
    """
    weights, rest = _weights(bound, cluster)
    low, high = rest.min(axis=0), rest.max(axis=0)
    box = [*(0.5 * (low + high)), 1.0, 0.5 * np.linalg.norm(high - low)]
    return np.stack([[mean, *box] for mean in weights.mean(axis=0)])


def _read(address, kind, *shape):
    """Return the array at an address."""
    count = int(np.prod(shape))
    return np.frombuffer((ctypes.c_char * (8 * count)).from_address(address), kind).reshape(shape)


def _arrays(pointers, bound, cluster, units=0):
    """Return the arrays of an ``hfx_cluster`` in declared order."""
    ids, bones = bound.clusters[cluster], len(bound.cluster_bones(cluster))
    entries = int(np.diff(bound._weights.offsets)[ids].sum())
    shapes = {"entry_bones": (entries,), "weights": (entries,), "firsts": (len(ids) + 1,)}
    shapes |= {"rest": (len(ids), 4), "bones": (bones,), "moved": (bones, 6)}
    shapes |= {"distances": (units,), "differences": (bones, units), "extents": (units,)}
    shapes |= {"farthest": (1 + bones,)}
    longs = "entry_bones", "firsts", "bones"
    return [
        _read(getattr(pointers, name), np.int64 if name in longs else np.float64, *shape)
        for name, shape in shapes.items()
    ]


@pytest.mark.parametrize("seed", range(5))
def test_bone_influence_on_clusters(seed):
    model = crumpled(seed)
    bound = SkinnedModel(model, SkinBinding(BONES), _clusters(model, seed))
    native_clusters = bound.native_clusters(np.array([11, 3, 4]))
    native_clusters = bound.native_clusters(np.array([4, 0, 11]))
    for cluster in (0, 3, 4, 11):
        ids, bones, known = bound.clusters[cluster], bound.cluster_bones(cluster), bound._weights
        arrays = _arrays(native_clusters.table[cluster], bound, cluster)
        indices = np.concatenate([np.arange(*known.offsets[v : v + 2]) for v in ids])
        np.testing.assert_array_equal(bones[arrays[0]], known.bones[indices])
        np.testing.assert_array_equal(arrays[1], known.values[indices])
        np.testing.assert_array_equal(np.diff(arrays[2]), np.diff(known.offsets)[ids])
        np.testing.assert_array_equal(arrays[3], known.rest[ids])
        np.testing.assert_array_equal(arrays[4], bones)
        np.testing.assert_allclose(arrays[5], _moved(bound, cluster), rtol=1e-12, atol=1e-15)
        assert native_clusters.table[cluster].bone_count == len(bones)
    assert not native_clusters.table[1].weights, "nobody asked for it"


@pytest.mark.parametrize("name", ["ball", "1"])
def test_neighbours_learnt_later_have_arrays_of_their_own(name):
    skin = _skin(name)
    bound, indices = (
        SkinnedModel(skin.surface, SkinBinding(BONES), skin.outlines),
        np.array([0, 1]),
    )
    units = int(skin.table.unit_counts[0])
    before = _arrays(bound.native_clusters(indices).table[0], bound, 0, units)[6:]
    skin.table.need(indices)
    after = _arrays(bound.native_clusters(indices, skin.table).table[0], bound, 0, units)
    assert not any(array.any() for array in before)
    weights, rest = _weights(bound, 0)
    quads = skin.table.quad_starts[: units + 1]
    by_bone = after[7]
    for unit in range(units):
        around = skin.table.around[quads[unit] : quads[unit + 1]].ravel()
        distances = np.linalg.norm(rest[around] - rest[unit], axis=1)
        assert after[6][unit] == pytest.approx(distances.max(initial=0.0), rel=1e-12)
        differences = np.abs(weights[around] - weights[unit]).max(axis=0, initial=0.0)
        np.testing.assert_allclose(by_bone[:, unit], differences, rtol=1e-12, atol=1e-15)
    assert len(after[6]) == units and after[6].any()
    # The extent is the farthest corner of a quad, with its bulge, over the reach.
    heights, reaches = skin.table.heights, skin.table.reaches[:units]
    for unit in range(units):
        far = 0.0
        for quad in range(*quads[unit : unit + 2]):
            edge, other, *inner = skin.table.quads[quad, :4]
            ways = rest[skin.table.around[quad]] - rest[unit]
            corners = edge * ways[0], other * ways[1], np.array(inner) @ ways
            bulge = 2.0 * heights[quad] * after[6][unit]
            far = max(far, *(np.linalg.norm(corner) + bulge for corner in corners))
        extent = min(far, after[6][unit] * reaches[unit])
        assert after[8][unit] * reaches[unit] == pytest.approx(extent, rel=1e-8)
    assert (after[8] <= after[6]).all() and (after[8] < 0.99 * after[6]).any()
    most = [(after[8] * reaches).max(), *(by_bone * reaches).max(axis=1)]
    np.testing.assert_array_equal(after[9], most)


# Skin


def _samples(skin: SkinCoverage, cluster: int) -> Samples:
    """Return reference samples for the cells of one cluster, ordered by corners."""
    of_model = Skin.of(skin.model, skin.finer)
    fineness = Fineness(skin.tolerance.spacing_share, most_m=skin.tolerance.distance_m)
    blocks = list(cells_of(of_model, fineness).samples(skin.clusters[cluster].astype(np.int64)))
    names = ("cells", "corners", "shares", "heights", "areas")
    columns = [np.concatenate([getattr(b, name) for b in blocks], axis=-1) for name in names]
    order = np.lexsort(columns[1][::-1])
    return Samples(*(column[..., order] for column in columns))


@pytest.mark.parametrize("name", NAMES)
def test_outlines_contain_corners_and_margins_contain_bulges(name):
    skin = _skin(name, FINE)
    assert skin.margins_m.any()
    mesh, owner = skin.surface, Skin.of(skin.model, skin.finer).owner
    for cluster in range(0, len(skin.clusters), 1 + len(skin.clusters) // 3):
        units = [np.flatnonzero(owner == cell) for cell in skin.clusters[cluster]]
        units = np.concatenate(units)
        around = mesh.triangles[np.isin(mesh.triangles, units).any(axis=1)]
        others = np.setdiff1d(around, units)
        assert skin.outlines[cluster].tolist() == [*units.tolist(), *others.tolist()]
        samples = _samples(skin, cluster)
        first, second, third = (mesh.vertices[corner].astype(float) for corner in samples.corners)
        sizes = np.sqrt(np.linalg.norm(np.cross(second - first, third - first), axis=1))
        assert np.abs(samples.heights * sizes).max() <= skin.margins_m[cluster] * (1.0 + 1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_a_filled_table_holds_the_samples_of_the_reference(name):
    skin = _skin(name, FINE)
    table, count = skin.table, len(skin.clusters)
    chosen = np.random.default_rng(5).permutation(count)[:3]
    table.need(chosen[:1])
    table.need(chosen)  # the rest, in a second step
    for cluster in chosen.tolist():
        expected = _samples(skin, cluster)
        units = table.starts[cluster] + np.arange(table.unit_counts[cluster])
        quads = np.arange(*table.quad_starts[[units[0], units[-1] + 1]])
        sizes = table.steps[quads] ** 2
        quad = np.repeat(quads, sizes)
        step = np.arange(len(quad)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        samples = table.samples[cluster]
        first, second, heights, areas = samples[:, table.sample_starts[quad] + step]
        places = np.stack([table.unit_of[quad], *table.around[quad].T])
        nothing = np.zeros(len(units))
        corners = np.concatenate([np.stack([units] * 3), places], axis=1)
        order = np.lexsort(table.vertices[corners][::-1])
        for actual, reference_value in (
            (table.cells[table.cell_of[corners[0]]], expected.cells),
            (table.vertices[corners], expected.corners),
            (np.concatenate([nothing, first]), expected.shares[1]),
            (np.concatenate([nothing, second]), expected.shares[2]),
            (np.concatenate([nothing, heights]), expected.heights),
            (np.concatenate([table.vertex_shares[units], areas]), expected.areas),
        ):
            np.testing.assert_allclose(actual[..., order], reference_value, rtol=1e-6, atol=1e-8)
        assert (table.finest[quads] >= table.steps[quads]).all()
        wholes = np.bincount(np.repeat(np.arange(len(quads)), sizes), areas, len(quads))
        np.testing.assert_allclose(table.wholes[quads], wholes, rtol=1e-9, atol=1e-12)


def test_filling_does_not_move_arrays_in_use():
    table = _skin("hfx-pressure-1").table
    table.need(np.array([0, 1]))
    samples, others = table.samples[0], table.samples[1]
    before, address = samples.copy(), int(table.blocks[0])
    table.need(np.arange(60))
    assert table.samples[0] is samples is others and table.samples[2] is not samples
    assert table.blocks[0] == address == samples.ctypes.data
    np.testing.assert_array_equal(samples, before)


def _cell_mean(groups, posed):
    """Return the bound of ``hfx_groups`` under bone matrices (B, 3, 4); see ``CellGroups``."""
    starts = _read(groups.starts, np.int64, groups.count + 1)
    distances = _read(groups.distances, np.float64, groups.count)
    boxes = _read(groups.boxes, np.float64, groups.count, 2, 3)
    bones = _read(groups.bones, np.int64, starts[-1])
    shares, changes = (_read(at, np.float64, starts[-1]) for at in (groups.shares, groups.changes))
    signs = 2.0 * np.indices((2, 2, 2)).reshape(3, 8) - 1.0
    most = 0.0
    for group, (middle, half) in enumerate(boxes):
        mine = slice(starts[group], starts[group + 1])
        matrices = posed[bones[mine]]
        corners = np.concatenate([middle[:, None] + half[:, None] * signs, np.ones((1, 8))])
        apart = (matrices - np.einsum("p,pij->ij", shares[mine], matrices)) @ corners
        stretch = np.linalg.norm(matrices[..., :3], 2, axis=(1, 2)).max()
        bent = 0.0
        if len(matrices) > 1:
            bent = float(changes[mine] @ np.linalg.norm(apart, axis=1).max(axis=1))
        most = max(most, stretch * distances[group] + bent)
    return most


@pytest.mark.parametrize("modality", ["pressure", "temperature"])
def test_cells_are_no_larger_than_their_groups_say(modality):
    """Mean distances of posed skin from the cell's vertex, with bending and stretching bones."""
    model = load(f"hfx-{modality}-1")
    scene, block = moving_scene(model, 5, 0.4, 1.0)
    body, pose = scene.bodies[0], block.poses[0]
    skin = BoundSkins(load, STANDARD, Counters()).of(body, model.id)
    indices = np.arange(len(skin.skin.clusters))[::23]
    skin.cell_groups(indices[:2])
    still = np.eye(4)[None, :3]
    posed = pose.to_world[2, :3, :3] @ np.concatenate([pose.bones[2], still])
    groups = skin.cell_groups(indices)
    bounds = np.array([_cell_mean(groups[cluster], posed) for cluster in indices.tolist()])
    surface, own = (world_points(m, body.binding, pose, 2) for m in (skin.skin.surface, model))
    shares = []
    for cluster, bound in zip(indices.tolist(), bounds.tolist(), strict=True):
        samples = _samples(skin.skin, cluster)
        away = np.linalg.norm(samples.posed(surface, 1.0) - own[:, samples.cells], axis=0)
        shares.append(np.bincount(samples.cells, samples.areas * away).max() / bound)
    assert 0.2 < max(shares) <= 1.0


def test_corners_are_listed_by_their_vertices():
    mesh = SkinMesh.of(sheet(3))
    for vertex in range(len(mesh.vertices)):
        corners = mesh.corners[mesh.starts[vertex] : mesh.starts[vertex + 1]]
        assert (mesh.triangles.ravel()[corners] == vertex).all() and (np.diff(corners) > 0).all()
    assert len(np.unique(mesh.corners)) == mesh.triangles.size


@pytest.mark.parametrize("corner", [-1, 9])
def test_an_out_of_range_triangle_is_refused_before_use(corner):
    model = sheet(2)
    model.triangles[3, 1] = corner
    with pytest.raises(ValueError):
        SkinMesh.of(model)


def test_several_skins_of_a_model_share_its_weights():
    model = ball(0.1, 1)
    first, second = (BoundWeights.of(model, BONES) for _ in range(2))
    assert first is second
    assert BoundWeights.of(model, (*BONES, "more")) is not first
    assert BoundWeights.of(replace(model), BONES) is not first
