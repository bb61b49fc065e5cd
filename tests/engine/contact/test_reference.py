# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference contacts, checked by libigl and by arithmetic, and the engine against the reference."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cached_property

import igl
import numpy as np
import pytest
from both_ways import by_reference, needs_library
from coverage_synthetic import SIDE_M, ball, placed, rigid, sheet
from distorted_scenes import FALLOFFS, DistortedScene, load
from engine_synthetic import BONES
from random_contacts import NEAR, RandomContact, StretchedContact

from hfx_blender.engine import tolerance
from hfx_blender.engine.body.levels_and_cells import cell_of_skin
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.reference.boundary import nearest
from hfx_blender.engine.reference.cells import EXACT, Cells, Fineness, Skin
from hfx_blender.engine.reference.contact import Body, Volume, contact
from hfx_blender.engine.reference.pose import by_bones, is_rotating, moved, placement_between
from hfx_blender.engine.reference.shapes import (
    contains,
    nearest_on_triangles,
    strength,
    winding_numbers,
)
from hfx_blender.engine.reference.sweep import passage
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape

RNG = np.random.default_rng(20)
SEEDS = 1, 2, 3, 11, 14, 15, 19, 26, 29, 30, 43, 46, 50, 51, 53, 58, 59, 65, 68
"""Scenes that are looked at within tenths of a second, with each shape, binding and record."""

DEFORMING = 11, 14


# The engine


@pytest.mark.parametrize("seed", SEEDS)
def test_the_engine_agrees_with_the_reference(seed: int) -> None:
    case = RandomContact(seed)
    assert case.difference < NEAR, case


@pytest.mark.parametrize("seed", [2089, 2244])
def test_stretched_skin_bulges_as_posed(seed: int) -> None:
    """Only the bulge is inside: no plane separates the skin from the volume."""
    case = StretchedContact(seed)
    assert case.difference < NEAR, case


class _Deforming(RandomContact):
    """Mesh with other vertices and faces at each row."""

    @cached_property
    def animated(self) -> EffectBlock:
        block, model = super().animated, ball(1.0, 2)
        dents = np.random.default_rng(self.seed).uniform(0.4, 1.2, len(model))[:, None]
        many = MeshVolume(model.vertices.astype(float) * dents, model.triangles, "many")
        few = MeshVolume.box(np.array([[-0.6, -0.4, -0.9], [0.3, 0.5, 0.4]]), "few")
        which = (np.arange(len(block.levels)) % 2).astype(np.int32)
        return replace(block, shapes=(many, few), shape_index=which)


@pytest.mark.parametrize("seed", DEFORMING)
def test_meshes_with_changing_faces_agree_with_the_reference(seed: int) -> None:
    case = _Deforming(seed)
    assert case.difference < NEAR, case


@needs_library
@pytest.mark.parametrize("seed", SEEDS[::4])
def test_the_engine_without_its_library_does_so_too(seed: int) -> None:
    case = RandomContact(seed)
    with by_reference():
        assert case.difference < NEAR, case


def test_cells_on_finer_skin_agree_with_the_reference() -> None:
    """Cells of the shipped temperature model on limbs are sampled by the pressure model."""
    model = load("hfx-temperature-1")
    scene = DistortedScene.turned(model, 1, 0.3)
    which = np.arange(5) == 2
    shape, matrix = scene.volumes[2].grown(0.0)
    animated = EffectBlock(np.ones(1), np.ones((1, 1)), matrix[None], (shape,))
    pose = PoseBlock(np.ones(1, bool), scene.to_world[None], scene.bones[None])
    skin = Skin.of(model, load(cell_of_skin(model)[0]))
    actual = contact(
        Body(skin, SkinBinding(model.bone_names), pose), Volume(animated, FALLOFFS[2]), 0
    )
    expected = scene.felt(tolerance.EXACT, which=which)[2]
    assert np.count_nonzero(expected) > 100
    assert np.abs(actual.weights - expected).max() < NEAR


