# SPDX-License-Identifier: GPL-3.0-or-later
"""Only as many poses are read as a tolerance asks for, and what lies between is within it."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.tolerance import EXACT, STANDARD, Tolerance
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped.adaptive_reading import AdaptivePoses, Span, grid_step
from hfx_blender.reading.stepped.scene_rows import PoseRow

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

RATE_HZ = 100


def bent(index: float) -> float:
    """A way with a kink at 41.5."""
    return abs(index - 41.5)


def pose(metres: float) -> PoseRow:
    bones = np.zeros((1, 3, 4))
    bones[0, :, :3] = np.eye(3)
    bones[0, 0, 3] = metres
    return PoseRow(np.eye(4), bones)


class Reads:
    """Poses on a way, with a count of what was read."""

    def __init__(self, way: Any, limit: float, step: int = 8, offset: int = 0) -> None:
        self.read: list[int] = []

        def read(index: int) -> dict[int, PoseRow]:
            self.read.append(index)
            return {0: pose(way(index + offset))}

        def allows(span: Span) -> bool:
            low, true, high = (
                self.poses.bones(k, 0)[0, 0, 3] for k in (span.low, span.middle, span.high)
            )
            return abs(true - (low + high) / 2) <= limit

        self.poses = AdaptivePoses(read, lambda _: (-1000, 1000), allows, step, offset)

    def at(self, index: int) -> float:
        return self.poses.at(index)[0].bones[0, 0, 3]


def test_straight_motion_is_read_at_the_grid_only() -> None:
    reads = Reads(lambda index: 0.5 * index, 1e-9)
    assert [reads.at(k) for k in range(64)] == [0.5 * k for k in range(64)]
    assert reads.read == [0, 8, 4, 16, 12, 24, 20, 32, 28, 40, 36, 48, 44, 56, 52, 64, 60]


def test_a_kink_is_read_closely() -> None:
    reads = Reads(bent, 0.2)
    found = [reads.at(k) for k in range(64)]
    assert np.abs(np.array(found) - [bent(k) for k in range(64)]).max() <= 0.2
    assert {41, 42} <= set(reads.read) and len(set(reads.read)) == 21


def test_nothing_depends_on_where_reading_begins() -> None:
    """The grid is the scene's: a range that begins within a cell reads the whole of it."""
    whole, part = Reads(bent, 0.6), Reads(bent, 0.6, offset=37)
    assert [part.at(k) for k in range(20)] == [whole.at(k + 37) for k in range(20)]


def test_no_line_leaves_the_stretch() -> None:
    reads = Reads(lambda index: float(index), 1e9)
    reads.poses._stretch_of = lambda index: (3, 6) if index <= 6 else (9, 9)
    for index in (3, 4, 5, 6, 9):
        reads.at(index)
    assert sorted(reads.read) == [3, 4, 6, 9]


@pytest.mark.parametrize(("rate_hz", "step"), [(10, 1), (39, 1), (40, 2), (100, 4), (1000, 32)])
def test_the_grid_is_fine_in_time(rate_hz: int, step: int) -> None:
    assert grid_step(Fraction(rate_hz)) == step


# In a scene


@pytest.fixture
def constrained(scene: Any) -> Any:
    """A body that swings its arms as drivers tell, and a ball that it goes through."""
    scene.render.fps = 24
    scene.frame_start, scene.frame_end = 1, 24
    body = oracle.add_avatar()
    bone = body.pose.bones["upperarm01.L"]
    bone.rotation_mode = "XYZ"
    bone.constraints.new("LIMIT_ROTATION")
    oracle.key(bone.id_data, 'pose.bones["upperarm01.L"].rotation_euler', [(1, (0, 0, 0))])
    oracle.key(bone.id_data, 'pose.bones["upperarm01.L"].rotation_euler', [(24, (1.5, 0, 0))])
    oracle.key(body, "location", [(1, (0, 0, 0)), (24, (0, -0.6, 0))])
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.3, -0.3, 1.2), radius=0.3)
    return scene


def _poses(scene: Any, tolerance: Tolerance, **settings: Any) -> tuple[SceneReader, dict[int, Any]]:
    reader = SceneReader(scene, rate_hz=Fraction(RATE_HZ), tolerance=tolerance, **settings)
    found = {}
    for block in reader.blocks():
        (posed,) = block.poses
        for row, index in enumerate(block.indices.tolist()):
            found[index] = posed.to_world[row, :3, :3] @ posed.bones[row]
            found[index][..., 3] += posed.to_world[row, :3, 3]
    return reader, found


def test_fewer_times_are_stepped_and_bones_are_where_they_should_be(constrained: Any) -> None:
    exact, truth = _poses(constrained, EXACT)
    assert exact.stepping_note.startswith("stepped a scratch scene, because bone 'upperarm01.L'")
    standard, found = _poses(constrained, STANDARD)
    assert standard.counters.times_stepped < 0.7 * exact.counters.times_stepped
    assert found.keys() == truth.keys()
    gaps = [np.abs(found[index][..., 3] - truth[index][..., 3]).max() for index in truth]
    assert 0.0 < max(gaps) < STANDARD.distance_m


def test_samples_that_are_no_denser_than_frames_are_all_read(constrained: Any) -> None:
    constrained.render.fps, constrained.frame_end = 60, 60
    exact, truth = _poses(constrained, EXACT)
    standard, found = _poses(constrained, STANDARD)
    assert standard.counters.times_stepped == exact.counters.times_stepped
    assert all(found[index].tobytes() == truth[index].tobytes() for index in truth)


def test_a_jump_stays_a_jump(constrained: Any) -> None:
    body = bpy.data.objects["Avatar"]
    for curve in compat.fcurves(body):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    oracle.key(body, "location", [(9.37, (0, -0.4, 0))])
    for curve in compat.fcurves(body):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    _, truth = _poses(constrained, EXACT)
    _, found = _poses(constrained, STANDARD)
    assert max(np.abs(found[index] - truth[index]).max() for index in truth) < 1e-6
    assert len({float(matrix[0, 1, 3]) for matrix in truth.values()}) == 3


def test_a_range_reads_the_same_poses_as_the_whole(constrained: Any) -> None:
    _, whole = _poses(constrained, STANDARD)
    part, found = _poses(constrained, STANDARD, frames=(7, 18))
    offset = Fraction(6 * RATE_HZ, 24)
    assert offset.denominator == 1 and min(found) == -1, "the first has a history"
    assert part.time.sample_count == 50
    for index, matrix in found.items():
        assert matrix.tobytes() == whole[index + int(offset)].tobytes()


# The sample before


def _firsts(scene: Any, **settings: Any) -> list[tuple[int, int]]:
    reader = SceneReader(scene, rate_hz=Fraction(24), **settings)
    return [(int(block.indices[0]), block.history) for block in reader.blocks()]


def test_each_block_knows_the_sample_before_within_its_stretch(scene: Any) -> None:
    scene.render.fps = 24
    scene.frame_start, scene.frame_end = 1, 150
    oracle.add_avatar()
    ball = oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2), radius=0.3)
    assert _firsts(scene) == [(0, 0), (63, 1), (127, 1)]
    assert _firsts(scene, frames=(41, 150)) == [(-1, 1), (63, 1)]
    oracle.add_clip(ball, 21, 101)
    assert _firsts(scene) == [(20, 0), (63, 1)]


def test_painted_effects_need_no_sample_before(scene: Any) -> None:
    scene.frame_start, scene.frame_end = 1, 150
    oracle.add_painted("Felt", "pressure", oracle.add_avatar())
    assert _firsts(scene) == [(0, 0), (64, 0), (128, 0)]
