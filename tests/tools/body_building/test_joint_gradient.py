# SPDX-License-Identifier: GPL-3.0-or-later
"""Joint gradient: its formula, and a ball of an upper arm and a forearm remeshed with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import skin_ball
from skin_ball import RADIUS_M

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.errors import InputError, UsageError
from hfx_blender.files import resources
from hfx_tools.body_building import build, joint_gradient, left_skin, model_set, stats, thresholds
from hfx_tools.body_building.joint_gradient import UNIFORM, JointGradient
from hfx_tools.body_building.meshes import measure, mesh_edges, remesh

UPPER_ARM, FOREARM = PARTS.index("upper_arm"), PARTS.index("forearm")
FACTOR = 0.5
SHOULDER, ELBOW, WRIST = [0.0, 0.0, RADIUS_M], [0.0, 0.0, 0.0], [0.0, 0.0, -RADIUS_M]
GRADIENT = JointGradient(FACTOR, {"upper_arm": (SHOULDER, ELBOW), "forearm": (ELBOW, WRIST)})


SPACING_M = 1.3 * np.array(skin_ball.SPACING_M)  # upper arm, forearm


def relative_by_hand(height_m: np.ndarray) -> np.ndarray:
    """Relative spacing of the ball: 1/2 at heights -R, 0 and R, 1 halfway, straight between."""
    corners_m = np.array([-1.0, -0.5, 0.0, 0.5, 1.0]) * RADIUS_M
    return np.interp(height_m, corners_m, [0.5, 1.0, 0.5, 1.0, 0.5])


def test_the_factor_holds_at_joints_and_rises_linearly_to_the_middle() -> None:
    gradient = JointGradient(0.6, {"forearm": ([0.2, 0.0, 1.0], [0.2, 0.0, 0.8])})
    heights = np.array([1.0, 0.95, 0.9, 0.85, 0.8, 1.3, 0.1])
    # Positions 0, 1/4, 1/2, 3/4 and 1, then beyond each joint: 0.6 + 0.4 (1 - |2 t - 1|).
    expected = [0.6, 0.8, 1.0, 0.8, 0.6, 0.6, 0.6]
    for x in (0.24, -0.24):  # both sides, and off the line between the joints
        points = np.column_stack((np.full(7, x), np.full(7, -0.05), heights))
        assert gradient.relative(points, np.full(7, FOREARM)) == pytest.approx(expected)
        assert (gradient.relative(points, np.full(7, UPPER_ARM)) == 1.0).all()
        assert (UNIFORM.relative(points, np.full(7, FOREARM)) == 1.0).all()


def test_joints_are_those_of_the_skeleton() -> None:
    skeleton = model.load_avatar().skeleton
    gradient = joint_gradient.make(skeleton, 0.7)
    assert list(gradient.joints_m) == ["upper_arm", "forearm", "upper_leg", "lower_leg"]
    joints = gradient.joints_m
    for upper, lower in (("upper_arm", "forearm"), ("upper_leg", "lower_leg")):
        assert joints[upper][1] == joints[lower][0]  # elbow and knee
        assert joints[upper][0][2] > joints[upper][1][2] > joints[lower][1][2]  # from top to end
        assert min(joints[upper][0][0], joints[lower][1][0]) > 0.0  # left is +X
    # Neighbouring parts meet at the joint: skin of both parts lies around the same height.
    avatar = model.load_avatar()
    for upper, lower in (("upper_arm", "forearm"), ("upper_leg", "lower_leg")):
        start, end = (np.array(point) for point in joints[upper])
        along = (end - start) / np.linalg.norm(end - start)
        on_left = avatar.vertices[:, 0] > 0.0
        above, below = (
            (avatar.vertices[on_left & (avatar.part == PARTS.index(part))] - end) @ along
            for part in (upper, lower)
        )
        assert abs(above.max()) < 0.06 and abs(below.min()) < 0.06
        assert above.mean() < -0.08 and below.mean() > 0.08
    assert joint_gradient.make(skeleton, 1.0) is UNIFORM


@pytest.fixture(scope="module")
def limb() -> left_skin.LeftSkin:
    """Return the ball, its upper half labelled upper arm, its lower half forearm."""
    ball = skin_ball.ball()
    return replace(ball, medium=replace(ball.medium, part=ball.medium.part + np.uint8(UPPER_ARM)))


def spacings() -> np.ndarray:
    table = np.full(len(PARTS), 0.02)
    table[[UPPER_ARM, FOREARM]] = SPACING_M
    return table


@pytest.fixture(scope="module")
def meshed(limb: left_skin.LeftSkin) -> remesh.Remesher:
    return remesh.remesh(limb, spacings(), lambda _share, _text: None, GRADIENT)


def inner_edges(mesh: remesh.Remesher) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Part, height of the middle, and length of each edge inside a part."""
    start, end = mesh_edges.edges_of(mesh.triangles, len(mesh.points)).ends.T
    inside = mesh.part[start] == mesh.part[end]
    first, second = mesh.points[start[inside]], mesh.points[end[inside]]
    lengths = np.linalg.norm(first - second, axis=1)
    return mesh.part[start[inside]], 0.5 * (first + second)[:, 2], lengths


