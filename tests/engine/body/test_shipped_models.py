# SPDX-License-Identifier: GPL-3.0-or-later
"""Shipped perceptual models meet the requirements of the literature and of the product."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import CENTRE, LEFT, PARTS, RIGHT
from hfx_blender.files import resources
from hfx_tools.body_building import stats, thresholds
from hfx_tools.body_building.meshes.crossings import crossings

IDS = ("hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1")
FINE = IDS[:2]  # temperature cells are wider than limbs


@pytest.fixture(params=IDS)
def shipped(request: pytest.FixtureRequest) -> model.PerceptualModel:
    return model.load_model(request.param)


def undirected(triangles: np.ndarray) -> np.ndarray:
    return np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)


def test_the_manifest_lists_exactly_the_three_models() -> None:
    assert tuple(model.manifest()["models"]) == IDS
    assert model.manifest()["version"] == 1


def test_everything_together_is_at_most_8_megabytes() -> None:
    assert sum(path.stat().st_size for path in resources.body_models().iterdir()) <= 8e6


def test_hash_and_count_are_those_of_the_manifest(shipped: model.PerceptualModel) -> None:
    entry = model.manifest()["models"][shipped.id]
    assert entry["hash"] == shipped.content_hash
    assert entry["vertices"] == len(shipped)
    assert entry["modality"] == shipped.modality
    assert entry["licence"] == shipped.provenance["licence"] == "CC0-1.0"


def test_every_array_has_the_type_that_the_format_states(shipped: model.PerceptualModel) -> None:
    for name in ("vertices", "normals", "areas_m2", "avatar_weights", "avatar_offset_m"):
        assert getattr(shipped, name).dtype == np.float32, name
    for name in ("triangles", "mirror", "avatar_vertices"):
        assert getattr(shipped, name).dtype == np.int32, name
    assert shipped.part.dtype == shipped.side.dtype == np.uint8


def test_the_surface_is_closed_oriented_and_without_handles(
    shipped: model.PerceptualModel,
) -> None:
    triangles = shipped.triangles.astype(np.int64)
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in directed.tolist()}
    assert len(forward) == len(directed), "two triangles run along an edge in one direction"
    assert forward == {(end, start) for start, end in forward}, "a hole"
    assert len(np.unique(triangles)) == len(shipped)
    euler = len(shipped) - len(forward) // 2 + len(triangles)
    assert euler == 2
    assert not len(triangles) - len(np.unique(np.sort(triangles, axis=1), axis=0))


def test_triangles_form_one_ring_around_each_vertex(shipped: model.PerceptualModel) -> None:
    # A pinched vertex would pass the count of edges: the triangles at a vertex must form one ring.
    follower: list[dict[int, int]] = [{} for _ in range(len(shipped))]
    for a, b, c in shipped.triangles.tolist():
        follower[a][b], follower[b][c], follower[c][a] = c, a, b
    for ring in follower:
        start = next(iter(ring))
        vertex, steps = ring[start], 1
        while vertex != start:
            vertex, steps = ring[vertex], steps + 1
        assert steps == len(ring)


def test_models_face_outward_with_the_volume_of_a_person(
    shipped: model.PerceptualModel,
) -> None:
    a, b, c = (shipped.vertices[shipped.triangles[:, k]].astype(float) for k in range(3))
    litres = 1000.0 * np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert (40.0 if shipped.modality == "temperature" else 60.0) < litres < 85.0
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), shipped.normals[shipped.triangles[:, 0]])
    assert (facing > 0.0).mean() > (0.9 if shipped.modality == "temperature" else 0.999)
    assert np.linalg.norm(shipped.normals, axis=1) == pytest.approx(1.0, abs=1e-5)


def test_models_do_not_cross_themselves(shipped: model.PerceptualModel) -> None:
    vertices, triangles = shipped.vertices.astype(float), shipped.triangles.astype(np.int64)
    # The model is symmetric: any crossing also occurs where x >= 0.
    mirrored = shipped.mirror[triangles]
    assert set(map(frozenset, mirrored.tolist())) == set(map(frozenset, triangles.tolist()))
    assert not len(crossings(vertices, triangles[vertices[triangles, 0].max(axis=1) >= 0.0]))


def test_no_triangle_is_degenerate(shipped: model.PerceptualModel) -> None:
    a, b, c = (shipped.vertices[shipped.triangles[:, k]].astype(float) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    longest = np.max([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)], axis=0)
    assert (2.0 * area / longest**2).min() > 0.01


def test_left_and_right_mirror_each_other_to_the_bit(shipped: model.PerceptualModel) -> None:
    mirror = shipped.mirror
    assert np.array_equal(mirror[mirror], np.arange(len(shipped)))
    flipped = shipped.vertices[mirror] * np.array([-1, 1, 1], np.float32)
    assert np.array_equal(flipped, shipped.vertices)
    assert np.array_equal(shipped.part[mirror], shipped.part)
    assert np.array_equal(shipped.areas_m2[mirror], shipped.areas_m2)
    swapped = np.array([CENTRE, RIGHT, LEFT])
    assert np.array_equal(swapped[shipped.side[mirror]], shipped.side)
    faces = {tuple(face) for face in np.sort(shipped.triangles, axis=1).tolist()}
    assert faces == {tuple(face) for face in np.sort(mirror[shipped.triangles], axis=1).tolist()}


def test_sides_agree_with_x(shipped: model.PerceptualModel) -> None:
    x = shipped.vertices[:, 0]
    assert np.array_equal(shipped.side == CENTRE, x == 0.0)
    assert np.array_equal(shipped.side == LEFT, x > 0.0)
    on_axis = shipped.mirror == np.arange(len(shipped))
    assert np.array_equal(on_axis, shipped.side == CENTRE)


@pytest.mark.parametrize("side", (LEFT, RIGHT))
def test_each_part_of_a_side_is_one_connected_piece(
    shipped: model.PerceptualModel, side: int
) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = undirected(shipped.triangles)
    for number, part in enumerate(PARTS):
        chosen = (shipped.part == number) & np.isin(shipped.side, (side, CENTRE))
        inside = edges[chosen[edges].all(axis=1)]
        size = (len(shipped),) * 2
        graph = coo_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), shape=size)
        labels = connected_components(graph, directed=False)[1][chosen]
        assert len(np.unique(labels)) == 1, f"{part}: {np.unique(labels, return_counts=True)[1]}"


@pytest.mark.parametrize("identity", FINE)
def test_the_spacing_is_the_literatures_and_even(identity: str) -> None:
    shipped = model.load_model(identity)
    mean_m, sd_m = stats.spacing_m(shipped)
    targets_mm = thresholds.LITERATURE_MM[shipped.modality]
    for part, mean, sd, target in zip(PARTS, 1000 * mean_m, 1000 * sd_m, targets_mm, strict=True):
        assert mean == pytest.approx(target, rel=0.015), part
        assert sd / mean <= 0.15, part


@pytest.mark.parametrize("identity", FINE)
def test_no_skin_is_farther_than_nine_tenths_of_the_threshold(identity: str) -> None:
    from scipy.spatial import cKDTree

    shipped = model.load_model(identity)
    avatar = model.load_avatar()
    # The avatar's vertices are on the skin, and much denser than most parts of a model.
    distance = 1000.0 * cKDTree(shipped.vertices).query(avatar.vertices)[0]
    for number, target in enumerate(thresholds.LITERATURE_MM[shipped.modality]):
        assert distance[avatar.part == number].max() <= 0.9 * target, PARTS[number]
    # Statistics of the build on the dense skin, also between the avatar's vertices.
    for part, facts in shipped.provenance["statistics"].items():
        assert facts["gap_mm"] <= 0.9 * facts["target_mm"], part


def test_temperature_cells_on_the_limbs_are_as_many_as_fit() -> None:
    shipped = model.load_model("hfx-temperature-1")
    expected = {"upper_arm": 4, "forearm": 3, "upper_leg": 11, "lower_leg": 7}
    for part, count in expected.items():
        of_part = (shipped.part == PARTS.index(part)) & (shipped.side == LEFT)
        assert abs(of_part.sum() - count) <= 1, part


def test_areas_add_up_to_the_skin_of_an_adult(shipped: model.PerceptualModel) -> None:
    # Mosteller 1987 for 180 cm and 60 to 90 kg: 1.73 to 2.12 m^2.
    assert 1.7 < shipped.areas_m2.sum() < 2.1
    assert shipped.areas_m2.min() > 0.0


@pytest.mark.parametrize("identity", FINE)
def test_areas_are_those_of_even_cells(identity: str) -> None:
    shipped = model.load_model(identity)
    for number, target in enumerate(thresholds.LITERATURE_MM[shipped.modality]):
        mean = shipped.areas_m2[shipped.part == number].mean()
        assert mean == pytest.approx(np.sqrt(0.75) * (target / 1000.0) ** 2, rel=0.25)


def test_skin_weights_sum_to_one_in_sorted_rows(shipped: model.PerceptualModel) -> None:
    weights = shipped.weights
    assert weights.offsets[0] == 0 and weights.offsets[-1] == len(weights.values)
    assert (np.diff(weights.offsets) > 0).all()
    assert (weights.values > 0.0).all()
    sums = np.add.reduceat(weights.values.astype(float), weights.offsets[:-1])
    assert sums == pytest.approx(1.0, abs=1e-6)
    row = np.repeat(np.arange(len(shipped)), np.diff(weights.offsets))
    ascending = (np.diff(weights.bones) > 0) | (np.diff(row) > 0)
    assert ascending.all()
    assert shipped.bone_names == model.load_avatar().skeleton.bone_names


def test_ids_near_each_other_are_places_near_each_other(shipped: model.PerceptualModel) -> None:
    # Tracks store ids as differences: a patch of skin must be few runs of ids.
    block = shipped.part.astype(int) * 3 + shipped.side
    assert (np.diff(block) >= 0).all()
    steps = np.abs(np.diff(undirected(shipped.triangles).astype(int), axis=1))
    inside = block[undirected(shipped.triangles)]
    steps = steps[inside[:, 0] == inside[:, 1]]
    assert np.median(steps) <= 2.0 * np.sqrt(len(shipped))


def test_avatar_places_lead_back_to_the_vertices(shipped: model.PerceptualModel) -> None:
    avatar = model.load_avatar()
    assert shipped.avatar_weights.sum(axis=1) == pytest.approx(1.0, abs=1e-6)
    assert shipped.avatar_weights.min() >= 0.0
    corners = avatar.vertices[shipped.avatar_vertices].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    products = np.einsum("ij,ijk->ik", shipped.avatar_weights, corners)
    products += shipped.avatar_offset_m[:, None] * normal
    missed = np.linalg.norm(products - shipped.vertices, axis=1)
    # Near a ridge the nearest point is on an edge, in a direction off the normal.
    assert np.percentile(missed, 99) < 3e-4 and missed.max() < 2e-3
    assert np.abs(shipped.avatar_offset_m).max() < 6e-3
