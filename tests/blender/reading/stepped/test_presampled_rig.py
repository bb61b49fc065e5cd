# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig evaluated without Blender: the copy equals the rig itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped import stepping

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")


@pytest.fixture
def walker(scene: Any) -> Iterator[Any]:
    """A body walking, looking at a moving ball and reaching for a target."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    body = bpy.data.objects["Avatar"]
    oracle.add_walk(body, [(0, 0, 0), (0, -1, 0)], 1, 12)
    ball = oracle.add_volume("Ball", "temperature", "SPHERE", (0.0, 0.0, 1.2), radius=0.3)
    oracle.key(ball, "location", [(1, (0.4, -1, 1.2)), (12, (-0.3, -2, 1.6))])
    head = body.pose.bones["head"].constraints.new("DAMPED_TRACK")
    head.target = ball
    yield body


def _read(scene: Any, rate_hz: int) -> tuple[SceneReader, list[Any]]:
    reader = SceneReader(scene, rate_hz=oracle.Fraction(rate_hz))
    return reader, list(reader.blocks())


def _farthest(
    scene: Any, monkeypatch: pytest.MonkeyPatch, rate_hz: int = 24, *, is_presampled: bool = True
) -> float:
    """Largest distance between bones of copy and own scene; asserts movement of the bones."""
    before = [len(item) for item in (bpy.data.objects, bpy.data.actions, bpy.data.scenes)]
    reader, blocks = _read(scene, rate_hz)
    assert reader.stepping_note.startswith("stepped a scratch scene")
    assert bool(reader.plan.presampled) == is_presampled
    assert before == [len(item) for item in (bpy.data.objects, bpy.data.actions, bpy.data.scenes)]
    monkeypatch.setattr(stepping, "foreign_handler", lambda: "a test wants it")
    own, truth = _read(scene, rate_hz)
    assert own.stepping_note.startswith("stepped the whole scene")
    bones = np.concatenate([block.poses[0].bones for block in blocks])
    second = np.concatenate([block.poses[0].bones for block in truth])
    places = np.concatenate([block.poses[0].to_world for block in blocks])
    assert np.array_equal(places, np.concatenate([b.poses[0].to_world for b in truth]))
    assert bones.std(axis=0).max() > 1e-3
    return float(np.abs(bones - second).max())


@pytest.mark.parametrize("rate_hz", [24, 61])
def test_a_walk_in_the_nla_comes_out_bit_by_bit(
    scene: Any, walker: Any, monkeypatch: pytest.MonkeyPatch, rate_hz: int
) -> None:
    assert _farthest(scene, monkeypatch, rate_hz) == 0.0


def test_what_else_the_rig_has_is_left_to_blender(
    scene: Any, walker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Inverse kinematics towards a bone of the same rig, a driver, and keyed influences."""
    reach = walker.pose.bones["lowerarm02.L"].constraints.new("IK")
    reach.target, reach.subtarget, reach.chain_count = walker, "head", 3
    oracle.key(
        walker, 'pose.bones["lowerarm02.L"].constraints["IK"].influence', [(1, 0.0), (12, 1.0)]
    )
    walker["bend"] = 0.0
    walker.keyframe_insert('["bend"]', frame=1)
    walker["bend"] = 1.0
    walker.keyframe_insert('["bend"]', frame=12)
    walker.pose.bones["wrist.R"].rotation_mode = "XYZ"
    driver = walker.driver_add('pose.bones["wrist.R"].rotation_euler', 0).driver
    driver.type = "SUM"
    target = driver.variables.new().targets[0]
    target.id, target.data_path = walker, '["bend"]'
    assert _farthest(scene, monkeypatch) == 0.0


def test_one_action_for_bones_and_the_rest(
    scene: Any, walker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Curves between keys are Blender's but for the rounding of 32 bits."""
    walker.animation_data.nla_tracks.remove(walker.animation_data.nla_tracks[0])
    oracle.key(
        walker,
        'pose.bones["upperarm01.L"].rotation_quaternion',
        [(1, (1, 0, 0, 0)), (7, (1, 0.5, 0, 0.2)), (12, (1, 0, 0.5, 0))],
    )
    assert len({curve.data_path for curve in compat.fcurves(walker)}) > 1
    assert _farthest(scene, monkeypatch, 61) < 1e-6


def test_a_rig_that_others_follow_is_not_fed(
    scene: Any, walker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The target of the rig's constraint is parented to the rig's own hand."""
    hand = oracle.empty(scene, "Hand", walker)
    hand.parent_type, hand.parent_bone = "BONE", "wrist.L"
    walker.pose.bones["neck01"].constraints.new("DAMPED_TRACK").target = hand
    assert _farthest(scene, monkeypatch) == 0.0


def test_a_copy_that_comes_out_otherwise_is_not_used(
    scene: Any, walker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.reading.curves import presampled_rig

    real = presampled_rig.PresampledRig.sample

    def askew(self: Any, chunk: int) -> None:
        real(self, chunk)
        for values in self.sampled.values():
            values += np.float32(1e-3)

    monkeypatch.setattr(presampled_rig.PresampledRig, "sample", askew)
    assert _farthest(scene, monkeypatch, is_presampled=False) == 0.0
