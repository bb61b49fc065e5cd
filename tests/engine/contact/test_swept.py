# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts between two samples: complete at any speed, and assigned to one sample each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coverage_synthetic import ball, evaluated, moved_along, placed, rigid, sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.kinematics.placement_motion import Motion, turned_by
from hfx_blender.engine.tolerance import EXACT, PAPER, PREVIEW, STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind, Shape

FAST = 50.0 / 24.0
"""Metres in a frame at 50 m/s and 24 frames a second."""


def _box() -> MeshVolume:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[a, b, c] for a, b, c, _ in faces] + [[a, c, d] for a, _, c, d in faces]
    return MeshVolume(corners, np.array(triangles, np.int32), "box")


WALLS: dict[str, Shape] = {
    "cuboid": Cuboid(),
    "cylinder": Cylinder(),
    "sphere": Sphere(),
    "mesh": _box(),
}
MOTIONS = ("volume", "body", "both", "turning")


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


def _frame(rng: np.random.Generator) -> np.ndarray:
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return frame * np.sign(np.linalg.det(frame))


def _pass(
    rng: np.random.Generator, target: np.ndarray, motion: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return matrices of a wall of 1 mm and of a body; the wall passes ``target`` between samples 1
    and 2 of four.

    The body's skin is at rest otherwise.
    """
    frame = _frame(rng)
    wall, body = np.tile(np.eye(4), (2, 4, 1, 1))
    phase = rng.uniform(0.2, 0.8)
    drift = rng.normal(0.0, 0.2, 3)
    for k, time in enumerate(np.arange(4) - 1 - phase):
        way = frame[:, 2] * FAST * time
        size = (0.15, 0.15, 0.0005)
        if motion == "turning":  # like a door with the hinge 0.5 m away
            turned = _turn(frame[:, 0], 1.2 * time)
            size = (0.15, 0.7, 0.0005)
            wall[k] = placed(1.0, target - 0.5 * frame[:, 1])
            wall[k, :3, :3] = turned @ frame * size
            continue
        share = {"volume": 1.0, "body": 0.0, "both": 0.5}[motion]
        wall[k, :3, :3] = frame * size
        wall[k, :3, 3] = target + share * way + (motion == "both") * drift * k
        body[k, :3, 3] = (share - 1.0) * way + (motion == "both") * drift * k
    return wall, body


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    motion=st.sampled_from(MOTIONS),
    wall=st.sampled_from(sorted(WALLS)),
    tolerance=st.sampled_from([STANDARD, PREVIEW]),
)
def test_no_wall_is_missed_at_50_m_s(
    seed: int, motion: str, wall: str, tolerance: Tolerance
) -> None:
    """A plate of 1 mm at 24 samples a second: in contact for 0.02 ms of 42."""
    rng = np.random.default_rng(seed)
    body = ball(0.1, 2) if seed % 2 else sheet(6)
    hit = int(rng.integers(len(body)))
    matrices, to_world = _pass(rng, body.vertices[hit].astype(float), motion)
    weights, _, _ = evaluated(
        body,
        WALLS[wall],
        matrices,
        tolerance=tolerance,
        posed=rigid(4, to_world),
        rate_hz=24,
    )
    assert weights[2, hit] > 0.0
    assert not weights[[0, 1, 3], hit].any(), "it belongs to the sample that follows it"


def test_the_vertex_test_of_the_paper_sees_moments_only() -> None:
    rng = np.random.default_rng(0)
    matrices, to_world = _pass(rng, np.zeros(3), "volume")
    options = {"posed": rigid(4, to_world), "rate_hz": 24}
    weights, _, _ = evaluated(sheet(6), Cuboid(), matrices, tolerance=PAPER, **options)
    assert not weights.any()


def test_a_slap_covers_all_at_once_and_a_blade_a_strip_at_a_time() -> None:
    """The peak of the area inside at one moment, not the total area touched."""
    body = sheet()
    inner = (np.abs(body.vertices[:, :2]) < 0.1).all(axis=1)
    slap = moved_along(placed((0.2, 0.2, 0.001), (0.0, 0.0, 0.5)), (0.0, 0.0, -1.0), 2)
    weights, _, _ = evaluated(body, Cuboid(), slap)
    assert (weights[1, inner] == 1.0).all()
    # 5 mm wide across cells of 25 mm.
    blade = moved_along(placed((0.0025, 0.2, 0.1), (-0.5, 0.0, 0.0)), (1.0, 0.0, 0.0), 2)
    weights, _, _ = evaluated(body, Cuboid(), blade, tolerance=EXACT)
    assert weights[1, inner].min() > 0.1 and weights[1, inner].max() < 0.35


def test_falloff_counts_where_a_passage_is_deepest() -> None:
    """A ball with linear falloff through the sheet: strength 0.4 at 0.6 of the radius."""
    body = sheet()
    start = placed(0.1, (0.06, 0.0, 2.0))
    falloff = Falloff(FalloffKind.LINEAR)
    matrices = moved_along(start, (0.0, 0.0, -4.0), 2)
    weights, _, _ = evaluated(body, Sphere(), matrices, falloff=falloff, tolerance=EXACT)
    middle = np.linalg.norm(body.vertices, axis=1).argmin()
    assert weights[1, middle] == pytest.approx(0.4, abs=0.03)


# Slow motion, and time


def test_slow_motion_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    from hfx_blender.engine.contact import narrow_phase

    calls: list[int] = []
    compiled = narrow_phase.narrow_phase
    monkeypatch.setattr(
        narrow_phase,
        "narrow_phase",
        lambda *a: calls.extend(a[0].steps[a[0].steps > 0]) or compiled(*a),
    )
    slow = moved_along(placed(0.1, (0.0, 0.0, 0.15)), (0.0, 0.0, -0.1), 21)  # 0.5 m/s
    weights, _, _ = evaluated(sheet(), Sphere(), slow)
    assert weights.any() and not calls
    evaluated(sheet(), Sphere(), slow[::4])
    assert calls


@pytest.mark.parametrize("way", [0.05, 0.6, 4.0])
def test_time_may_be_split_anywhere(way: float) -> None:
    """Each block has the sample before as history, as from the scene reader."""
    rng = np.random.default_rng(3)
    body = ball(0.1, 2)
    matrices = moved_along(
        placed((0.05, 0.08, 0.002), (-way / 2, 0.01, 0.03), _frame(rng)), (way, 0.0, 0.0), 9
    )
    for k in range(9):
        matrices[k, :3, :3] = _turn(np.ones(3), 0.2 * k) @ matrices[k, :3, :3]
    posed = rigid(9, np.stack([placed(1.0, (0.0, 0.002 * k, 0.0)) for k in range(9)]))
    whole, _, _ = evaluated(body, Cuboid(), matrices, posed=posed)
    assert whole.any()
    for cuts in ((1,), (4,), (2, 3, 7), tuple(range(1, 9))):
        split, _, _ = evaluated(body, Cuboid(), matrices, posed=posed, cuts=cuts)
        assert np.abs(split - whole).max() < 1e-9


def test_an_effect_just_switched_on_has_no_motion() -> None:
    """An effect off at the sample before has no motion history."""
    matrices = moved_along(placed(0.1, (0.0, 0.0, 1.0)), (0.0, 0.0, -4.0), 3)
    off = np.array([0.0, 1.0, 0.0])
    on = np.array([1.0, 1.0, 0.0])
    assert not evaluated(sheet(), Sphere(), matrices, levels=off)[0].any()
    assert evaluated(sheet(), Sphere(), matrices, levels=on)[0][1].any()


def test_a_body_without_a_pose_is_not_followed() -> None:
    matrices = moved_along(placed(0.1, (0.0, 0.0, 1.0)), (0.0, 0.0, -2.0), 2)
    posed = rigid(2)
    broken = replace(posed, to_world=posed.to_world.copy())
    broken.to_world[0, 0, 0] = np.nan
    weights, _, _ = evaluated(sheet(), Sphere(), matrices, posed=broken)
    assert not weights.any()
    assert evaluated(sheet(), Sphere(), matrices)[0].any()


def test_a_volume_that_was_flat_before_is_not_followed() -> None:
    matrices = moved_along(placed(0.1, (0.0, 0.0, 1.0)), (0.0, 0.0, -2.0), 2)
    matrices[0, :3, 0] = 0.0
    weights, _, engine = evaluated(sheet(), Sphere(), matrices)
    assert not weights.any() and list(engine.counters.flattened.values()) == [1]


# On demand


def test_how_a_contact_began() -> None:
    """A ball of 3 cm falls on the sheet at 5 m/s and reaches the sheet between two samples."""
    body = sheet()
    matrices = moved_along(placed(0.03, (0.0, 0.0, 0.15)), (0.0, 0.0, -0.15), 4)
    weights, runs, _ = evaluated(body, Sphere(), matrices, record=("impact", "depth", "surface"))
    (sample,) = list(runs[0])
    middle = int(np.linalg.norm(body.vertices[sample.vertices], axis=1).argmin())
    assert np.flatnonzero(weights.any(axis=1)).tolist() == [3]
    # The lowest point is at 0.12, 0.07, 0.02 and -0.03: at 0 after 2.4 samples.
    assert sample.impact.times_s[middle] == pytest.approx(0.024, abs=1e-6)
    assert sample.impact.speeds_m_s[middle] == pytest.approx(5.0, abs=1e-3)
    assert sample.impact.normals[middle] == pytest.approx([0.0, 0.0, -1.0], abs=1e-3)
    assert (sample.impact.times_s >= 0.0239).all()
    assert sample.depth_m[middle] == pytest.approx(0.03, abs=1e-6)
    away = np.linalg.norm(sample.surface - matrices[3, :3, 3], axis=1)
    assert away == pytest.approx(np.full(len(away), 0.03), abs=1e-6)


def test_depth_is_that_of_the_vertex_or_of_the_deepest_place_of_its_skin() -> None:
    """The face of a cuboid is 5 mm beyond a row of vertices, and 20 mm before the next row."""
    body = sheet()
    matrix = placed(0.5, (-0.5 + 0.005, 0.0, 0.0))
    _, runs, _ = evaluated(
        body, Cuboid(), matrix[None], tolerance=EXACT, record=("depth", "surface")
    )
    (sample,) = list(runs[0])
    x = body.vertices[sample.vertices, 0]
    own, next_row = np.abs(x) < 1e-6, np.abs(x - 0.025) < 1e-6
    assert sample.depth_m[own] == pytest.approx(np.full(own.sum(), 0.005), abs=1e-6)
    assert next_row.sum() == 0, "its skin begins at 8.3 mm"
    assert np.abs(sample.surface[own, 0] - 0.005).max() < 1e-6
    assert np.abs(sample.surface_normals[own] - [1.0, 0.0, 0.0]).max() < 1e-6
    matrix = placed(0.5, (-0.5 + 0.015, 0.0, 0.0))
    _, runs, _ = evaluated(body, Cuboid(), matrix[None], tolerance=EXACT, record=("depth",))
    (sample,) = list(runs[0])
    next_row = np.abs(body.vertices[sample.vertices, 0] - 0.025) < 1e-6
    assert next_row.sum() > 5
    # A cell ends between a half and two thirds of the distance to the neighbours.
    assert (sample.depth_m[next_row] < 0.0075).all() and (sample.depth_m[next_row] > 0.001).all()


@pytest.mark.parametrize("shape", [Sphere(), Capsule(0.8), _box()], ids=["ball", "capsule", "mesh"])
def test_every_first_touch_has_an_impact_and_no_later_one_has(shape: Shape) -> None:
    body = ball(0.1, 2)
    matrices = moved_along(placed(0.05, (0.3, 0.02, 0.0)), (-0.6, 0.0, 0.0), 30)
    weights, runs, _ = evaluated(body, shape, matrices, record=("impact",))
    seen = np.zeros(len(body), bool)
    for run in runs:
        for index, sample in zip(run.indices.tolist(), run, strict=True):
            before = weights[index - 1, sample.vertices] > 0.0
            began = np.isfinite(sample.impact.times_s)
            assert (began == ~before).all()
            times = sample.impact.times_s[began]
            assert (times >= sample.time_s - 0.01 - 1e-9).all()
            assert (times <= sample.time_s + 1e-9).all()
            assert (sample.impact.speeds_m_s[began] <= 0.6 / 29 * 100 + 1e-3).all()
            lengths = np.linalg.norm(sample.impact.normals[began], axis=1)
            assert lengths == pytest.approx(np.ones(len(lengths)), abs=1e-5)
            seen[sample.vertices] = True
    assert np.count_nonzero(seen) > 20


# Parts


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), angle=st.floats(0.0, 3.1), mirrored=st.booleans())
def test_motions_pass_through_their_ends_and_turn_evenly(
    seed: int, angle: float, mirrored: bool
) -> None:
    rng = np.random.default_rng(seed)
    axis, start = rng.normal(size=3), _frame(rng)
    size = rng.uniform(0.1, 10.0, 3) * (-1.0 if mirrored else 1.0)
    before, after = placed(1.0, rng.normal(size=3)), placed(1.0, rng.normal(size=3))
    before[:3, :3] = start * size
    after[:3, :3] = _turn(axis, angle) @ start * size
    motion = Motion.between(before[None], after[None])
    assert motion.at(0.0)[0] == pytest.approx(before, abs=1e-9)
    assert motion.at(1.0)[0] == pytest.approx(after, abs=1e-6)
    assert turned_by(before[None], after[None])[0] == pytest.approx(angle, abs=1e-6)
    third = motion.at(1.0 / 3.0)[0]
    assert third[:3, 3] == pytest.approx((2 * before + after)[:3, 3] / 3)
    assert third[:3, :3] == pytest.approx(_turn(axis, angle / 3) @ start * size, abs=1e-6)


def test_half_a_turn_has_an_axis() -> None:
    for axis in (np.eye(3)[0], np.eye(3)[1], np.array([1.0, 2.0, -3.0])):
        before, after = np.eye(4), np.eye(4)
        after[:3, :3] = _turn(axis, np.pi)
        motion = Motion.between(before[None], after[None])
        assert motion.angles[0] == pytest.approx(np.pi)
        assert motion.at(1.0)[0] == pytest.approx(after, abs=1e-6)
        halfway = motion.at(0.5)[0, :3, :3]
        assert np.trace(halfway) == pytest.approx(1.0, abs=1e-6)
