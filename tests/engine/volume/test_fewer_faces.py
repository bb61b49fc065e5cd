# SPDX-License-Identifier: GPL-3.0-or-later
"""Reduced faces for fine mesh volumes, within a bound measured by igl."""

from __future__ import annotations

import sys
from fractions import Fraction

import fast_simplification
import igl
import numpy as np
import pytest
import trimesh

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
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
from hfx_blender.engine.tolerance import EXACT, PAPER, STANDARD, Tolerance, parse
from hfx_blender.engine.volume import mesh
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.mesh import MeshVolume, of_fewer_faces
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

MODEL = load_model("hfx-pressure-1")
SMOOTH = Falloff(FalloffKind.SMOOTH, 1.0)
LOOSE = parse("8mm,10ms,5%")


@pytest.fixture(autouse=True)
def few_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "MANY_FACES", 2000)


def arrays(ball: trimesh.Trimesh, centre: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return np.array(ball.vertices) + centre, np.array(ball.faces, np.int32)


def dented(scale: float = 1.0, centre: float = 0.0) -> MeshVolume:
    vertices, faces = arrays(trimesh.creation.icosphere(5))
    vertices *= 1.0 + 0.1 * np.sin(4.0 * vertices[:, :1]) * np.sin(3.0 * vertices[:, 1:2])
    return MeshVolume(scale * vertices + centre, faces, "Ball")


def surface_of(volume: MeshVolume) -> trimesh.Trimesh:
    """Return the closed surface of the contacts."""
    count = len(volume.corners)
    return trimesh.Trimesh(volume.corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def farthest(one: MeshVolume, target_volume: MeshVolume) -> float:
    """Return the largest distance from points on one surface to the other surface."""
    surface, target = surface_of(one), surface_of(target_volume)
    places = np.concatenate(
        [surface.vertices, trimesh.sample.sample_surface(surface, 20_000, seed=1)[0]]
    )
    squared = igl.point_mesh_squared_distance(places, target.vertices, target.faces)[0]
    return float(np.sqrt(squared.max()))


@pytest.mark.parametrize(("scale", "centre"), [(1.0, 0.0), (1e-4, 0.0), (1e5, 0.0), (1.0, 1e4)])
def test_surfaces_are_within_the_bound_both_ways(scale: float, centre: float) -> None:
    fine = dented(scale, centre)
    samples = fine.within(0.01 * scale)
    assert len(samples.corners) <= len(fine.corners) / 4
    assert surface_of(samples).is_watertight
    assert max(farthest(fine, samples), farthest(samples, fine)) <= 0.0105 * scale
    assert fine.within(0.01 * scale) is samples


def test_a_smaller_bound_leaves_more_faces_and_a_tiny_one_all() -> None:
    fine = dented()
    counts = [len(fine.within(bound).corners) for bound in (0.05, 0.005)]
    assert counts[0] < counts[1] < len(fine.corners)
    assert fine.within(1e-5) is fine


_simplify = fast_simplification.simplify


def test_a_crumb_away_from_the_surface_has_no_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """A closed crumb of tiny volume; the rest of the simplified mesh is near the original."""
    vertices, faces = arrays(trimesh.creation.icosphere(5))
    fine = MeshVolume(vertices, faces, "Ball")
    crumb, sides = arrays(trimesh.creation.box((0.001, 0.001, 0.001)), 0.6)

    def simplify(*_: object, **__: object) -> tuple[np.ndarray, np.ndarray]:
        points, actual = _simplify(0.5 * vertices, faces, target_count=5000)
        return np.concatenate([points, crumb]), np.concatenate([actual, sides + len(points)])

    monkeypatch.setattr(fast_simplification, "simplify", simplify)
    assert fine.within(0.02) is fine


def test_a_step_that_is_open_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    fine = MeshVolume(*arrays(trimesh.creation.icosphere(5)), "Ball")

    def simplify(*arguments: object, **options: int) -> tuple[np.ndarray, np.ndarray]:
        points, actual = _simplify(*arguments, **options)
        return points, actual if len(actual) > 2000 else actual[1:]

    monkeypatch.setattr(fast_simplification, "simplify", simplify)
    assert len(fine.within(0.05).corners) == 5120


def test_a_hollow_behind_a_thin_wall_does_not_fill(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = arrays(trimesh.creation.icosphere(5))
    hollow = np.concatenate([faces, faces[:, ::-1] + len(vertices)]).astype(np.int32)
    fine = MeshVolume(np.concatenate([vertices, 0.99 * vertices]), hollow, "Shell")
    assert not fine.contains(np.zeros((3, 1)))[0]
    outer = _simplify(0.5 * vertices, faces, target_count=5000)
    monkeypatch.setattr(fast_simplification, "simplify", lambda *_, **__: outer)
    assert fine.within(0.05) is fine


def test_each_row_is_chosen_by_itself() -> None:
    fine = dented()
    matrices = np.tile(np.eye(4), (6, 1, 1))
    matrices[1:3, :3, :3] *= [[[2.0]], [[1000.0]]]
    matrices[3, 0, 0] = np.nan
    matrices[4] = [[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]  # turned
    which = np.array([0, 0, 0, 0, 0, 1])
    bounds_m = np.full(6, 0.01)
    shapes, index = of_fewer_faces((fine, Sphere()), which, matrices, bounds_m)
    samples = [shapes[k] for k in index]
    assert samples[0] is samples[4] is not fine and isinstance(samples[5], Sphere)
    assert samples[2] is samples[3] is fine
    assert isinstance(samples[0], MeshVolume) and isinstance(samples[1], MeshVolume)
    assert farthest(fine, samples[1]) <= 0.005
    for k in range(6):
        alone, _ = of_fewer_faces(
            (fine, Sphere()), which[k : k + 1], matrices[k : k + 1], bounds_m[k : k + 1]
        )
        assert alone == (samples[k],)
    assert of_fewer_faces((fine,), which[:1], matrices[:1], np.zeros(1))[0] == (fine,)


def weights_of(volume: MeshVolume, tolerance: Tolerance, falloff: Falloff) -> dict[int, float]:
    effects = (EffectDescription("v", "v", "pressure", MODEL.id, HapticVolume(falloff)),)
    body = BodyDescription("anna", "Anna", SkinBinding(MODEL.bone_names))
    scene = SceneDescription(TimeBase(Fraction(100), Fraction(100), 0, 0, 1), (body,), effects)
    bones = np.eye(4)[None, None, :3].repeat(len(MODEL.bone_names), axis=1)
    to_world = np.eye(4)[None] * [0.03, 0.03, 0.03, 1.0]
    to_world[0, :3, 3] = MODEL.vertices[MODEL.vertices[:, 0].argmax()]
    animated = EffectBlock(np.ones(1), np.ones((1, 1)), to_world, (volume,))
    pose = PoseBlock(np.ones(1, bool), np.eye(4)[None], bones)
    engine = Engine(scene, models=lambda _: MODEL, tolerance=tolerance)
    [run] = engine.evaluate(AnimationBlock(np.arange(1), (animated,), (pose,)))
    [sample] = list(run)
    return dict(zip(sample.vertices.tolist(), sample.weights.tolist(), strict=True))


def chosen_surfaces(monkeypatch: pytest.MonkeyPatch) -> dict[int, MeshVolume]:
    """Return a dict (by ``id``) filled with the reduced volumes of all calls from now on."""
    chosen: dict[int, MeshVolume] = {}
    within = MeshVolume.within

    def noted(self: MeshVolume, bound: float) -> MeshVolume:
        fewer = within(self, bound)
        chosen[id(fewer)] = fewer
        return fewer

    monkeypatch.setattr(MeshVolume, "within", noted)
    return chosen


def test_contacts_are_those_of_all_faces(monkeypatch: pytest.MonkeyPatch) -> None:
    fine = dented()
    chosen = chosen_surfaces(monkeypatch)
    fewer = weights_of(fine, LOOSE, SMOOTH)
    assert [len(volume.corners) < 6000 for volume in chosen.values()] == [True]
    monkeypatch.setattr(mesh, "MANY_FACES", 10**9)
    every = weights_of(fine, LOOSE, SMOOTH)
    assert len(every) > 20
    ids = every.keys() | fewer.keys()
    assert max(abs(every.get(k, 0.0) - fewer.get(k, 0.0)) for k in ids) < 0.08  # 1 of 27 mm, 1.5 x


@pytest.mark.parametrize(
    ("tolerance", "falloff"), [(EXACT, SMOOTH), (PAPER, SMOOTH), (STANDARD, Falloff())]
)
def test_all_faces_are_used_without_tolerance_or_gain(
    tolerance: Tolerance, falloff: Falloff, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = chosen_surfaces(monkeypatch)
    weights_of(dented(), tolerance, falloff)
    assert not chosen


def test_without_the_wheel_all_faces_are_used_with_a_note(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    fine = dented()
    assert fine.within(0.01) is fine
    assert fine.note.startswith("'Ball' has 20480 faces. Its contacts take longer")