def test_edges_follow_the_formula_from_the_elbow_to_the_middle_of_the_limb(
    meshed: remesh.Remesher,
) -> None:
    part, height, length = inner_edges(meshed)
    for number, spacing in zip((UPPER_ARM, FOREARM), SPACING_M, strict=True):
        target = spacing * relative_by_hand(height)
        own = part == number
        for low, high in ((0.55, 0.65), (0.65, 0.75), (0.75, 0.85), (0.85, 1.0)):
            band = own & (target >= low * spacing) & (target < high * spacing)
            assert band.sum() > 50
            assert length[band].mean() == pytest.approx(target[band].mean(), rel=0.05)
        assert (length / target)[own].mean() == pytest.approx(1.0, rel=0.015)
        assert (length / target)[own].std() < 0.17
    mean = meshed.mean_spacing(meshed.points)[[UPPER_ARM, FOREARM]]
    assert mean == pytest.approx(SPACING_M, rel=0.015)


def test_cells_near_a_joint_are_as_much_smaller_as_their_spacing_squared(
    meshed: remesh.Remesher,
) -> None:
    cells = meshed.areas_m2() * np.where(meshed.is_midline, 2.0, 1.0)
    assert meshed.areas_m2().sum() == pytest.approx(2.0 * np.pi * RADIUS_M**2, rel=2e-3)
    target = meshed.spacing_m[meshed.part] * relative_by_hand(meshed.points[:, 2])
    ratio = cells / (np.sqrt(0.75) * target**2)
    near = np.abs(meshed.points[:, 2]) < 0.15 * RADIUS_M
    middle = np.abs(np.abs(meshed.points[:, 2]) - 0.5 * RADIUS_M) < 0.15 * RADIUS_M
    for band in (near, middle):
        assert ratio[band].mean() == pytest.approx(1.0, rel=0.12)
    assert cells[near].mean() < 0.5 * cells[middle].mean()


def test_no_skin_is_farther_than_nine_tenths_of_its_local_spacing(
    limb: left_skin.LeftSkin, meshed: remesh.Remesher
) -> None:
    both = np.concatenate((meshed.points, meshed.points * (-1.0, 1.0, 1.0)))
    skin = limb.points[limb.points[:, 2] != 0.0][::7]
    distance = np.array([np.linalg.norm(both - point, axis=1).min() for point in skin])
    distance /= relative_by_hand(skin[:, 2])
    is_upper = skin[:, 2] > 0.0
    gaps = meshed.largest_gaps_m()
    assert np.array_equal(gaps, measure.gaps_m(meshed.samples, both, GRADIENT))
    for part, own in ((UPPER_ARM, is_upper), (FOREARM, ~is_upper)):
        assert 0.4 * meshed.spacing_m[part] < distance[own].max() <= 1.02 * gaps[part]
        assert gaps[part] <= 0.9 * meshed.spacing_m[part]


def test_gaps_are_relative_to_the_local_spacing() -> None:
    points = np.array([[0.01, 0.0, 0.0], [0.01, 0.0, 0.5 * RADIUS_M]])
    samples = left_skin.Samples(
        points, points, np.ones(2), np.full(2, UPPER_ARM, np.uint8), np.arange(2)
    )
    # 4 mm at the elbow, where the spacing is half of the target, and 6 mm in the middle.
    vertices = np.array([[0.014, 0.0, 0.0], [0.016, 0.0, 0.5 * RADIUS_M]])
    assert measure.gaps_m(samples, vertices, GRADIENT)[UPPER_ARM] == pytest.approx(0.008)
    assert measure.gaps_m(samples, vertices)[UPPER_ARM] == pytest.approx(0.006)


def test_a_gradient_of_1_changes_no_bit(limb: left_skin.LeftSkin) -> None:
    coarse = 1.6 * spacings()
    flat = JointGradient(1.0, GRADIENT.joints_m)
    plain, same = (
        remesh.remesh(limb, coarse, lambda _share, _text: None, *gradient)
        for gradient in ((), (flat,))
    )
    assert np.array_equal(plain.points, same.points) and len(plain.points) > 100
    assert np.array_equal(plain.triangles, same.triangles)
    assert np.array_equal(plain.areas_m2(), same.areas_m2())


