# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices inside volumes, against a test of every vertex at every time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from engine_synthetic import BONES, affine, model, pose, skinned

from hfx_blender.engine.contact import contacts
from hfx_blender.engine.contact.contact_query import ContactQuery, Contacts
from hfx_blender.engine.contact.reachable_bounds import bounds_of
from hfx_blender.engine.counters import Counters
from hfx_blender.engine.reference.cells import Skin
from hfx_blender.engine.reference.contact import Body, Volume, contact
from hfx_blender.engine.scene import EffectBlock, PoseBlock, SkinBinding
from hfx_blender.engine.skin.cell_coverage import BodySkin, SkinCoverage
from hfx_blender.engine.skin.skinned_model import SkinnedModel
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape

TIMES = 6
BODY, POSE = model(), pose(TIMES)
SKIN = SkinCoverage(BODY, PAPER)
BINDING = SkinBinding(BONES)
BOUND = BodySkin(SKIN, BINDING, lambda body, clusters: SkinnedModel(body, BINDING, clusters))
WORLD = np.stack([skinned(BODY, POSE, row) for row in range(TIMES)])


def _octahedron() -> MeshVolume:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    x, y, z, a, b, c = range(6)
    triangles = np.array(
        [[x, y, z], [y, a, z], [a, b, z], [b, x, z], [y, x, c], [a, y, c], [b, a, c], [x, b, c]]
    )
    return MeshVolume(vertices, triangles.astype(np.int32), "octahedron")


SHAPES: dict[str, Shape] = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "capsule": Capsule(0.7),
    "mesh": _octahedron(),
}
FALLOFFS = [
    Falloff(),
    Falloff(FalloffKind.LINEAR),
    Falloff(FalloffKind.SMOOTH, 0.4),
    Falloff(FalloffKind.SMOOTH, 0.0),
]


def _placed(seed: int) -> np.ndarray:
    """Return matrices of a volume moving among the vertices, stretched, sheared, sometimes
    mirrored.
    """
    rng = np.random.default_rng(seed)
    matrices = np.stack([affine(rng) for _ in range(TIMES)])
    matrices[:, :3, :3] *= rng.uniform(0.3, 0.9) * (-1) ** seed
    matrices[:, :3, 3] += (0.0, 0.0, 0.9)
    return matrices


def _find(
    matrices: np.ndarray,
    shapes: tuple[Shape, ...],
    falloff: Falloff,
    *,
    rows: Any = None,
    which: Any = None,
    posed: PoseBlock = POSE,
    counters: Counters | None = None,
    **options: Any,
) -> Contacts:
    levels, parameters = np.ones(len(matrices)), np.zeros((len(matrices), 2))
    effect = EffectBlock(levels, parameters, matrices, shapes, which)
    rows = np.arange(len(matrices)) if rows is None else np.asarray(rows)
    bounds = bounds_of(BOUND, posed, np.arange(len(posed.valid)))
    no = np.zeros(len(rows), np.bool_)
    query = ContactQuery(
        effect, falloff, BOUND, posed, bounds, counters or Counters(), rows, no, ~no, **options
    )
    return contacts.begin(query)()


def _dense(samples: Contacts) -> np.ndarray:
    """Check the form of the sets and return weights by time and vertex, (T, V)."""
    weights = np.zeros((TIMES, len(BODY)))
    assert (np.diff(samples.rows) > 0).all()
    assert set(np.diff(samples.sets, prepend=-1 if len(samples.sets) else 0).tolist()) <= {0, 1}
    assert samples.offsets[0] == 0 and samples.offsets[-1] == len(samples.vertices)
    assert len(samples.offsets) == (samples.sets[-1] + 2 if len(samples.sets) else 1)
    for row, j in zip(samples.rows, samples.sets, strict=True):
        part = slice(samples.offsets[j], samples.offsets[j + 1])
        assert part.stop > part.start
        assert (np.diff(samples.vertices[part]) > 0).all()
        weights[row, samples.vertices[part]] = samples.weights[part]
    assert (samples.weights > 0).all()
    return weights


def _defined(matrices: np.ndarray, shapes: list[Shape], falloff: Falloff) -> np.ndarray:
    """Return weights of each vertex by definition, (T, V)."""
    body = Body(Skin.of(BODY), SkinBinding(BONES), POSE, fineness=None)
    which = np.arange(TIMES, dtype=np.int32)
    effect = EffectBlock(np.ones(TIMES), np.zeros((TIMES, 2)), matrices, tuple(shapes), which)
    return np.stack([contact(body, Volume(effect, falloff), row).weights for row in range(TIMES)])


@pytest.mark.parametrize("falloff", FALLOFFS, ids=str)
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_contacts_are_those_of_every_vertex(name: str, falloff: Falloff, seed: int) -> None:
    matrices, shape = _placed(seed), SHAPES[name]
    expected = _defined(matrices, [shape] * TIMES, falloff)
    assert 20 < np.count_nonzero(expected) < expected.size / 2
    actual = _dense(_find(matrices, (shape,), falloff))
    assert ((actual > 0) == (expected > 0)).all()
    assert np.abs(actual - expected).max() < 1e-9


