# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh volumes against the exact winding number, and refusal of invalid meshes."""

import sys

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from volume_cases import MESHES, mesh, placing, rotation

from hfx_blender.engine.reference import shapes as reference
from hfx_blender.engine.volume import mesh_inside
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind
from hfx_blender.errors import InputError

LINEAR = Falloff(FalloffKind.LINEAR)


def to_surface(vertices, triangles, points):
    return np.sqrt(igl.point_mesh_squared_distance(points, vertices, triangles.astype(np.int64))[0])


def assert_agrees_with_winding_number(vertices, triangles, points, least_way):
    """Check inside tests of ``points`` (N, 3) farther from the surface than ``least_way``."""
    winding = igl.winding_number(vertices, triangles.astype(np.int64), points)
    sure = to_surface(vertices, triangles, points) > least_way
    inside = MeshVolume(vertices, triangles, "Oracle").contains(np.ascontiguousarray(points.T))
    np.testing.assert_array_equal(inside[sure], np.abs(winding[sure]) > 0.5)
    return np.count_nonzero(sure)


def probes(vertices, triangles, rng, count):
    """Return points where ray parity fails: above corners, edges and faces, in line with
    coordinates.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    anywhere = low + (high - low) * rng.random((count, 3))
    lattice = np.stack([rng.choice(vertices[:, k], count) for k in range(3)], axis=1)
    on_columns = anywhere.copy()
    axis = rng.integers(3, size=count)
    corner = vertices[rng.integers(len(vertices), size=count)]
    on_columns = np.where(np.arange(3) == axis[:, None], anywhere, corner)
    chosen = triangles[rng.integers(len(triangles), size=count)]
    middle = 0.5 * (vertices[chosen[:, 0]] + vertices[chosen[:, 1]])
    over_edges = np.where(np.arange(3) == axis[:, None], anywhere, middle)
    return np.concatenate([anywhere, lattice, on_columns, over_edges])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", MESHES)
def test_inside_is_exact(name, turned, rng):
    vertices, triangles = mesh(name, rng)
    if turned:
        vertices = vertices @ rotation(rng).T
    points = probes(vertices, triangles, rng, 250 if len(triangles) > 10_000 else 1000)
    judged = assert_agrees_with_winding_number(vertices, triangles, points, 1e-9)
    assert judged > 0.25 * len(points)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_inside_at_extreme_sizes_and_far_from_the_origin(scale, rng):
    vertices, triangles = mesh("cuts through itself", rng)
    points = probes(vertices, triangles, rng, 1000)
    assert_agrees_with_winding_number(scale * vertices, triangles, scale * points, 1e-9 * scale)
    far = vertices + 1e6
    assert_agrees_with_winding_number(far, triangles, points + 1e6, 1e-5)


def test_inside_of_one_with_axes_stretched_240_to_1(rng):
    vertices, triangles = mesh("needles", rng)
    stretch = np.array([240.0, 1.0, 1e-2])
    points = probes(vertices, triangles, rng, 1000)
    assert_agrees_with_winding_number(vertices * stretch, triangles, points * stretch, 1e-7)


@settings(max_examples=60, deadline=None)
@given(
    corners=st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=12, max_size=12, unique=True),
    shift=st.sampled_from([0.0, 0.5, 0.25]),
)
def test_inside_on_the_lattice_of_the_corners(corners, shift):
    """Every ray hits corners, edges and upright faces; faces may be slivers or coincide."""
    ball = trimesh.creation.icosphere(0)
    vertices = np.array(corners, np.float64)
    if np.ptp(vertices, axis=0).min() == 0.0:
        return
    points = np.stack(np.meshgrid(*[np.arange(-3.0, 4.0) + shift] * 3), axis=-1).reshape(-1, 3)
    assert_agrees_with_winding_number(vertices, np.array(ball.faces, np.int32), points, 1e-9)


def test_columns_alone_give_the_same_answer(rng, monkeypatch):
    """Slow twin: a single mixed run per column, a few pairs at a time."""
    vertices, triangles = mesh("cuts through itself", rng)
    points = np.ascontiguousarray(probes(vertices, triangles, rng, 2000).T)
    fast = MeshVolume(vertices, triangles, "A").contains(points)
    monkeypatch.setattr(mesh_inside, "CELLS", 1)
    monkeypatch.setattr(mesh_inside, "CELLS_PER_AXIS", (1, 1))
    monkeypatch.setattr(mesh_inside, "PAIRS_AT_ONCE", 700)
    slow = MeshVolume(vertices, triangles, "A").contains(points)
    np.testing.assert_array_equal(fast, slow)


def test_voxels_decide_most_points(rng):
    vertices, triangles = mesh("bumpy, 20480", rng)
    codes = MeshVolume(vertices, triangles, "A").grid.voxels
    assert np.mean(codes >= 0) < 0.12


def box(low, high):
    solid = trimesh.creation.box(bounds=[low, high])
    return np.asarray(solid.vertices), np.asarray(solid.faces)


def joined(*parts):
    vertices, triangles, count = [], [], 0
    for v, t in parts:
        vertices.append(v)
        triangles.append(t + count)
        count += len(v)
    return np.concatenate(vertices), np.concatenate(triangles).astype(np.int32)


LINE = np.stack([np.linspace(-0.45, 3.05, 36), np.full(36, 0.03), np.full(36, 0.07)])


def test_overlapping_shells_are_inside_and_hollows_are_outside():
    first, second = box((0, -1, -1), (2, 1, 1)), box((1, -0.5, -0.5), (3, 0.5, 0.5))
    x = LINE[0]
    union = MeshVolume(*joined(first, second), "Union")
    np.testing.assert_array_equal(union.contains(LINE), (x > 0) & (x < 3))
    hole_v, hole_t = box((0.5, -0.5, -0.5), (1.5, 0.5, 0.5))
    hollow = MeshVolume(*joined(first, (hole_v, hole_t[:, ::-1])), "Hollow")
    np.testing.assert_array_equal(
        hollow.contains(LINE), ((x > 0) & (x < 0.5)) | ((x > 1.5) & (x < 2))
    )
    twice = MeshVolume(*joined(first, first), "Twice")
    np.testing.assert_array_equal(twice.contains(LINE), (x > 0) & (x < 2))


def test_solids_that_touch_along_an_edge_or_a_face_are_closed():
    first = box((0, -1, -1), (1, 1, 1))
    x = LINE[0]
    for second in (box((1, -1, -1), (2, 1, 1)), box((1, 1, -1), (2, 2, 1))):
        volume = MeshVolume(*joined(first, second), "Touching")
        end = 2 if second[0][:, 1].max() == 1 else 1
        np.testing.assert_array_equal(volume.contains(LINE), (x > 0) & (x < end))


def test_mirrored_and_inside_out_meshes_are_fine(rng):
    vertices, triangles = mesh("bumpy, 20480", rng)
    points = probes(vertices, triangles, rng, 500).T
    expected = MeshVolume(vertices, triangles, "A").contains(points)
    inside_out = MeshVolume(vertices, triangles[:, ::-1], "A")
    np.testing.assert_array_equal(inside_out.contains(points), expected)
    flip = np.array([[-1.0], [1.0], [1.0]])
    mirrored = MeshVolume(vertices * flip.T, triangles, "A")
    np.testing.assert_array_equal(mirrored.contains(points * flip), expected)


def test_a_few_faces_that_face_the_wrong_way_are_turned(rng):
    vertices, triangles = mesh("sphere, 5120", rng)
    points = probes(vertices, triangles, rng, 500).T
    expected = MeshVolume(vertices, triangles, "A").contains(points)
    turned = np.where((rng.random(len(triangles)) < 0.3)[:, None], triangles[:, ::-1], triangles)
    np.testing.assert_array_equal(MeshVolume(vertices, turned, "A").contains(points), expected)


def test_a_single_flipped_face_does_not_flip_the_shell():
    outer, (inner, faces) = box((0, -1, -1), (2, 1, 1)), box((0.5, -0.5, -0.5), (1.5, 0.5, 0.5))
    vertices, triangles = joined(outer, (inner, faces[:, ::-1]))
    expected = MeshVolume(vertices, triangles, "Hollow").contains(LINE)
    for face in range(len(triangles)):
        turned = triangles.copy()
        turned[face] = turned[face, ::-1]
        np.testing.assert_array_equal(MeshVolume(vertices, turned, "A").contains(LINE), expected)


def test_corners_that_coincide_are_one_and_collapsed_faces_do_not_matter(rng):
    vertices, triangles = mesh("sphere, 5120", rng)
    points = probes(vertices, triangles, rng, 300).T
    expected = MeshVolume(vertices, triangles, "A").contains(points)
    soup = vertices[triangles].reshape(-1, 3)
    soup[soup == 0.0] *= -1.0  # negative zeros
    corners = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    collapsed = np.array([[0, 0, 1], [5, 5, 5]], np.int32)
    unused = np.array([[np.nan, 0.0, 0.0], [100.0, np.inf, -np.inf]])
    volume = MeshVolume(
        np.concatenate([soup, unused]), np.concatenate([corners, collapsed]), "Soup"
    )
    np.testing.assert_array_equal(volume.contains(points), expected)
    assert volume.bounds.max() <= 1.0 + 1e-12


@pytest.mark.filterwarnings("error")
def test_points_that_are_no_numbers_are_outside(rng):
    volume = MeshVolume(*mesh("sphere, 5120", rng), "A")
    points = np.array(
        [[np.nan, 0, 0, np.inf, 0, 1e300], [0, np.nan, 0, 0, -np.inf, 0], [0, 0, np.nan, 0, 0, 0]]
    )
    matrix = placing("sheared", rng)
    assert not volume.contains(points).any()
    np.testing.assert_array_equal(volume.depth_m(points, matrix), 0.0)
    nothing = np.zeros((3, 0))
    for result in (volume.contains(nothing), volume.depth_m(nothing, matrix)):
        assert result.shape == (0,)


def slow_distance(point, corners):
    """Distance to triangles (F, 3, 3): to planes with the foot inside, and to edges."""
    a, b, c = np.moveaxis(corners, 1, 0)
    sides = ((a, b), (b, c), (c, a))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(size > 0.0, size, 1.0)[:, None]
    foot = point - unit * ((point - a) * unit).sum(axis=1, keepdims=True)
    areas = [(np.cross(q - p, foot - p) * normal).sum(axis=1) for p, q in sides]
    inside = (size > 0.0) & (np.min(areas, axis=0) >= 0.0)
    best = np.linalg.norm(point - foot, axis=1)[inside].min(initial=np.inf)
    for p, q in sides:
        along = q - p
        square = (along * along).sum(axis=1)
        share = ((point - p) * along).sum(axis=1) / np.where(square > 0.0, square, 1.0)
        position = p + np.clip(share, 0.0, 1.0)[:, None] * along
        best = min(best, np.linalg.norm(point - position, axis=1).min())
    return best


@pytest.mark.parametrize(
    "kind", ["plain", "mirrored", "sheared", "needle", "squashed", "tiny", "huge"]
)
@pytest.mark.parametrize("name", ["cube, 12 triangles", "plate", "rod", "cuts through itself"])
def test_depth_is_the_distance_to_the_nearest_placed_triangle(name, kind, rng):
    vertices, triangles = mesh(name, rng)
    volume, matrix = MeshVolume(vertices, triangles, name), placing(kind, rng)
    matrix[:3, 3] = 1e6
    points = vertices.min(axis=0) + np.ptp(vertices, axis=0) * rng.random((400, 3))
    points = points[volume.contains(points.T)][:15]
    assert len(points)
    corners = (vertices @ matrix[:3, :3].T)[triangles]
    expected = [slow_distance(point, corners) for point in points @ matrix[:3, :3].T]
    depths = volume.depth_m(points.T, matrix)
    size = np.abs(corners).max()
    np.testing.assert_allclose(depths, expected, rtol=1e-9, atol=1e-13 * size)
    np.testing.assert_array_equal(volume.depth_m(points.T, matrix), depths)  # from memory


@pytest.mark.parametrize("name", ["bumpy, 20480", "torus, 27000", "needles"])
def test_depth_in_large_meshes(name, rng):
    vertices, triangles = mesh(name, rng)
    volume, matrix = MeshVolume(vertices, triangles, name), placing("sheared", rng)
    points = vertices.min(axis=0) + np.ptp(vertices, axis=0) * rng.random((3000, 3))
    points = points[volume.contains(points.T)][:200]
    linear = matrix[:3, :3]
    expected = to_surface(vertices @ linear.T, triangles, points @ linear.T)
    np.testing.assert_allclose(volume.depth_m(points.T, matrix), expected, atol=1e-7)


def test_depth_without_library_many_pairs_at_once(rng, monkeypatch):
    monkeypatch.setattr("hfx_blender.engine.volume.mesh_distance.library", lambda: None)
    volume = MeshVolume(*mesh("sphere, 5120", rng), "A")
    points = 0.05 * rng.normal(size=(3, 300))
    whole = volume.depth_m(points, np.eye(4))
    monkeypatch.setattr("hfx_blender.engine.volume.mesh_distance.PAIRS_AT_ONCE", 30000)
    np.testing.assert_array_equal(volume.depth_m(points, np.eye(4)), whole)


def test_depth_of_a_cuboid_mesh_is_that_of_the_cuboid(rng):
    from hfx_blender.engine.volume.analytic import Cuboid

    volume = MeshVolume(*box((-1, -1, -1), (1, 1, 1)), "Box")
    points = rng.uniform(-1.2, 1.2, size=(3, 2000))
    for kind in ("plain", "sheared", "needle", "squashed"):
        matrix = placing(kind, rng)
        expected = Cuboid().depth_m(points, matrix)
        size = np.abs(matrix[:3, :3]).max()
        np.testing.assert_allclose(volume.depth_m(points, matrix), expected, atol=1e-13 * size)
    expected = reference.strength(Cuboid(), LINEAR, points)
    np.testing.assert_allclose(reference.strength(volume, LINEAR, points), expected, atol=0.011)


@pytest.mark.parametrize(
    ("name", "parts", "radius"),
    [
        ("cube", [box((0, 0, 0), (2, 2, 2))], 1.0),
        ("plate", [box((0, 0, 0), (1, 1, 1e-3))], 5e-4),
        ("rod", [box((0, 0, 0), (1e-2, 1, 1e-2))], 5e-3),
        ("two rooms", [box((0, 0, 0), (1, 1, 1)), box((5, 5, 5), (5.8, 7, 7))], 0.5),
        # Inscribed sphere of the corner tetrahedron: 1 / (3 + sqrt 3).
        ("tetrahedron", [(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
                          np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))],
         1 / (3 + 3**0.5)),
    ],
)  # fmt: skip
def test_rise_reaches_one_at_the_core(name, parts, radius):
    volume = MeshVolume(*joined(*parts), name)
    assert 0.99 * radius <= volume.core_radius <= radius * (1 + 1e-12)
    again = MeshVolume(*joined(*parts), name)
    assert again.core_radius == volume.core_radius


def test_rise_by_hand():
    volume = MeshVolume(*box((-1, -1, -1), (1, 1, 1)), "Box")
    points = np.array([[0, 0, 0], [0.5, 0, 0], [0, -0.75, 0.1], [1.5, 0, 0]]).T
    strength = reference.strength(volume, LINEAR, points)
    np.testing.assert_allclose(strength, [1.0, 0.5, 0.25, 0.0], atol=0.01)
    assert strength.max() <= 1.0


CUBE = box((0, 0, 0), (1, 1, 1))


def test_an_open_mesh_reports_its_openness():
    with pytest.raises(InputError, match=r"^'Vase' is not closed: 4 of its 8 edges lack a face"):
        MeshVolume(*bowl(), "Vase")


def bowl():
    """Return the lower half of an octahedron; the opening is 0.58 of the mesh's area."""
    vertices = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1.0]])
    return vertices, np.array([[1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]], np.int32)


