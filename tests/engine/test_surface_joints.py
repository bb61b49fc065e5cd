# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints in place of an avatar's surface: exact for rigid motion, close for bending."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.scene import PoseBlock, SurfaceAnchors, SurfaceBinding
from hfx_blender.engine.skin.surface_joints import SurfaceJoints

MODEL = load_model("hfx-temperature-1")
REST = MODEL.vertices.astype(np.float64)


def followed(places):
    """Return joints of a body with a mesh vertex at each model vertex, at positions (T, V, 3)."""
    corners = np.repeat(np.arange(len(MODEL), dtype=np.int32)[:, None], 3, axis=1)
    corners[:, 1] = (corners[:, 0] + 1) % len(MODEL)
    weights = np.tile([1.0, 0.0, 0.0], (len(MODEL), 1))
    anchors = SurfaceAnchors(corners, weights, np.zeros(len(MODEL)))
    joints = SurfaceJoints(SurfaceBinding({MODEL.id: anchors}, "cloth"), load_model)
    rows = np.arange(len(places))
    pose = PoseBlock(
        np.ones(len(places), bool), np.tile(np.eye(4), (len(places), 1, 1)), surface=places
    )
    return joints, *joints.matrices(pose, rows)


def turned(points, angles):
    cos, sin = np.cos(angles), np.sin(angles)
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)


def test_a_rigidly_moved_or_scaled_surface_is_followed_exactly():
    places = np.stack(
        [REST, 1.3 * turned(REST, 0.7) + [4.0, -2.0, 1.0], 0.5 * turned(REST, -2.0)]
    ).astype(np.float32)
    joints, actual, errors = followed(places)
    assert errors.max() < 1e-5
    joint = actual.astype(np.float64) @ np.append(REST[100], 1.0)
    assert np.abs(joint - places[:, None, 100]).max() < 1e-4  # each joint alone, too
    np.testing.assert_allclose(
        np.linalg.det(actual[:, :, :, :3]),
        np.array([[1.0], [1.3**3], [0.5**3]]) + 0 * actual[..., 0, 0],
        rtol=1e-4,
    )
    assert len(joints.names) < 256


@pytest.mark.parametrize("model_id", ["hfx-temperature-1", "hfx-pressure-1"])
def test_a_bent_surface_is_followed_within_the_stated_error(model_id):
    def bent(points):  # wrung: half a radian a metre of height
        return turned(points, 0.5 * points[..., 2])

    joints, actual, errors = followed(bent(REST)[None].astype(np.float32))
    model = load_model(model_id)
    bound = joints.bound(model)
    owners = np.repeat(np.arange(len(model)), np.diff(bound.offsets))
    moved = np.einsum(
        "eij,ej->ei", actual[0, bound.bones], bound.values[:, None] * bound.rest[owners]
    )
    there = np.zeros((len(model), 3))
    np.add.at(there, owners, moved)
    off = np.linalg.norm(there - bent(model.vertices.astype(np.float64)), axis=1)
    assert np.median(off) < 0.002 and errors[0] < 0.02
    if model is MODEL:
        np.testing.assert_allclose(errors, np.quantile(off, [0.99, 1.0]), atol=1e-5)
