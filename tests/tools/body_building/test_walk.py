# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk cycle, measured on the walking avatar."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_tools.body_building import walk_cycle


def rotation(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion.astype(float)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def posed_bones(bones: model.Skeleton, walk: walk_cycle.WalkCycle, frame: int) -> np.ndarray:
    """Return bone matrices in rest space, by Blender's rule: parent, offset at rest, local
    rotation.
    """
    rest = bones.rest.astype(float)
    posed = np.zeros_like(rest)
    for number, parent in enumerate(bones.parents):
        own = np.eye(4)
        own[:3, :3] = rotation(walk.rotations[frame, number])
        if parent < 0:
            posed[number] = rest[number] @ own
            posed[number, :3, 3] += walk.root_offset_m[frame]
        else:
            posed[number] = posed[parent] @ np.linalg.inv(rest[parent]) @ rest[number] @ own
    return posed


@pytest.fixture(scope="module")
def walk() -> walk_cycle.WalkCycle:
    return walk_cycle.load_walk()


@pytest.fixture(scope="module")
def bones() -> model.Skeleton:
    return model.load_avatar().skeleton


@pytest.fixture(scope="module")
def heads(walk: walk_cycle.WalkCycle, bones: model.Skeleton) -> dict[str, np.ndarray]:
    """Return the path of each joint over the cycle: name -> (T, 3)."""
    posed = np.array([posed_bones(bones, walk, t) for t in range(len(walk.rotations))])
    return {name: posed[:, number, :3, 3] for number, name in enumerate(bones.bone_names)}


@pytest.fixture(scope="module")
def skins(walk: walk_cycle.WalkCycle, bones: model.Skeleton) -> np.ndarray:
    """Return the avatar's vertices in every frame, (T, V, 3)."""
    from scipy.sparse import csr_array

    avatar = model.load_avatar()
    weights = csr_array(
        (avatar.weights.values.astype(float), avatar.weights.bones, avatar.weights.offsets),
        shape=(len(avatar.vertices), len(bones.bone_names)),
    )
    frames = []
    for frame in range(len(walk.rotations)):
        moves = posed_bones(bones, walk, frame) @ np.linalg.inv(bones.rest.astype(float))
        blend = (weights @ moves.reshape(len(moves), 16)).reshape(-1, 4, 4)
        frames.append(np.einsum("vij,vj->vi", blend[:, :3, :3], avatar.vertices) + blend[:, :3, 3])
    return np.array(frames)


def test_the_walk_uses_the_canonical_skeleton(
    walk: walk_cycle.WalkCycle, bones: model.Skeleton
) -> None:
    assert walk.bone_names == bones.bone_names
    assert walk.rotations.shape == (len(walk.root_offset_m), 163, 4)
    assert np.linalg.norm(walk.rotations, axis=-1) == pytest.approx(1.0, abs=1e-6)


def test_pace_is_that_of_a_person(walk: walk_cycle.WalkCycle) -> None:
    duration_s = len(walk.rotations) / walk.rate_hz
    assert 0.9 < duration_s < 1.3
    assert 1.0 < walk.stride_m / duration_s < 1.5


def test_the_lowest_foot_is_always_on_the_ground(skins: np.ndarray) -> None:
    lowest = skins[:, :, 2].min(axis=1)
    assert lowest.min() > -0.006
    assert lowest.max() < 0.006


@pytest.mark.parametrize("side", (LEFT, RIGHT))
def test_the_standing_sole_goes_with_the_ground(
    skins: np.ndarray, walk: walk_cycle.WalkCycle, side: int
) -> None:
    avatar = model.load_avatar()
    sole = (avatar.part == PARTS.index("foot_sole")) & (avatar.side == side)
    way = walk.stride_m / len(skins)
    standing = 0
    height = skins[:, :, 2]
    for frame in range(len(skins)):
        # Vertices on the ground before, now and after, without landing and leaving vertices.
        around = [(frame + step) % len(skins) for step in (-1, 0, 1)]
        touching = sole & (height[around] < 0.004).all(axis=0)
        now, then = skins[around[1]], skins[around[2]]
        if touching.sum() < 30:
            continue
        standing += 1
        slide = (then - now)[touching].mean(axis=0) - (0.0, way, 0.0)
        assert np.abs(slide[:2]).max() < 0.004
    assert standing >= 0.4 * len(skins)


def test_arms_swing_against_the_legs(heads: dict[str, np.ndarray]) -> None:
    for side in "LR":
        leg = heads[f"foot.{side}"][:, 1] - heads["root"][:, 1]
        arm = heads[f"wrist.{side}"][:, 1] - heads[f"upperarm01.{side}"][:, 1]
        assert np.corrcoef(leg, arm)[0, 1] < -0.8


def test_the_right_side_repeats_the_left_half_a_cycle_later(
    heads: dict[str, np.ndarray],
) -> None:
    half = len(heads["root"]) // 2
    for name in ("foot", "lowerleg01", "wrist", "lowerarm01", "toe1-1"):
        left = np.roll(heads[f"{name}.L"], half, axis=0) * (-1.0, 1.0, 1.0)
        assert heads[f"{name}.R"] == pytest.approx(left, abs=2e-3), name


def test_knees_bend_forward_only_and_the_swinging_one_most(heads: dict[str, np.ndarray]) -> None:
    thigh = heads["lowerleg01.L"] - heads["upperleg01.L"]
    shank = heads["foot.L"] - heads["lowerleg01.L"]
    cosine = np.einsum("ij,ij->i", thigh, shank)
    cosine /= np.linalg.norm(thigh, axis=1) * np.linalg.norm(shank, axis=1)
    bend_deg = np.degrees(np.arccos(cosine))
    assert (np.cross(thigh, shank)[:, 0] > -1e-3).all()
    assert 45.0 < bend_deg.max() < 80.0  # about 60 in free walking
    assert bend_deg.argmax() / len(bend_deg) == pytest.approx(0.73, abs=0.1)
    assert bend_deg.min() < 15.0


def test_the_loop_is_smooth_at_the_seam(heads: dict[str, np.ndarray]) -> None:
    for name in ("root", "head", "wrist.L", "foot.L", "lowerleg01.R"):
        jump = np.roll(heads[name], -1, axis=0) - heads[name]
        change = np.linalg.norm(np.roll(jump, -1, axis=0) - jump, axis=1)
        assert change.max() < 0.045, name  # metres a frame, a frame: 40 m/s^2


def test_the_walk_is_in_place(walk: walk_cycle.WalkCycle) -> None:
    assert np.ptp(walk.root_offset_m[:, 1]) == 0.0
    assert np.ptp(walk.root_offset_m[:, 0]) < 0.06
    assert np.ptp(walk.root_offset_m[:, 2]) < 0.06
