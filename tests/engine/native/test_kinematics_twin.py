# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones posed by the library equal numpy's result bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.kinematics import bone_hierarchy
from hfx_blender.engine.kinematics.bone_hierarchy import BoneHierarchy, from_quaternions
from hfx_blender.engine.native.library import library

pytestmark = pytest.mark.skipif(library() is None, reason="no library was built")


def _without(work: Any) -> Any:
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        patch.setattr(bone_hierarchy, "library", lambda: None)
        return work()


@pytest.mark.parametrize("scale", [1e-160, 1e-5, 1.0, 1e160])
def test_rotations(scale: float) -> None:
    quaternions = np.random.default_rng(1).normal(0.0, scale, (7, 50, 4))
    quaternions[0, :3] = 0.0
    quaternions[1, 0, 2], quaternions[2, 0, 1], quaternions[3, 0] = np.nan, np.inf, -0.0
    actual = from_quaternions(quaternions)
    expected = _without(lambda: from_quaternions(quaternions))
    assert actual.shape == expected.shape == (7, 50, 3, 3)
    assert np.array_equal(actual, expected, equal_nan=True)
    assert from_quaternions(np.zeros((0, 4))).shape == (0, 3, 3)


@given(st.integers(0, 2**32 - 1))
def test_poses(seed: int) -> None:
    random = np.random.default_rng(seed)
    bones, times = int(random.integers(1, 12)), int(random.integers(0, 4))
    rank = random.permutation(bones)  # children may come before their parents
    parents = [
        -1 if rank[k] == 0 else int(random.choice([-1, *np.flatnonzero(rank < rank[k])]))
        for k in range(bones)
    ]
    rest = np.tile(np.eye(4), (bones, 1, 1))
    rest[:, :3] = random.normal(0.0, 1.0, (bones, 3, 4))
    local = random.random(bones) < random.choice([0.5, 1.0])
    rig = BoneHierarchy(parents, rest, local.tolist())
    channels = (
        random.normal(0.0, 1.0, (times, bones, 3)),
        from_quaternions(random.normal(0.0, 1.0, (times, bones, 4))),
        random.normal(1.0, 0.5, (times, bones, 3)),
    )
    if times:
        channels[0][0, 0, 0] = random.choice([0.0, np.nan, np.inf, 1e300])
    with np.errstate(all="ignore"):
        pose = rig.pose(*channels)
    expected = _without(lambda: rig.pose(*channels))
    assert pose.shape == expected.shape == (times, bones, 3, 4)
    assert np.array_equal(pose, expected, equal_nan=True)