def test_small_holes_are_closed_and_reported(rng):
    points = rng.uniform(-0.2, 1.2, (3, 4000))
    inside = np.all((points > 0.0) & (points < 1.0), axis=0)
    for missing in range(12):
        volume = MeshVolume(CUBE[0], np.delete(CUBE[1], missing, axis=0), "Vase")
        assert volume.note == "'Vase' is open at 3 edges: 1 hole was filled for the volume"
        np.testing.assert_array_equal(volume.contains(points), inside)
    lid = np.all(np.isclose(CUBE[0][CUBE[1]][:, :, 2], 1.0), axis=1)
    without_lid = MeshVolume(CUBE[0], CUBE[1][~lid], "Box")
    assert np.count_nonzero(lid) == 2 and "4 edges" in without_lid.note
    np.testing.assert_array_equal(without_lid.contains(points), inside)
    assert MeshVolume(*CUBE, "Whole").note == ""


def test_bent_holes_are_closed_too(rng):
    """Away from a hole, results are equal; a mesh with hundreds of holes has an inside again."""
    vertices, triangles = mesh("sphere, 5120", rng)
    is_kept = rng.random(len(triangles)) < 0.97
    volume = MeshVolume(vertices, triangles[is_kept], "Sieve")
    assert 50 < int(volume.note.split("edges: ")[1].split()[0]) <= np.count_nonzero(~is_kept)
    points = rng.uniform(-1.1, 1.1, (3, 5000))
    far = np.abs(np.linalg.norm(points, axis=0) - 1.0) > 0.01
    expected = np.linalg.norm(points, axis=0) < 1.0
    np.testing.assert_array_equal(volume.contains(points)[far], expected[far])


