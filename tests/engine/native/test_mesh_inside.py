# SPDX-License-Identifier: GPL-3.0-or-later
"""Points inside a mesh: the compiled test equals numpy and the winding number."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_twins import MESHES, needs_library, probes, twins

from hfx_blender.engine.volume import mesh_inside
from hfx_blender.engine.volume.mesh_inside import bounds_in_columns

pytestmark = needs_library


@pytest.mark.parametrize("name", MESHES)
def test_every_point_agrees_with_numpy(name: str) -> None:
    vertices, triangles = MESHES[name]
    compiled, plain = twins(vertices, triangles)
    points = probes(vertices, triangles)
    expected = plain.contains(points)
    assert 20 < np.count_nonzero(expected) < expected.size - 20
    actual = compiled.contains(points)
    assert actual.dtype == np.bool_
    np.testing.assert_array_equal(actual, expected)


@settings(max_examples=25, deadline=None)
@given(
    corners=st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=12, max_size=12, unique=True),
    shift=st.sampled_from([0.0, 0.5, 0.25]),
)
def test_points_on_the_lattice_of_the_corners_agree(corners, shift) -> None:
    """Vertical rays hit corners, edges and upright faces; faces may be slivers or coincide."""
    vertices = np.array(corners, np.float64)
    if np.ptp(vertices, axis=0).min() == 0.0:
        return
    compiled, plain = twins(vertices, np.array(trimesh.creation.icosphere(0).faces, np.int32))
    points = np.stack(np.meshgrid(*[np.arange(-3.0, 4.0) + shift] * 3), axis=0).reshape(3, -1)
    np.testing.assert_array_equal(compiled.contains(points), plain.contains(points))


@pytest.mark.parametrize("name", ["a torus", "rough", "cuts through itself", "doubled", "hollow"])
def test_the_winding_number_says_the_same(name: str) -> None:
    vertices, triangles = MESHES[name]
    compiled, _ = twins(vertices, triangles)
    points = probes(vertices, triangles)
    points = points[:, np.isfinite(points).all(axis=0) & (np.abs(points) < 10).all(axis=0)].T
    faces = triangles.astype(np.int64)
    squared = igl.point_mesh_squared_distance(points, vertices, faces)[0]
    sure = points[squared > 1e-18]
    winding = igl.winding_number(vertices, faces, sure)
    assert len(sure) > 1000
    np.testing.assert_array_equal(compiled.contains(sure.T), np.abs(winding) > 0.5)


def test_any_number_of_points_however_they_lie_in_memory() -> None:
    vertices, triangles = MESHES["a torus"]
    compiled, plain = twins(vertices, triangles)
    points = probes(vertices, triangles)
    for count in (0, 1, 2, 63, 64, 65, 129):  # around the size of a block
        point = points[:, :count]
        assert compiled.contains(point).shape == (count,)
        np.testing.assert_array_equal(compiled.contains(point), plain.contains(point))
    rows = np.ascontiguousarray(points.T)
    np.testing.assert_array_equal(compiled.contains(rows.T), plain.contains(points))


def test_columns_of_hundreds_of_triangles_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """One run per column: more pairs than the compiled test holds at once."""
    monkeypatch.setattr(mesh_inside, "CELLS_PER_AXIS", (1, 2))
    vertices, triangles = MESHES["overlaps"]
    compiled, plain = twins(vertices, triangles)
    assert np.diff(compiled.grid.run_offsets).max() > 400
    points = probes(vertices, triangles)
    np.testing.assert_array_equal(compiled.contains(points), plain.contains(points))


def test_bounds_of_a_triangle_stand_as_bytes() -> None:
    corners = np.array([[[2.25, 1.5, 0.0], [2.5, 1.75, 4.0], [2.25, 3.0, 2.0]]])
    one = np.zeros(1, np.int64)
    column = np.array([2 * 4 + 1])  # x from 2, y from 1; four to a row, eight cells high
    (packed,) = bounds_in_columns(corners, one, column, np.array([5, 4, 8]), 0.0)
    # Steps of 1/128: minimum of y and 127 minus the maximum, the same for x, only the maximum for
    # z; then (x + y) / 2, both, and (x - y) / 2 + 1 / 2, the minimum. Outside values are clamped.
    expected = [64, 0, 32, 127 - 64, 127 - 64, 48, 0, 0]
    assert list(int(packed).to_bytes(8, "little")) == expected