def test_the_scenes_touch_and_cut() -> None:
    """Guards against a comparison of empty results."""
    actual = [RandomContact(seed).by_engine() for seed in SEEDS]
    weights = np.concatenate([s.weights for scene in actual for s in scene.values()])
    assert np.count_nonzero(weights) > 100 and np.count_nonzero(weights < 0.9) > 50
    assert all(actual)


# Inside and depth


def _tangle() -> np.ndarray:
    """Return corners of a dented ball crossing a second ball, with a hollow."""
    model = ball(1.0, 1)
    vertices = model.vertices * RNG.uniform(0.5, 1.3, (len(model), 1))
    corners = vertices[model.triangles].astype(float)
    return np.concatenate([corners, corners + 0.6, 0.3 * corners[:, ::-1]])


def test_inside_and_distance_of_meshes_are_libigls() -> None:
    corners, points = _tangle(), RNG.uniform(-1.5, 2.0, (400, 3))
    vertices, faces = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    theirs = igl.winding_number(vertices, faces, points)
    boxed = ((points >= vertices.min(axis=0)) & (points <= vertices.max(axis=0))).all(axis=1)
    assert set(np.rint(theirs).astype(int)) >= {0, 1, 2}
    assert np.abs(winding_numbers(corners, points.T) - theirs)[boxed].max() < 1e-9
    squared, _, feet = igl.point_mesh_squared_distance(points, vertices, faces)
    places, ours = nearest_on_triangles(corners, points.T)
    assert np.abs(ours - squared).max() < 1e-9
    assert np.abs(np.linalg.norm(places.T - points, axis=1) - np.sqrt(squared)).max() < 1e-9
    assert np.abs(places.T - feet).max() < 1e-6