def test_holes_of_a_mesh_with_turned_faces_are_closed(rng):
    vertices, triangles = mesh("sphere, 5120", rng)
    triangles = np.where((rng.random(len(triangles)) < 0.3)[:, None], triangles[:, ::-1], triangles)
    volume = MeshVolume(vertices, triangles[5:], "Turned")
    points = rng.uniform(-1.1, 1.1, (3, 2000))
    far = np.abs(np.linalg.norm(points, axis=0) - 1.0) > 0.01
    expected = np.linalg.norm(points, axis=0) < 1.0
    np.testing.assert_array_equal(volume.contains(points)[far], expected[far])


@pytest.mark.parametrize(
    ("turned", "note"),
    [
        ([7], "'Box' has 1 face with a flipped normal: recalculated for the volume"),
        ([0, 3], "'Box' has 2 faces with flipped normals: recalculated for the volume"),
        (range(12), ""),  # inside out is as good
    ],
)
def test_turned_faces_are_counted(turned, note, rng):
    triangles = CUBE[1].copy()
    triangles[turned] = triangles[turned, ::-1]
    volume = MeshVolume(CUBE[0], triangles, "Box")
    assert volume.note == note
    points = rng.uniform(-0.2, 1.2, (3, 4000))
    inside = np.all((points > 0.0) & (points < 1.0), axis=0)
    np.testing.assert_array_equal(volume.contains(points), inside)


