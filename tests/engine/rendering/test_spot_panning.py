# SPDX-License-Identifier: GPL-3.0-or-later
"""Spot on panning devices: the phantom sensation is at the spot."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.mounts import on_mount
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SpotArea,
    TimeBase,
)
from hfx_blender.engine.track.header import TrackHeader

COUNT = 101


def _rendered(path: np.ndarray, device_name: str, radius: float = 0.0) -> Raster:
    """Render a spot moving along a path at constant speed within a second, at 100 Hz."""
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, COUNT - 1)
    area = SpotArea("body", path)
    effect = EffectDescription("spot", "Spot", "vibration", "hfx-vibration-1", area)
    scene = SceneDescription(time, (BodyDescription("body", "B", SkinBinding(())),), (effect,))
    animated = EffectBlock(
        np.ones(COUNT),
        np.tile([5.0, 200.0], (COUNT, 1)),
        place=np.stack([np.linspace(0.0, 1.0, COUNT), np.full(COUNT, radius)], axis=1),
    )
    pose = PoseBlock(np.zeros(COUNT, bool), np.zeros((COUNT, 4, 4)))
    runs = Engine(scene).evaluate(AnimationBlock(np.arange(COUNT), (animated,), (pose,)))
    models = {effect.model_id: load_model(effect.model_id)}
    header = TrackHeader.of(scene, models, settings={}, tools={})
    renderer = Renderer(header, load_device(device_name), load_model, compensates_latency=False)
    renderer.add(runs)
    return renderer.raster()


def _strengths(raster: Raster) -> np.ndarray:
    chosen = [k for k, c in enumerate(raster.columns) if c.parameter == "amplitude_m_s2"]
    return raster.values[:, chosen]


def _pad_places(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of a path's samples and of the tactors on the pad, metres."""
    device = load_device("mango_pad")
    centres = np.array([actuator.place.centre_m for actuator in device.actuators])
    places = path[0] + np.linspace(0, 1, COUNT)[:, None] * (path[1] - path[0])
    return on_mount(device.mount, places), on_mount(device.mount, centres)


def test_on_the_pad_the_phantom_follows_the_spot_by_mangos_log_law() -> None:
    """Inverting Ai = Av * log2(1 + ai) gives barycentric shares, exact in the middle."""
    path = np.array([[-0.07, 0.09, 1.27], [0.06, 0.09, 1.24]])
    shares = 2.0 ** (_strengths(_rendered(path, "mango_pad")) / 5.0) - 1.0
    at, tactors = _pad_places(path)
    assert shares.sum(axis=1) == pytest.approx(1.0, abs=1e-6)
    assert shares @ tactors == pytest.approx(at, abs=1e-5)


def test_the_pad_output_is_continuous() -> None:
    path = np.array([[-0.08, 0.09, 1.30], [0.08, 0.09, 1.22]])
    for radius in (0.0, 0.06):
        played = _strengths(_rendered(path, "mango_pad", radius))
        # 1.8 mm a sample; the law's steepest slope is 1 / ln 2 over a triangle's height, 55 mm.
        steepest = 5.0 / np.log(2.0) * 0.0018 / 0.055
        assert np.abs(np.diff(played, axis=0)).max() <= 1.01 * steepest
        assert played.max(axis=1).min() > 0.5


def test_a_wide_disc_drives_more_tactors() -> None:
    path = np.array([[0.0, 0.09, 1.26], [0.01, 0.09, 1.26]])
    few, many = (_strengths(_rendered(path, "mango_pad", r)) for r in (0.03, 0.12))
    assert (few > 0.5).sum(axis=1).max() <= 3
    assert (many > 0.5).sum(axis=1).min() >= 6


def test_round_the_waist_the_belt_keeps_its_power() -> None:
    """Constant power: the squared gains sum to 1 all the way round."""
    device = load_device("waist_belt")
    centres = np.array([actuator.place.centre_m for actuator in device.actuators])
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    middle, half = centres.mean(axis=0), 0.5 * np.ptp(centres, axis=0)
    ring = np.stack([half[0] * np.cos(angle), half[1] * np.sin(angle), 0 * angle], 1) + middle
    played = _strengths(_rendered(ring, "waist_belt"))
    assert np.linalg.norm(played, axis=1) == pytest.approx(5.0, rel=1e-6)
    assert ((played > 0.0).sum(axis=1) <= 2).all()
    assert len(np.unique(np.argmax(played, axis=1))) == len(centres)


def test_a_spot_far_from_the_device_is_not_played() -> None:
    raster = _rendered(np.array([[0.0, -0.1, 1.6], [0.02, -0.1, 1.6]]), "mango_pad")
    assert not _strengths(raster).any()
    assert [shortfall.reason for shortfall in raster.shortfalls] == ["place"]