def _tessellated(shape: Shape, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the boundary of a convex shape as triangles: a fine ball projected onto the shape."""
    model = ball(1.0, steps)
    points = model.vertices.astype(float).T
    if isinstance(shape, Cuboid):
        points = points / np.abs(points).max(axis=0)
    elif isinstance(shape, Cylinder):
        points = points / np.maximum(np.hypot(points[0], points[1]), np.abs(points[2]))
    elif isinstance(shape, Capsule):
        points[2] += np.where(np.abs(points[2]) < 1e-6, 0.0, np.sign(points[2])) * (
            shape.half_segment
        )
    return points.T, model.triangles


@pytest.mark.parametrize("shape", [Sphere(), Capsule(0.8)], ids=lambda s: type(s).__name__)
def test_depth_in_a_sheared_shape_is_libigls_of_its_triangles(shape: Shape) -> None:
    vertices, triangles = _tessellated(shape, 5)
    matrix = np.eye(4)
    matrix[:3] = [[1.0, 0.9, -0.3, 5.0], [0.0, 0.4, 0.8, -2.0], [0.2, 0.0, 1.5, 0.0]]
    points = RNG.uniform(-1.0, 1.0, (3, 60))
    points = points[:, contains(shape, points)]
    world = moved(matrix, vertices.T).T
    squared, _, _ = igl.point_mesh_squared_distance(moved(matrix, points).T, world, triangles)
    places, normals, depths = nearest(shape, points, matrix)
    assert np.abs(depths - np.sqrt(squared)).max() < 2e-3  # chords of 10 242 vertices
    assert np.abs(places - moved(matrix, points) - normals * depths).max() < 1e-12
    back = moved(np.linalg.inv(matrix), places)
    assert contains(shape, back * (1.0 - 1e-6)).all() and not contains(shape, back * 1.01).any()


def test_depths_by_hand() -> None:
    """Depths of an ellipsoid on the long axis: b sqrt(1 - x^2 / (a^2 - b^2)) for x <= (a^2 - b^2) /
    a, then a - x.

    Further planes of a cuboid and of caps, and a cylinder's round side.
    """
    points = np.array([[0.0, 0.0, 0.0], [0.25, 0.0, 0.0], [0.9, 0.0, 0.0]]).T
    expected = [1.0, np.sqrt(1.0 - 0.25 / 3.0), 0.2]
    assert nearest(Sphere(), points, placed((2.0, 1.0, 1.0), 0.0))[2] == pytest.approx(expected)
    assert nearest(Cuboid(), points, placed((2.0, 1.0, 3.0), 0.0))[2] == pytest.approx([1, 1, 0.2])
    assert nearest(Cylinder(), points, placed((1.0, 1.0, 0.5), 0.0))[2] == pytest.approx(
        [0.5, 0.5, 0.1]
    )
    sheared = np.eye(4)
    sheared[0, 1] = 1.0  # the side x = 1 leans by 45 degrees
    assert nearest(Cuboid(), points, sheared)[2] == pytest.approx(
        [0.5**0.5, 0.75 * 0.5**0.5, 0.1 * 0.5**0.5]
    )


def test_strength_by_hand() -> None:
    points = np.array([[0.0, 0.0, z] for z in (0.0, 0.5, 0.8, 1.0, 1.1)]).T
    for shape in (Cuboid(), Sphere(), Cylinder(), Capsule(0.0)):
        linear = strength(shape, Falloff(FalloffKind.LINEAR), points)
        assert linear == pytest.approx([1.0, 0.5, 0.2, 0.0, 0.0])
        smooth = strength(shape, Falloff(FalloffKind.SMOOTH, 0.5), points)
        assert smooth == pytest.approx([1.0, 1.0, 0.352, 0.0, 0.0])  # 3 * 0.4^2 - 2 * 0.4^3
        assert strength(shape, Falloff(), points).tolist() == [1.0, 1.0, 1.0, 1.0, 0.0]


def test_a_cubes_core_is_its_middle() -> None:
    """The largest ball in a cube of edge 2 has radius 1; the engine's search is within 0.5 %."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[a, b, c] for a, b, c, _ in faces] + [[a, c, d] for a, _, c, d in faces]
    box = MeshVolume(corners, np.array(triangles, np.int32), "box")
    assert box.core_radius == pytest.approx(1.0, rel=0.005)


# Cells


def _body(model: PerceptualModel, fineness: Fineness = EXACT) -> Body:
    return Body(Skin.of(model), SkinBinding(BONES), rigid(1), fineness)


def test_covered_area_of_a_sheet() -> None:
    """An edge at x = 0.01 across a square of 0.3 m covers 0.16 * 0.3 square metres."""
    body = sheet(9)
    matrix = placed(1.0, (0.01 - 1.0, 0.0, 0.0))
    animated = EffectBlock(np.ones(1), np.ones((1, 2)), matrix[None], (Cuboid(),))
    weights = contact(_body(body), Volume(animated, Falloff()), 0).weights
    assert weights @ body.areas_m2 == pytest.approx(0.16 * SIDE_M, rel=1e-3)
    x = body.vertices[:, 0]
    assert (weights[x < -0.03] == 1.0).all() and (weights[x > 0.05] == 0.0).all()


def test_curved_skin_is_on_the_ball_that_its_triangles_stand_for() -> None:
    """Second order: for triangles half as long, the error is a quarter as large relative to the
    sagitta.
    """
    shares = []
    for rounds in (1, 2):
        model, radii = ball(0.02, rounds), []
        total = np.zeros(len(model))
        for samples in Cells(Skin.of(model), EXACT).samples():
            points = samples.posed(model.vertices.astype(float).T, 1.0)
            radii.append(np.linalg.norm(points, axis=0) / 0.02)
            total += np.bincount(samples.cells, samples.areas, len(model))
        assert total == pytest.approx(np.ones(len(model)))
        sagitta = 1.0 - np.linalg.norm(model.vertices[model.triangles].mean(axis=1), axis=1) / 0.02
        shares.append(np.abs(np.concatenate(radii) - 1.0).max() / sagitta.max())
    assert shares[0] < 0.3 and shares[1] < 0.3 * shares[0]


def test_samples_of_the_temperature_model_are_on_its_geodesic_cells() -> None:
    model = load("hfx-temperature-1")
    fine, owner = cell_of_skin(model)
    skin = Skin.of(model, load(fine))
    total = np.zeros(len(model))
    for samples in Cells(skin, Fineness(0.5, 0.005, 0.02)).samples():
        assert (owner[samples.corners[0]] == samples.cells).all()
        total += np.bincount(samples.cells, samples.areas, len(model))
    assert total == pytest.approx(np.ones(len(model)))


# Pose and motion


def test_linear_blend_skinning_by_hand() -> None:
    body = sheet(1)
    bones = np.tile(np.eye(4)[:3], (4, 1, 1))
    bones[0, :, 3] = 1.0, 2.0, 3.0
    actual = by_bones(body, BONES, bones)
    assert actual == pytest.approx(body.vertices.T + np.array([[1.0], [2.0], [3.0]]))


def test_motion_by_hand() -> None:
    before, after = np.eye(4), np.eye(4)
    after[:3, :3] = [[0.0, -3.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # 90 degrees, y times 3
    after[:3, 3] = 4.0, 0.0, 0.0
    middle = placement_between(before, after, 0.5)
    half = 0.5**0.5
    expected = [[half, -2.0 * half, 0.0, 2.0], [half, 2.0 * half, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    assert middle[:3] == pytest.approx(np.array(expected))
    assert is_rotating(before, after) and not is_rotating(before, 2.0 * before)


def test_passages_by_hand() -> None:
    """A path from x = -3 to 3, at y = 0.6: inside a ball for 1.6, inside a cuboid for 2."""
    path = np.array([[[-3.0], [0.6], [0.0]], [[3.0], [0.6], [0.0]]])
    for shape, half in ((Sphere(), 0.8), (Cylinder(), 0.8), (Capsule(1.0), 0.8), (Cuboid(), 1.0)):
        first, last = passage(shape, path)
        assert (first[0], last[0]) == pytest.approx(((3.0 - half) / 6.0, (3.0 + half) / 6.0))
    bent = np.concatenate([path, path[:1]])  # and back
    first, last = passage(Sphere(), bent)
    assert (first[0], last[0]) == pytest.approx(((3.0 - 0.8) / 12.0, 1.0 - (3.0 - 0.8) / 12.0))
    away = path + np.array([[0.0], [1.0], [0.0]])
    assert np.isinf(passage(Capsule(1.0), away)[0]).all()


@needs_library
def test_a_cell_whose_vertex_is_outside_is_as_deep_as_its_deepest_skin() -> None:
    """A ball around the farthest skin of the largest temperature cell, sampled on a finer model."""
    model = load("hfx-temperature-1")
    finer_id, owner = cell_of_skin(model)
    finer, cell = load(finer_id), int(np.bincount(owner).argmax())
    skin = finer.vertices[owner == cell].astype(float)
    away = np.linalg.norm(skin - model.vertices[cell], axis=1)
    matrix = np.diag([*[0.45 * away.max()] * 3, 1.0])
    matrix[:3, 3] = skin[away.argmax()]
    bones = np.tile(np.eye(3, 4), (1, len(model.bone_names), 1, 1))
    pose = PoseBlock(np.ones(1, bool), np.eye(4)[None], bones)
    effect = EffectBlock(np.ones(1), np.full((1, 2), 20.0), matrix[None], (Sphere(),))
    body = BodyDescription("a", "A", SkinBinding(model.bone_names))
    area = EffectDescription("e", "E", model.modality, model.id, HapticVolume(Falloff()))
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, 99)
    engine = Engine(SceneDescription(time, (body,), (area,)), record=("depth",))
    [run] = engine.evaluate(AnimationBlock(np.arange(1), (effect,), (pose,)))
    [sample] = run
    assert cell in sample.vertices
    near = sample.vertices.astype(np.int64)
    fineness = Fineness(
        tolerance.STANDARD.spacing_share, EXACT.least_m, tolerance.STANDARD.distance_m
    )
    placed = Body(Skin.of(model, finer), body.binding, pose, fineness, near)
    contact_at_row = contact(placed, Volume(effect, Falloff()), 0, None, with_details=True)
    depths = Sphere().depth_m(contact_at_row.details.places[:, sample.vertices], matrix)
    np.testing.assert_allclose(sample.depth_m, depths, rtol=0, atol=1e-6)