def with_gradient(item: model.PerceptualModel) -> model.PerceptualModel:
    """Return three forearm vertices in a row: at the elbow, a quarter, and half of the bone."""
    gradient = JointGradient(0.5, {"forearm": ([0.2, 0.0, 1.0], [0.2, 0.0, 0.8])})
    return replace(
        item,
        vertices=np.array([[0.2, 0, 1.0], [0.2, 0, 0.95], [0.2, 0, 0.9]], np.float32),
        triangles=np.array([[0, 1, 2]], np.int32),
        part=np.full(3, FOREARM, np.uint8),
        areas_m2=np.ones(3, np.float32),
        provenance={"targets_mm": dict.fromkeys(PARTS, 80.0), **gradient.provenance()},
    )


def test_statistics_compare_lengths_with_the_local_spacing() -> None:
    limb = with_gradient(model.load_model("hfx-temperature-1"))
    # Lengths 50, 50 and 100 mm at 1/8, 3/8 and 1/4 of the bone: relative 5/8, 7/8 and 3/4.
    lengths = np.array([0.05 / 0.625, 0.05 / 0.875, 0.1 / 0.75])
    mean, sd = stats.spacing_m(limb)
    assert mean[FOREARM] == pytest.approx(lengths.mean(), rel=1e-5)
    assert sd[FOREARM] == pytest.approx(lengths.std(), rel=1e-5)
    nothing = np.zeros(len(PARTS))
    facts = stats.statistics(limb, nothing, nothing)
    assert facts["forearm"]["target_mm"] == 80.0
    assert facts["forearm"]["target_at_joints_mm"] == 40.0
    assert "target_at_joints_mm" not in facts["upper_arm"]
    plain = replace(limb, provenance={"targets_mm": dict.fromkeys(PARTS, 80.0)})
    assert stats.spacing_m(plain)[0][FOREARM] == pytest.approx(0.2 / 3.0, rel=1e-5)


def test_id_and_manifest_carry_the_gradient() -> None:
    row = thresholds.LITERATURE_MM["pressure"]
    ids = {thresholds.model_id("pressure", row, "cells", factor) for factor in (1.0, 0.7, 0.5)}
    ids.add(thresholds.model_id("pressure", thresholds.TABLE_1_MM["pressure"], "cells", 0.5))
    assert len(ids) == 4 and "hfx-pressure-1" in ids
    limb = with_gradient(model.load_model("hfx-temperature-1"))
    limb.provenance["statistics"] = {}
    entry = model_set.model_entry(limb)
    assert entry["joint_gradient"]["factor"] == 0.5
    assert joint_gradient.of(entry) == joint_gradient.of(limb.provenance)
    assert joint_gradient.of({}) is UNIFORM and UNIFORM.provenance() == {}


@pytest.mark.parametrize(
    ("factor", "message"),
    (
        (0.49, "--joint-gradient 0.49: allowed are 0.5 to 1"),
        (1.01, "--joint-gradient 1.01: allowed are 0.5 to 1"),
        (float("nan"), "--joint-gradient nan: allowed are 0.5 to 1"),
    ),
)
def test_a_factor_outside_the_range_is_refused(tmp_path: Path, factor: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build.build(None, tmp_path / "set", joint_factor=factor)
    assert not (tmp_path / "set").exists()


def test_a_factor_must_suit_the_targets() -> None:
    row = list(thresholds.LITERATURE_MM["pressure"])
    row[FOREARM] = 1.9
    message = r"'pressure\.forearm' has 0\.95 mm at the joints; allowed are 1 mm and more"
    with pytest.raises(InputError, match=message):
        joint_gradient.check(0.5, {"pressure": tuple(row)})
    joint_gradient.check(0.6, {"pressure": tuple(row)})
    temperature = {"temperature": thresholds.LITERATURE_MM["temperature"]}
    message = "the targets have temperature only; allowed are targets with pressure or vibration"
    with pytest.raises(InputError, match=message):
        joint_gradient.check(0.5, temperature)
    joint_gradient.check(1.0, temperature)


def test_the_canonical_folder_and_decimation_have_no_gradient(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="another method or a joint gradient"):
        build.build(None, resources.body_models(), joint_factor=0.7)
    with pytest.raises(ValueError, match="joint_factor: expected 1"):
        build.build(None, tmp_path, method="quadric", joint_factor=0.7)
