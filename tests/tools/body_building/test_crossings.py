# SPDX-License-Identifier: GPL-3.0-or-later
"""Search for self-intersections of a mesh, and repair of coarse limbs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS, RIGHT
from hfx_tools.body_building.left_skin import Samples
from hfx_tools.body_building.meshes import mesh_edges, mesh_edit, uncross
from hfx_tools.body_building.meshes.crossings import crossings, depth_m, pierced

FLOOR = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
NEEDLE = [[0.2, 0.2, -0.5], [0.2, 0.2, 0.5], [2.0, 2.0, 0.5]]
TWO = np.array([[0, 1, 2], [3, 4, 5]])


def test_crossings_are_found_and_neighbours_are_none() -> None:
    points = np.array(FLOOR + NEEDLE)
    # The cut starts where 3-4 goes through the floor and ends where the floor's 1-2 goes out.
    rows = [sorted(row[:2]) + sorted(row[2:]) for row in crossings(points, TWO).tolist()]
    assert sorted(rows) == [[1, 2, 3, 4, 5], [3, 4, 0, 1, 2]]
    assert not len(crossings(points + np.repeat([[0, 0, 0], [0, 0, 0.6]], 3, axis=0), TWO))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.02, 0.3, 3.0]))
def test_they_are_those_that_trying_every_pair_finds(seed: int, largest: float) -> None:
    # Triangles of very different sizes: none may be too far away to be looked at.
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-2.0, np.log10(largest), (40, 1, 1))
    points = (rng.uniform(-0.5, 0.5, (40, 1, 3)) + size * rng.normal(size=(40, 3, 3))).reshape(
        -1, 3
    )
    triangles = np.arange(120).reshape(-1, 3)
    ends = mesh_edges.edges_of(triangles, 120).ends
    edge, triangle = (index.ravel() for index in np.indices((len(ends), len(triangles))))
    every = pierced(points, ends[edge], triangles[triangle])
    assert sorted(crossings(points, triangles).tolist()) == sorted(every.tolist())


def test_the_depth_of_a_crossing_is_the_least_separating_move() -> None:
    points = np.array([*FLOOR, [0.2, 0.3, -0.05], [0.2, 0.3, 0.5], [0.2, 0.3, 0.9]])
    through = np.array([[3, 4, 0, 1, 2]])
    assert depth_m(points, through) == pytest.approx([0.05])  # push the lower end up
    points[3, 2] = -3.0
    assert depth_m(points, through) == pytest.approx([0.2])  # out over the edge x = 0
    assert depth_m(points, np.zeros((0, 5), np.int64)).shape == (0,)


def coarse_half() -> SimpleNamespace:
    """Return the left half of the temperature model, as at the end of remeshing."""
    shipped, fine = (model.load_model(f"hfx-{name}-1") for name in ("temperature", "pressure"))
    left, fine_left = (np.flatnonzero(item.side != RIGHT) for item in (shipped, fine))
    inside = shipped.triangles[(shipped.side[shipped.triangles] != RIGHT).all(axis=1)]
    targets = shipped.provenance["targets_mm"]
    return SimpleNamespace(
        points=shipped.vertices[left].astype(float),
        normals=shipped.normals[left].astype(float),
        triangles=np.searchsorted(left, inside),
        part=shipped.part[left],
        is_midline=shipped.side[left] == 0,
        spacing_m=np.array([targets[part] for part in PARTS]) / 1000.0,
        samples=Samples(
            fine.vertices[fine_left].astype(float),
            fine.normals[fine_left].astype(float),
            fine.areas_m2[fine_left].astype(float),
            fine.part[fine_left],
            fine_left,
        ),
    )


def tangled(mesh: SimpleNamespace) -> None:
    """Flip edges on the lower leg until two triangles intersect."""
    leg = mesh.part == PARTS.index("lower_leg")
    rng = np.random.default_rng(0)
    for turn in range(50):
        edges = mesh_edges.edges_of(mesh.triangles, len(mesh.points))
        inner = np.flatnonzero(~edges.is_border & leg[edges.ends].all(axis=1))
        flipped, _ = mesh_edit.flip(
            mesh.points, mesh.triangles, edges, rng.permutation(inner)[:1], mesh.is_midline, turn,
            normals=mesh.normals,
        )  # fmt: skip
        if len(crossings(mesh.points, flipped)):
            mesh.triangles = flipped
            return
        mesh.triangles = flipped
    raise AssertionError("nothing crosses")


def test_a_coarse_limb_is_freed_and_stays_one_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncross, "STEPS", 600)  # enough for a single crossing
    mesh = coarse_half()
    tangled(mesh)
    before, points = mesh_edges.edges_of(mesh.triangles, len(mesh.points)), mesh.points.copy()
    uncross.uncross(mesh)
    assert not len(crossings(mesh.points, mesh.triangles))
    after = mesh_edges.edges_of(mesh.triangles, len(mesh.points))
    assert len(after.ends) == len(before.ends)
    assert np.array_equal(after.ends[after.is_border], before.ends[before.is_border])
    directed = mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)
    moved = np.linalg.norm(mesh.points - points, axis=1)
    assert moved.max() <= 0.2 * 0.15 + 1e-9
    assert not moved[mesh.spacing_m[mesh.part] < uncross.COARSE_M].any()


def test_a_mesh_without_coarse_parts_is_left_alone() -> None:
    mesh = coarse_half()
    tangled(mesh)
    mesh.spacing_m = np.full(len(PARTS), 0.05)
    before = mesh.triangles.copy()
    uncross.uncross(mesh)
    assert np.array_equal(mesh.triangles, before)
