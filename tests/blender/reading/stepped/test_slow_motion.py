# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses are only interpolated where nothing may swing between those that are read."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.tolerance import EXACT, STANDARD, Tolerance
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped.slow_motion import is_shown_by

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

ARM = 'pose.bones["upperarm01.L"].rotation_euler'
PERIODS = 26.0  # of swings in a second: no multiple of what is read


@pytest.fixture
def arm(scene: Any) -> Any:
    """An arm under a constraint, turned slowly by keys, and a ball that is near it."""
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 24
    body = oracle.add_avatar()
    bone = body.pose.bones["upperarm01.L"]
    bone.rotation_mode = "XYZ"
    bone.constraints.new("LIMIT_ROTATION")
    oracle.key(body, ARM, [(1, (0.0, 0.0, 0.0)), (24, (0.4, 0.0, 0.0))])
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.3, -0.1, 1.2), radius=0.3)
    return body


def driver(body: Any) -> None:
    turned = body.pose.bones["upperarm01.L"].driver_add("rotation_euler", 2).driver
    turned.expression = f"0.15 * sin(frame * 2 * pi * {PERIODS} / 24)"


def target_with_a_driver(body: Any) -> None:
    """The bone itself has none: it follows one."""
    target = bpy.data.objects.new("Target", None)
    bpy.context.scene.collection.objects.link(target)
    turned = target.driver_add("rotation_euler", 2).driver
    turned.expression = f"0.15 * sin(frame * 2 * pi * {PERIODS} / 24)"
    follows = body.pose.bones["upperarm01.L"].constraints.new("COPY_ROTATION")
    follows.target, follows.mix_mode = target, "ADD"
    follows.target_space = follows.owner_space = "LOCAL"


def _curve(body: Any, axis: int = 0) -> Any:
    return next(
        each for each in compat.fcurves(body) if each.data_path == ARM and each.array_index == axis
    )


def noise(body: Any) -> None:
    modifier = _curve(body, 2).modifiers.new("NOISE")
    modifier.scale, modifier.strength = 0.7, 0.5


def sine(body: Any) -> None:
    modifier = _curve(body, 2).modifiers.new("FNGENERATOR")
    modifier.use_additive, modifier.amplitude = True, 0.15
    modifier.phase_multiplier = 2.0 * np.pi * PERIODS / 24.0


def keys_between_frames(body: Any) -> None:
    frames = np.arange(1.0, 24.0, 12.0 / PERIODS)
    oracle.key(body, ARM, [(f, (0.0, 0.0, 0.15 * (-1) ** k)) for k, f in enumerate(frames)])


def spin(body: Any) -> None:
    """Two keys, many turns."""
    oracle.key(body, ARM, [(1, (0.0, 0.0, 0.0)), (24, (0.0, 0.0, 2.0 * np.pi * PERIODS))])


def elastic(body: Any) -> None:
    for point in _curve(body).keyframe_points:
        point.interpolation, point.period, point.amplitude = "ELASTIC", 24.0 / PERIODS, 0.3


def _target(*places: tuple[float, Any]) -> Any:
    """An empty that goes slowly from place to place."""
    target = bpy.data.objects.new("Target", None)
    bpy.context.scene.collection.objects.link(target)
    oracle.key(target, "location", places)
    return target


def aimed_at_what_passes_through(body: Any) -> None:
    """The target turns back 1 mm behind the shoulder: a moment of pointing the other way."""
    bone = body.pose.bones["upperarm01.L"]
    head, along = body.matrix_world @ bone.head, (bone.tail - bone.head).normalized()
    near, behind = head + 0.05 * along, head - 0.001 * along
    target = _target((1, near), (12.3, behind), (24, near))
    bone.constraints.new("DAMPED_TRACK").target = target


def mapped_steeply(body: Any) -> None:
    """The last 0.3 mm of a slow way turn the arm."""
    turns = body.pose.bones["upperarm01.L"].constraints.new("TRANSFORM")
    turns.target = _target((1, (0.0, 0.0, 0.0)), (12.3, (0.1, 0.0, 0.0)), (24, (0.0, 0.0, 0.0)))
    turns.map_to, turns.mix_mode_rot, turns.owner_space = "ROTATION", "ADD", "LOCAL"
    turns.from_min_x, turns.from_max_x, turns.to_max_z_rot = 0.0997, 0.1, 1.0
    turns.map_to_z_from = "X"


def taken_over_in_part(body: Any) -> None:
    """Half of a rotation by about half a turn is one way round or the other."""
    copies = body.pose.bones["upperarm01.L"].constraints.new("COPY_TRANSFORMS")
    copies.target, copies.influence = _target((1, (0.0, 0.0, 0.0))), 0.5


FAST = (
    *(driver, target_with_a_driver, noise, sine, keys_between_frames, spin, elastic),
    *(aimed_at_what_passes_through, mapped_steeply, taken_over_in_part),
)


def _poses(tolerance: Tolerance) -> tuple[int, dict[int, Any]]:
    reader = SceneReader(bpy.context.scene, rate_hz=Fraction(100), tolerance=tolerance)
    found = {}
    for block in reader.blocks():
        (posed,) = block.poses
        for row, index in enumerate(block.indices.tolist()):
            found[index] = posed.bones[row].copy()
    return reader.counters.times_stepped, found


@pytest.mark.parametrize("swing", FAST)
def test_fast_motion_is_read_at_every_sample(arm: Any, swing: Any) -> None:
    swing(arm)
    assert not is_shown_by(0.48, [arm])
    times, truth = _poses(EXACT)
    stepped, found = _poses(STANDARD)
    assert stepped == times
    assert found.keys() == truth.keys()
    assert max(np.abs(found[k] - truth[k]).max() for k in truth) == 0.0


def test_slow_motion_is_read_now_and_then(arm: Any) -> None:
    follows = arm.pose.bones["lowerarm01.L"].constraints.new("COPY_LOCATION")
    follows.target, follows.influence = _target((1, (0.5, 0.0, 1.2)), (24, (0.6, 0.0, 1.2))), 0.5
    far = _target((1, (9.0, 0.0, 0.0)))
    far.constraints.new("DAMPED_TRACK").target = arm  # nothing of the body follows it
    assert is_shown_by(0.48, [arm])
    assert _poses(STANDARD)[0] < 0.7 * _poses(EXACT)[0]


def test_what_a_body_does_not_follow_may_swing(arm: Any) -> None:
    other = oracle.empty(bpy.context.scene)
    oracle.key(other, "location", [(k, (0.1 * (-1) ** k, 0.0, 0.0)) for k in range(1, 25)])
    assert is_shown_by(1.01, [arm])
    arm.pose.bones["head"].constraints.new("COPY_LOCATION").target = other
    assert not is_shown_by(1.01, [arm])


def test_strips_that_play_fast_are_seen(arm: Any) -> None:
    data = arm.animation_data
    oracle.key(arm, ARM, [(k, (0.0, 0.0, 0.1 * (-1) ** k)) for k in range(1, 25)])
    assert is_shown_by(1.0, [arm])
    strip = data.nla_tracks.new().strips.new("Fast", 1, data.action)
    data.action = None
    assert is_shown_by(1.0, [arm])
    strip.scale = 0.25
    assert not is_shown_by(1.0, [arm])