def test_repairs_are_reported_together():
    triangles = np.delete(CUBE[1], 5, axis=0)
    triangles[2] = triangles[2, ::-1]
    notes = MeshVolume(CUBE[0], triangles, "Box").note.split("; ")
    assert [finding.partition(":")[0] for finding in notes] == [
        "'Box' has 1 face with a flipped normal",
        "'Box' is open at 3 edges",
    ]


def test_only_repairs_need_trimesh(monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh.graph", None)
    assert MeshVolume(*CUBE, "Whole").note == ""
    with pytest.raises(InputError, match=r"^'Box' has holes .* trimesh.*, is not installed; fill"):
        MeshVolume(CUBE[0], CUBE[1][1:], "Box")


def test_an_empty_mesh_is_refused():
    with pytest.raises(InputError, match=r"^'Nothing' has no faces"):
        MeshVolume(np.zeros((0, 3)), np.zeros((0, 3), np.int32), "Nothing")


def test_numbers_that_are_not_finite_are_refused():
    vertices = CUBE[0].copy()
    vertices[[2, 5], 1] = np.nan, np.inf
    with pytest.raises(InputError, match=r"^'Broken' has 2 vertices"):
        MeshVolume(vertices, CUBE[1], "Broken")


@pytest.mark.parametrize("collapse", [(1, 1, 0), (1, 0, 0), (0, 0, 0)])
def test_a_flat_mesh_is_refused(collapse):
    with pytest.raises(InputError, match=r"^'Sheet' is flat"):
        MeshVolume(CUBE[0] * np.array(collapse), CUBE[1], "Sheet")


def test_a_one_sided_mesh_is_refused():
    # The projective plane on six vertices: closed, but not orientable.
    faces = "012 023 034 045 051 124 235 341 452 513"
    triangles = np.array([[int(k) for k in face] for face in faces.split()], np.int32)
    vertices = np.random.default_rng(1).normal(size=(6, 3))
    with pytest.raises(InputError, match=r"^'Klein' has faces whose normals cannot be made to"):
        MeshVolume(vertices, triangles, "Klein")


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [
        (np.zeros((4, 2)), CUBE[1]),
        (CUBE[0], CUBE[1][:, :2]),
        (CUBE[0], CUBE[1] + 1),
        (CUBE[0], CUBE[1] - 1),
    ],
)
def test_arrays_that_make_no_mesh_are_a_programming_error(vertices, triangles):
    with pytest.raises(ValueError, match="expected"):
        MeshVolume(vertices, triangles, "A")
