# SPDX-License-Identifier: GPL-3.0-or-later
"""Posed models: skin weights of the models compared with the avatar below."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body import model

BENT = {
    # bone stem -> degrees about the body's left-right axis, added to the parent's
    "sit": {"upperleg01": -90.0, "lowerleg01": 90.0, "upperarm01": -60.0, "lowerarm01": -80.0},
    "bow": {"spine03": 30.0, "spine02": 25.0, "neck01": 20.0, "upperarm01": 70.0},
}


def about(axis: np.ndarray, degrees: float) -> np.ndarray:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.radians(degrees)
    turn: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn


def moves_of(bones: model.Skeleton, pose: str) -> np.ndarray:
    """Return matrices of the bones relative to the body at rest, (B, 4, 4)."""
    heads = dict(zip(bones.bone_names, bones.rest[:, :3, 3].astype(float), strict=True))
    moves = np.zeros((len(bones.bone_names), 4, 4))
    for number, (name, parent) in enumerate(zip(bones.bone_names, bones.parents, strict=True)):
        turn = np.eye(3)
        stem, _, side = name.partition(".")
        if pose == "grip" and stem[:7] in ("finger2", "finger3", "finger4", "finger5"):
            row = heads[f"finger2-1.{side}"] - heads[f"finger5-1.{side}"]
            turn = about(row if side == "L" else -row, 70.0)
        elif stem in BENT.get(pose, {}):
            turn = about(np.array([1.0, 0.0, 0.0]), BENT[pose][stem])
        own = np.eye(4)
        own[:3, :3] = turn
        own[:3, 3] = heads[name] - turn @ heads[name]
        moves[number] = own if parent < 0 else moves[parent] @ own
    return moves


def blend(points: np.ndarray, weights: model.SkinWeights, moves: np.ndarray) -> np.ndarray:
    from scipy.sparse import csr_array

    table = csr_array(
        (weights.values.astype(float), weights.bones, weights.offsets),
        shape=(len(points), len(moves)),
    )
    matrices = (table @ moves.reshape(len(moves), 16)).reshape(-1, 4, 4)
    posed: np.ndarray = np.einsum("vij,vj->vi", matrices[:, :3, :3], points) + matrices[:, :3, 3]
    return posed


@pytest.mark.parametrize("pose", ("sit", "bow", "grip"))
@pytest.mark.parametrize("identity", ("hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"))
def test_vertices_stay_on_the_posed_avatar(identity: str, pose: str) -> None:
    shipped, avatar = model.load_model(identity), model.load_avatar()
    moves = moves_of(avatar.skeleton, pose)
    own = blend(shipped.vertices.astype(float), shipped.weights, moves)
    skin = blend(avatar.vertices.astype(float), avatar.weights, moves)
    corners = skin[shipped.avatar_vertices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    bound = np.einsum("vk,vkj->vj", shipped.avatar_weights, corners)
    bound += shipped.avatar_offset_m[:, None] * normal
    apart_mm = 1000.0 * np.linalg.norm(own - bound, axis=1)
    assert np.percentile(apart_mm, 99) < 2.0
    assert apart_mm.max() < 6.0


@pytest.mark.parametrize("identity", ("hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"))
def test_left_and_right_move_symmetrically(identity: str) -> None:
    shipped, bones = model.load_model(identity), model.load_avatar().skeleton
    posed = blend(shipped.vertices.astype(float), shipped.weights, moves_of(bones, "sit"))
    assert posed[shipped.mirror] * (-1.0, 1.0, 1.0) == pytest.approx(posed, abs=1e-5)