@pytest.mark.parametrize("name", ["cuboid", "sphere", "capsule"])
def test_large_volumes_enclose_whole_clusters(name: str) -> None:
    """The shortcut for clusters wholly inside equals a test of each vertex."""
    matrices, shape = _placed(3), SHAPES[name]
    matrices[:, :3, :3] *= 12.0
    counters, looked = Counters(), Counters()
    short = _dense(_find(matrices, (shape,), Falloff(), counters=counters))
    full = _dense(_find(matrices, (shape,), Falloff(), counters=looked, with_details=True))
    assert (short == full).all() and short.any()
    assert counters.vertices_posed < 0.8 * looked.vertices_posed


def test_points_are_in_shape_space() -> None:
    matrices = _placed(2)
    actual = _find(matrices, (Sphere(),), Falloff(), own_sets=True, with_details=True)
    assert actual.sets.tolist() == list(range(len(actual.rows)))
    assert actual.details.places.shape == (3, len(actual.vertices))
    for row, j in zip(actual.rows, actual.sets, strict=True):
        part = slice(actual.offsets[j], actual.offsets[j + 1])
        world = matrices[row, :3, :3] @ actual.details.places[:, part] + matrices[row, :3, 3:]
        assert np.abs(world.T - WORLD[row, actual.vertices[part]]).max() < 1e-12


def test_shapes_may_change_over_time() -> None:
    matrices = _placed(1)
    which = np.array([0, 1, 2, 1, 0, 2], np.int32)
    shapes = (Sphere(), Cuboid(), _octahedron())
    expected = _defined(matrices, [shapes[k] for k in which], Falloff(FalloffKind.LINEAR))
    actual = _dense(_find(matrices, shapes, Falloff(FalloffKind.LINEAR), which=which))
    assert np.abs(actual - expected).max() < 1e-9
    rows = [1, 2, 5]
    subset = _dense(_find(matrices, shapes, Falloff(FalloffKind.LINEAR), which=which, rows=rows))
    assert np.abs(subset[rows] - expected[rows]).max() < 1e-9
    assert not np.delete(subset, rows, axis=0).any()


def test_a_set_that_stays_is_held_once() -> None:
    still = PoseBlock(POSE.valid, np.repeat(POSE.to_world[:1], TIMES, 0), POSE.bones[[0] * TIMES])
    matrices = np.repeat(_placed(0)[:1], TIMES, axis=0)
    matrices[4:, 0, 3] += 0.1
    actual = _find(matrices, (Sphere(),), Falloff(), posed=still)
    assert actual.rows.tolist() == list(range(TIMES))
    assert actual.sets.tolist() == [0, 0, 0, 0, 1, 1]


def test_times_without_contact_are_left_out() -> None:
    matrices = _placed(6)
    matrices[[0, 3], 2, 3] += 100.0
    counters = Counters()
    actual = _find(matrices, (Sphere(),), Falloff(), counters=counters)
    assert actual.rows.tolist() == [1, 2, 4, 5]
    assert counters.volume_tests == TIMES
    assert counters.clusters_tested == TIMES * len(SKIN.clusters)
    matrices[:, 2, 3] += 100.0
    away = Counters()
    nothing = _find(matrices, (Sphere(),), Falloff(), counters=away)
    assert len(nothing.rows) == len(nothing.vertices) == 0 and away.vertices_posed == 0


@pytest.mark.parametrize("broken", [np.nan, np.inf, 0.0])
def test_degenerate_volumes_have_no_contacts(broken: float) -> None:
    matrices = _placed(6)
    matrices[2, :3, 1] = broken
    counters = Counters()
    actual = _find(matrices, (Sphere(),), Falloff(), counters=counters)
    assert actual.rows.tolist() == [0, 1, 3, 4, 5]
    assert list(counters.flattened.values()) == [1]
    matrices[:, :3, 1] = broken
    assert len(_find(matrices, (Sphere(),), Falloff()).rows) == 0


def test_a_vertex_on_the_boundary_is_inside() -> None:
    vertex = BODY.vertices[5].astype(np.float64)
    still = PoseBlock(np.ones(1, bool), np.eye(4)[None], np.tile(np.eye(4)[:3], (1, 4, 1, 1)))
    matrix = np.eye(4)[None].copy()
    matrix[0, :3, 3] = vertex - (1.0, 0.0, 0.0)
    rounding = 4 * np.finfo(np.float64).eps  # of the way to the vertex and back
    matrix[0, :3, :3] *= 1.0 + rounding
    actual = _find(matrix, (Cuboid(),), Falloff(), posed=still)
    assert 5 in actual.vertices
    matrix[0, :3, :3] *= 1.0 - 1e-9
    assert 5 not in _find(matrix, (Cuboid(),), Falloff(), posed=still).vertices
