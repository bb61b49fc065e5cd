# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of stepped scenes: each is read as evaluated by Blender, in blocks with neighbouring
samples.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.tolerance import PREVIEW, STANDARD
from hfx_blender.reading.scene_reader import SceneReader

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

RATE_HZ = 100
BONE = "upperarm01.L"


@pytest.fixture
def constrained(scene: Any) -> Any:
    """A body swinging an arm under a constraint, and a ball in the arm's way."""
    scene.render.fps = 24
    scene.frame_start, scene.frame_end = 1, 24
    body = oracle.add_avatar()
    bone = body.pose.bones[BONE]
    bone.rotation_mode = "XYZ"
    bone.constraints.new("LIMIT_ROTATION")
    path = f'pose.bones["{BONE}"].rotation_euler'
    oracle.key(body, path, [(1, (0, 0, 0)), (24, (1.5, 0, 0))])
    oracle.key(body, "location", [(1, (0, 0, 0)), (24, (0, -0.6, 0))])
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.3, -0.3, 1.2), radius=0.3)
    return scene


def _poses(scene: Any, **settings: Any) -> tuple[SceneReader, dict[int, Any]]:
    """World matrices (B, 3, 4) of the bones, by sample."""
    reader = SceneReader(scene, rate_hz=Fraction(RATE_HZ), **settings)
    actual = {}
    for block in reader.blocks():
        (posed,) = block.poses
        for row, index in enumerate(block.indices.tolist()):
            actual[index] = posed.to_world[row, :3, :3] @ posed.bones[row]
            actual[index][..., 3] += posed.to_world[row, :3, 3]
    return reader, actual


@pytest.mark.parametrize("tolerance", [STANDARD, PREVIEW], ids=lambda each: each.name)
def test_bones_are_where_blender_puts_them_at_every_sample(
    constrained: Any, tolerance: Any
) -> None:
    reader, actual = _poses(constrained, tolerance=tolerance)
    assert reader.stepping_note.startswith(f"stepped a scratch scene, because bone '{BONE}'")
    body = bpy.data.objects["Avatar"]
    number = [bone.name for bone in body.pose.bones].index(BONE)
    for index, bones in actual.items():
        oracle.set_time(constrained, reader.time.frame(index))
        posed = body.evaluated_get(constrained.view_layers[0].depsgraph)
        bone = posed.pose.bones[BONE]
        truth = posed.matrix_world @ bone.matrix @ bone.bone.matrix_local.inverted()
        assert np.abs(bones[number] - np.array(truth)[:3]).max() < 2e-6


def test_a_jump_stays_a_jump(constrained: Any) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.key(body, "location", [(9.37, (0, -0.4, 0))])
    for curve in compat.fcurves(body):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    _, actual = _poses(constrained, tolerance=STANDARD)
    assert len({float(matrix[0, 1, 3]) for matrix in actual.values()}) == 3


def test_a_range_reads_the_same_poses_as_the_whole(constrained: Any) -> None:
    _, whole = _poses(constrained)
    part, actual = _poses(constrained, frames=(7, 18))
    offset = Fraction(6 * RATE_HZ, 24)
    assert offset.denominator == 1 and min(actual) == -1, "the first has a history"
    assert part.time.sample_count == 50
    for index, matrix in actual.items():
        assert matrix.tobytes() == whole[index + int(offset)].tobytes()


def _firsts(scene: Any, **settings: Any) -> list[tuple[int, int]]:
    reader = SceneReader(scene, rate_hz=Fraction(24), **settings)
    return [(int(block.indices[0]), block.history) for block in reader.blocks()]


def test_each_block_knows_the_sample_before_within_its_stretch(scene: Any) -> None:
    scene.render.fps = 24
    scene.frame_start, scene.frame_end = 1, 300
    oracle.add_avatar()
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2), radius=0.3)
    assert _firsts(scene) == [(0, 0), (127, 1), (255, 1)]
    assert _firsts(scene, frames=(41, 300)) == [(-1, 1), (127, 1), (255, 1)]
    oracle.add_clip(ball, 21, 201)
    assert _firsts(scene) == [(20, 0), (127, 1)]
    # Bodies of a stepped scene have blocks of half the size, stepped volumes of a quarter.
    ball.constraints.new("LIMIT_LOCATION")
    assert _firsts(scene) == [(20, 0), (31, 1), (63, 1), (95, 1), (127, 1), (159, 1), (191, 1)]


def test_many_effects_have_smaller_blocks(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 150
    body = oracle.add_avatar()
    for k in range(8):
        oracle.add_painted(f"Felt {k}", "pressure", body)
    assert _firsts(scene) == [(0, 0), (128, 0)]
    oracle.add_painted("Felt", "pressure", body)
    assert _firsts(scene) == [(0, 0), (64, 0), (128, 0)]


def test_painted_effects_need_no_sample_before(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 300
    oracle.add_painted("Felt", "pressure", oracle.add_avatar())
    assert _firsts(scene) == [(0, 0), (128, 0), (256, 0)]
