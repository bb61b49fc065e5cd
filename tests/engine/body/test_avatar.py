# SPDX-License-Identifier: GPL-3.0-or-later
"""Shipped avatar and skeleton."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import CENTRE, LEFT, PARTS, RIGHT


@pytest.fixture(scope="module")
def avatar() -> model.Avatar:
    return model.load_avatar()


def test_the_avatar_stands_on_the_ground_180_cm_tall(avatar: model.Avatar) -> None:
    assert avatar.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert avatar.vertices[:, 2].max() == pytest.approx(1.8, abs=1e-6)


def test_the_avatar_faces_minus_y_with_the_left_at_plus_x(avatar: model.Avatar) -> None:
    names = avatar.skeleton.bone_names
    heads = avatar.skeleton.rest[:, :3, 3]
    assert heads[names.index("toe1-1.L"), 1] < heads[names.index("foot.L"), 1]
    assert heads[names.index("wrist.L"), 0] > 0.3
    assert heads[names.index("wrist.R"), 0] < -0.3


def test_hash_is_the_manifests(avatar: model.Avatar) -> None:
    assert model.manifest()["avatar"]["hash"] == avatar.content_hash


def test_the_avatar_is_a_closed_surface_of_quads(avatar: model.Avatar) -> None:
    assert (avatar.faces >= 0).all()
    directed = np.concatenate([avatar.faces[:, [k, (k + 1) % 4]] for k in range(4)])
    forward = {tuple(edge) for edge in directed.tolist()}
    assert len(forward) == len(directed)
    assert forward == {(end, start) for start, end in forward}
    assert len(avatar.vertices) - len(forward) // 2 + len(avatar.faces) == 2


def test_every_part_of_a_side_is_there_and_left_equals_right(avatar: model.Avatar) -> None:
    for number, part in enumerate(PARTS):
        left = (avatar.part == number) & (avatar.side == LEFT)
        right = (avatar.part == number) & (avatar.side == RIGHT)
        assert left.sum() == right.sum() > 0, part
        mirrored = avatar.vertices[right] * np.array([-1, 1, 1], np.float32)
        assert {tuple(p) for p in mirrored.tolist()} == {
            tuple(p) for p in avatar.vertices[left].tolist()
        }
    assert np.array_equal(avatar.side == CENTRE, avatar.vertices[:, 0] == 0.0)


def test_texture_coordinates_are_in_the_unit_square(avatar: model.Avatar) -> None:
    assert avatar.uv.shape == (len(avatar.faces), 4, 2)
    assert avatar.uv.min() >= 0.0 and avatar.uv.max() <= 1.0


def test_the_skeleton_has_163_bones_parents_first(avatar: model.Avatar) -> None:
    bones = avatar.skeleton
    assert len(bones.bone_names) == len(set(bones.bone_names)) == 163
    assert bones.parents[0] == -1
    assert (bones.parents[1:] < np.arange(1, 163)).all() and (bones.parents[1:] >= 0).all()
    assert (bones.lengths_m > 1e-3).all()


def test_bone_matrices_are_rotations_without_scale(avatar: model.Avatar) -> None:
    # Within 1e-4: nearly downward bones are a series in Blender, and so here.
    turn = avatar.skeleton.rest[:, :3, :3].astype(float)
    assert turn @ np.swapaxes(turn, 1, 2) == pytest.approx(
        np.broadcast_to(np.eye(3), turn.shape), abs=1e-4
    )
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-4)


def test_weights_sum_to_one(avatar: model.Avatar) -> None:
    weights = avatar.weights
    sums = np.add.reduceat(weights.values.astype(float), weights.offsets[:-1])
    assert len(sums) == len(avatar.vertices)
    assert sums == pytest.approx(1.0, abs=1e-6)


def test_source_vertices_name_one_vertex_of_the_base_mesh_each(avatar: model.Avatar) -> None:
    runs = np.array(avatar.provenance["source_vertices"])
    assert (runs[:, 1] - runs[:, 0] + 1).sum() == len(avatar.vertices)
    assert (runs[1:, 0] > runs[:-1, 1] + 1).all()
