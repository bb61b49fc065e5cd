# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices in the room reach points in range and inside the cone, at any position of the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_synthetic import MODELS, make_device, make_header, make_run

from hfx_blender.engine.rendering.device_config import RoomPlace
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.rendering.room import SETTING, PlaySpace, needs_positions, reaches
from hfx_blender.errors import InputError

PARTS = ("torso", "forearm")
FAN = RoomPlace(PARTS, at_m=(0.0, -2.0, 1.0), aim=(0.0, 1.0, 0.0), range_m=3.0, cone_deg=60.0)


def moved(x: float, turn_deg: float = 0.0) -> np.ndarray:
    angle = np.radians(turn_deg)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[0, 3] = x
    return matrix


@pytest.mark.parametrize(
    ("point", "is_reached"),
    [
        ((0.0, 0.0, 1.0), True),
        ((0.0, 0.99, 1.0), True),  # 2.99 m away
        ((0.0, 1.01, 1.0), False),
        ((1.15, 0.0, 1.0), True),  # 29.9 degrees off the axis
        ((1.16, 0.0, 1.0), False),  # 30.1
        ((0.0, 0.0, 2.16), False),
        ((0.0, -2.5, 1.0), False),  # behind the fan
        ((0.0, -2.0, 1.0), True),  # inside the fan
        ((np.nan, 0.0, 1.0), False),
    ],
)
def test_range_and_cone(point: tuple[float, ...], is_reached: bool) -> None:
    assert reaches(FAN, np.array([point])).tolist() == [is_reached]


def test_without_aim_the_reach_is_all_round_and_without_place_unlimited() -> None:
    heater = replace(FAN, aim=None)
    points = np.array([[0.0, -4.9, 1.0], [0.0, 2.0, 1.0]])
    assert reaches(heater, points).tolist() == [True, False]
    assert reaches(RoomPlace(PARTS), points * 1e6).all()


@given(st.integers(0, 2**32 - 1))
def test_reached_points_move_with_the_room(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3.0, 3.0, (50, 3)).astype(np.float32)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix[:3, 3] = rng.uniform(-5.0, 5.0, 3)
    header = make_header({"wind": "wind"}, 1)
    run = make_run(header, "wind", {0: dict.fromkeys(range(10), 1.0)}, [5.0, 0.0, 1.0, 0.0])
    world = (points[:10] @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    space = PlaySpace.of_settings({SETTING: PlaySpace.as_setting(matrix[None])})
    actual = space.local(replace(run, positions=world))
    assert actual == pytest.approx(points[:10], abs=1e-5)


def test_a_constant_pose_is_written_once() -> None:
    poses = np.array([moved(0.0)] * 3 + [moved(4.0)] * 2 + [moved(0.0)])
    setting = PlaySpace.as_setting(poses)
    assert [index for index, _ in setting] == [0, 3, 5]


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        "x",
        [[0]],
        [[0, [1.0] * 11]],
        [[0, [0.0] * 12]],
        [[0, [float("nan")] * 12]],
        [[1, moved(0.0)[:3].ravel().tolist()], [0, moved(0.0)[:3].ravel().tolist()]],
        [["a", moved(0.0)[:3].ravel().tolist()]],
    ],
)
def test_a_track_with_a_play_space_that_is_none_is_refused(wrong: object) -> None:
    with pytest.raises(InputError, match="play_space"):
        PlaySpace.of_settings({SETTING: wrong})


def fan_and_walker():
    """Return a fan, a header and a run: dots at y = 0, 10 cm apart, 2 m in front of the fan."""
    device = make_device({"fan": ("wind", FAN)})
    header = make_header({"wind": "wind"}, 4)
    run = make_run(header, "wind", {i: {4: 0.5, 7: 1.0} for i in range(4)}, [4.0, 0.0, 1.0, 0.0])
    places = MODELS["dots-pressure"].vertices[run.vertices] + np.float32([0.0, 0.0, 1.0])
    return device, header, replace(run, positions=places)


def played(header, device, run) -> tuple[list[float], list[str]]:
    renderer = Renderer(header, device, lambda name: MODELS[name])
    renderer.add([run])
    raster = renderer.raster()
    return raster.values[:, 0].tolist(), [shortfall.reason for shortfall in raster.shortfalls]


def test_a_teleport_moves_or_leaves_the_fan() -> None:
    device, header, run = fan_and_walker()
    assert needs_positions([device])
    assert played(header, device, run) == ([4.0] * 4, [])
    # The wearer stays, the play space jumps 5 m aside at the third sample: out of reach.
    poses = np.array([moved(0.0), moved(0.0), moved(5.0), moved(5.0)])
    gone = replace(header, settings={SETTING: PlaySpace.as_setting(poses)})
    values, reasons = played(gone, device, run)
    assert values == [4.0, 4.0, 0.0, 0.0]
    assert reasons == ["place"], "what is out of reach is reported"
    # Both jump: nothing changes.
    aside = run.positions + np.repeat(np.float32([[0, 0, 0], [5, 0, 0]]), 4, axis=0)
    assert played(gone, device, replace(run, positions=aside))[0] == [4.0] * 4


def test_the_strongest_weight_within_reach_counts() -> None:
    device, header, run = fan_and_walker()
    far = run.positions.copy()
    far[1::2, 0] += 10.0  # the vertices with weight 1
    assert played(header, device, replace(run, positions=far))[0] == [2.0] * 4


def test_other_body_parts_do_not_count() -> None:
    device, header, run = fan_and_walker()
    fan = replace(device.actuators[0], place=replace(FAN, parts=("forearm",)))
    device = replace(device, actuators=(fan,))
    assert played(header, device, run)[0] == [2.0] * 4  # vertex 4; 7 is on the torso


def test_samples_without_positions_are_always_in_reach() -> None:
    device, header, run = fan_and_walker()
    assert played(header, device, replace(run, positions=None))[0] == [4.0] * 4


def test_a_renderer_of_moments_follows_the_play_space() -> None:
    device, _, _ = fan_and_walker()
    assert not needs_positions([make_device({"fan": ("wind", RoomPlace(PARTS))})])
    header = make_header({"wind": "wind"}, 1)
    group = MomentRenderer(header, device, lambda name: MODELS[name])
    run = make_run(header, "wind", {0: {4: 0.5, 7: 1.0}}, [4.0, 0.0, 1.0, 0.0])
    places = MODELS["dots-pressure"].vertices[run.vertices] + np.float32([0.0, 0.0, 1.0])
    run = replace(run, positions=places)
    assert group.values([run])[0] == 4.0
    group.move_play_space(moved(5.0))
    assert group.values([run])[0] == 0.0
    group.move_play_space(np.full((4, 4), np.nan))  # left out
    assert group.values([run])[0] == 0.0
    group.move_play_space(moved(0.0))
    assert group.values([run])[0] == 4.0
