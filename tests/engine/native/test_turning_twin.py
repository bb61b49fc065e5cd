# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotation angle between placements: compiled code, numpy and construction agree."""

from __future__ import annotations

import numpy as np
import pytest
from both_ways import needs_library
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.kinematics.placement_motion import Motion, turned_by

pytestmark = needs_library


def _rotation(rng: np.random.Generator, angle: float) -> np.ndarray:
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _placement(linear: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, (1.0, -2.0, 0.5)
    return matrix


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, 2**31),
    st.floats(0.0, np.pi),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.tuples(*[st.sampled_from([1.0, -1.0])] * 2),
)
def test_a_stretched_and_mirrored_placement_turns_as_far_as_it_was_turned(
    seed, angle, size, handed
):
    rng = np.random.default_rng(seed)
    start, axes = _rotation(rng, rng.uniform(0.0, np.pi)), _rotation(rng, 1.0)
    # Symmetric, so pure stretch; up to 100 : 1.
    stretches = [axes @ np.diag(np.exp(rng.uniform(-2.3, 2.3, 3))) @ axes.T for _ in range(2)]
    before = _placement(size * handed[0] * start @ stretches[0])
    after = _placement(size * handed[1] * _rotation(rng, angle) @ start @ stretches[1])
    actual = turned_by(before[None], after[None])[0]
    expected = Motion.between(before[None], after[None]).angles[0]
    # Half a turn is determined by a sine near zero.
    assert actual == pytest.approx(angle, abs=1e-7)
    assert actual == pytest.approx(expected, abs=1e-7)


def test_no_rotation_gives_exactly_zero():
    rng = np.random.default_rng(1)
    linear = rng.normal(size=(3, 3))
    same = _placement(linear)
    moved, larger = same.copy(), _placement(3.0 * linear)
    moved[:3, 3] += 1.0
    assert turned_by(np.stack([same, same]), np.stack([moved, larger])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("seed", range(5))
def test_a_flat_placement_turns_with_its_plane(seed):
    rng = np.random.default_rng(seed)
    turn, angle = _rotation(rng, 1.0) if seed else np.eye(3), rng.uniform(0.1, 3.0)
    planes = [turn @ np.diag(sizes) @ turn.T for sizes in ([1.0, 2.0, 0.0], [2.0, 1.0, 0.0])]
    before, after = _placement(planes[0]), _placement(_rotation(rng, angle) @ planes[1])
    assert turned_by(before[None], after[None])[0] == pytest.approx(angle, abs=1e-7)
    assert Motion.between(before[None], after[None]).angles[0] == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("flat", [(0.0, 1.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_line_and_a_point_have_some_angle(flat):
    before, after = _placement(np.diag(flat)), _placement(np.diag(flat[::-1]))
    after[0, 1] = 0.5
    assert 0.0 <= turned_by(before[None], after[None])[0] <= np.pi
