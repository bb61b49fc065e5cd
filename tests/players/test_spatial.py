# SPDX-License-Identifier: GPL-3.0-or-later
"""The spatial core agrees with the engine on contacts, and drives the actuators in reach."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from check_spatial import Shares, clip_of, compare
from core_library import Body, Clip
from small_clip import write_small_clip
from walkers import RATE_HZ, bouncing, stage, walk

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model, load_skeleton
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.response_filters.controls import Filter, FilterKind, Operation
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.track import TrackHeader
from hfx_blender.formats.clip.clip_writer import write
from hfx_blender.formats.clip.common_rigs import rig_names
from hfx_blender.formats.clip.container import encoded
from hfx_blender.formats.clip.spatial_recorder import SpatialRecorder
from hfx_tools.formats import clip_rules
from hfx_tools.formats.clip_reader import texts_at


@pytest.mark.parametrize(("level", "seconds"), [(2, 0.25), (0, 0.04)])
def test_a_walker_feels_volumes_as_the_engine_at_tolerance_paper(
    level: int, seconds: float, tmp_path: Path
) -> None:
    shares = Shares()
    compare(walk(2, seconds, responds=True), tmp_path, level, shares)
    assert shares.samples > 5000
    assert shares.within >= 0.999 * shares.samples
    assert shares.values == shares.values_within  # actuator values, only at level 0
    assert (shares.values > 0) == (level == 0)


HITS = ((0.2, 1.05, 0.02), (0.4, 1.25, 0.012))
RINGING = stage(FilterKind.IMPACT, Operation.MULTIPLY, 1.0, 0.0, 0.15, 1.0)


@pytest.mark.parametrize(
    "filters",
    [
        (RINGING,),
        (
            stage(FilterKind.SPEED, Operation.MULTIPLY, 0.5, 0.0, 2.0),
            stage(FilterKind.IMPACT, Operation.ADD, 0.7, 0.02, 0.1, 1.0),
            stage(FilterKind.IMPACT, Operation.ADD, 0.2, 0.0, 0.4, 1.0),
        ),
        (RINGING, stage(FilterKind.PROXIMITY, Operation.MAXIMUM, 0.3, 0.05, 1.5)),
    ],
)
def test_two_impacts_ring_as_in_the_engine(
    filters: tuple[tuple[Filter, np.ndarray], ...], tmp_path: Path
) -> None:
    shares = Shares()
    compare(bouncing(HITS, filters), tmp_path, 2, shares)
    assert shares.samples > 80
    assert shares.within == shares.samples


def test_an_impact_rings_at_the_weights_of_its_deepest_frame(tmp_path: Path) -> None:
    model = bouncing(HITS[:1], (RINGING,))
    path, bones = clip_of(model, tmp_path, 0)
    body = Body(Clip(path.read_bytes()))
    body.set_bones(model.matrices[0, bones])
    for row in range(60):
        body.set_volume(0, model.block.effects[0].matrices[row, :3])
        body.trigger(0, 1.0)
        body.evaluate(1.0 / RATE_HZ if row else 0.0)
        since = row / RATE_HZ - 0.18  # 20 mm deep at 0.2 s, at 1 m/s
        if row >= 25:  # the ball has left
            # As deep as at 0.2 s, frame 18: a circle of the ball of this many vertices at least.
            assert np.count_nonzero(body.weights(0)) > 5
            assert set(body.weights(0)) == {0.0, 1.0}
            assert body.level(0) == pytest.approx(np.exp(-since / 0.15), rel=0.01)


def test_a_painted_area_drives_the_actuators_in_reach(tmp_path: Path) -> None:
    model = load_model("hfx-vibration-1")
    palm = np.flatnonzero((model.part == PARTS.index("hand_palm")) & (model.vertices[:, 0] > 0.0))
    area = PaintedArea("b", palm.astype(np.int32), np.full(len(palm), 0.5, np.float32))
    effect = EffectDescription("e", "Engine", "vibration", model.id, area)
    binding = SkinBinding(load_skeleton().bone_names)
    scene = SceneDescription(
        TimeBase(Fraction(50), Fraction(50), 0, 0, 1),
        (BodyDescription("b", "Anna", binding),),
        (effect,),
    )
    animated = EffectBlock(np.array([0.25, 1.0]), np.tile([12.0, 90.0], (2, 1)))
    still = PoseBlock(np.ones(2, np.bool_), np.tile(np.eye(4), (2, 1, 1)))
    recorder = SpatialRecorder(scene)
    recorder.add(AnimationBlock(np.arange(2), (animated,), (still,)))
    header = TrackHeader.of(scene, {model.id: model}, settings={}, tools={})
    device = load_device("oculus_touch")
    (path,) = write(header, [(device, render(header, [], device))], tmp_path / "x", recorder).files
    sections = clip_rules.read(path.read_bytes(), "x")
    assert sections["EFCT"]["level"].tolist() == [1.0]  # the highest
    body = Body(Clip(path.read_bytes()))
    bones = len(sections["BONE"])
    body.set_bones(np.tile(np.eye(4)[:3], (bones, 1, 1)))
    assert body.evaluate(0.02).tolist() == [0, 160, 0, 160]  # silent until triggered
    assert body.trigger(0, 0.8) == 0
    # Weight 0.5 * level 0.8 * 12 m/s^2; the motor has 160 Hz only. The right hand feels nothing.
    assert body.evaluate(0.02).tolist() == pytest.approx([4.8, 160, 0, 160], rel=1e-6)
    assert body.set_parameter(0, 0, 30.0) == 0
    assert body.evaluate(0.02)[0] == 10.0  # the motor's limit
    assert body.trigger(1, 1.0) == -6
    fan = load_device("fan_heater")
    beside_the_fan = replace(fan.actuators[0].place, at_m=(0.0, 1.0, 1.0))
    fan = replace(
        fan, actuators=tuple(replace(actuator, place=beside_the_fan) for actuator in fan.actuators)
    )
    coarse = SpatialRecorder(scene, 2)
    coarse.add(AnimationBlock(np.arange(2), (animated,), (still,)))
    messages = write(header, [(fan, render(header, [], fan))], tmp_path / "coarse", coarse)
    assert any("actuators at a place in the room follow no avatar: 2" in n for n in messages.notes)
    models = clip_rules.read(messages.files[0].read_bytes(), "coarse")["MODL"]
    assert models["level"].tolist() == [2] and models["vertices"] < sections["MODL"]["vertices"] / 3
    human = texts_at(sections, sections["BONE"]["human"])
    assert {"leftHand", "hips", "head", "rightLowerLeg"} <= set(human)


def test_bones_have_the_names_of_common_rigs() -> None:
    actual = {
        name: tuple(vars(rig_names(name)).values())
        for name in ("upperarm02.L", "finger1-2.R", "finger5-1.L", "root", "wrist.R")
    }
    assert actual == {
        "upperarm02.L": ("leftUpperArm", "LeftArm", "upperarm_l"),
        "finger1-2.R": ("rightThumbProximal", "RightHandThumb2", "thumb_02_r"),
        "finger5-1.L": ("leftLittleProximal", "LeftHandPinky1", "pinky_01_l"),
        "root": ("hips", "Hips", "pelvis"),
        "wrist.R": ("rightHand", "RightHand", "hand_r"),
    }
    assert all(rig_names(name).human for name in load_skeleton().bone_names)


def test_a_clip_with_every_kind_of_record_is_valid_and_plays(tmp_path: Path) -> None:
    content = write_small_clip(tmp_path).read_bytes()
    assert clip_rules.validate(content, "x") == []
    body = Body(Clip(content))
    body.set_bones(np.tile(np.eye(4)[:3], (2, 1, 1)))
    assert body.trigger(4, 1.0) == 0
    # Painted: weights 0, 0.2 ... 0.8 of vertices 0 to 4; the volumes stand at the origin.
    body.evaluate(0.02)
    assert body.weights(4)[:6] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 0])
    assert body.level(4) == 0.5  # as in the clip


def test_skin_arriving_after_distant_frames_has_contacts(tmp_path: Path) -> None:
    content = write_small_clip(tmp_path).read_bytes()
    places = clip_rules.read(content, "x")["VERT"]["place"].astype(np.float64)
    body = Body(Clip(content))
    bones = np.tile(np.eye(4)[:3], (2, 1, 1))
    bones[:, 0, 3] = 10.0
    for _ in range(2):
        body.set_bones(bones)
        body.evaluate(0.02)
        assert not body.weights(0).any()
    bones[:, 0, 3] = 0.0, -1.0  # each vertex follows the second bone by 40,000 of 65,535
    body.set_bones(bones)
    body.evaluate(0.02)
    is_inside = np.abs(places - [40000 / 65535, 0.0, 0.0]).max(axis=1) <= 1.0
    assert 0 < is_inside.sum() < 40
    assert body.weights(0).tolist() == is_inside.tolist()


def test_the_speed_of_a_touch_is_the_mean_over_the_touched_skin(tmp_path: Path) -> None:
    content = write_small_clip(tmp_path).read_bytes()
    places = clip_rules.read(content, "x")["VERT"]["place"].astype(np.float64)
    body = Body(Clip(content))
    for scale in (1.0, 1.01):
        body.set_bones(np.tile(scale * np.eye(4)[:3], (2, 1, 1)))
        body.evaluate(0.02)
    x, y, z = 1.01 * places.T  # the third volume: a cylinder with a smooth falloff of 0.7
    rise = np.clip((1.0 - np.maximum(np.hypot(x, y), np.abs(z))) / 0.7, 0.0, 1.0)
    weights = 3.0 * rise**2 - 2.0 * rise**3
    speed = np.average(np.linalg.norm(0.01 * places, axis=1), weights=weights) / 0.02
    value = np.clip((speed - 0.1) / (1.2 - 0.1), 0.0, 1.0)
    wave = 1.0 - 0.8 * (1.0 - np.sin(2.0 * np.pi * (3.0 * 0.04 + 0.2))) / 2.0
    expected = 0.9 * (1.0 + 0.8 * (value - 1.0)) * (1.0 + 0.7 * (wave - 1.0))
    assert body.level(2) == pytest.approx(expected, rel=1e-4)


def test_filters_beyond_all_measure_give_numbers_that_a_device_may_play(tmp_path: Path) -> None:
    known = clip_rules.read(write_small_clip(tmp_path).read_bytes(), "x")
    sections = {name: of.copy() for name, of in known.items()}
    sections["FLTR"]["kind"] = 0
    sections["FLTR"]["controls"] = [3e38, 0.0, 1.0, 3e38, 3e38]
    sections["EFCT"]["parameters"] = 0.0  # times infinity would be no number
    body = Body(Clip(encoded(sections, "x")))
    body.set_bones(np.tile(np.eye(4)[:3], (2, 1, 1)))
    assert body.evaluate(0.02).tolist() == [0.0, 61.0]
    assert max(body.weights(effect).max() for effect in range(4)) == 1.0
