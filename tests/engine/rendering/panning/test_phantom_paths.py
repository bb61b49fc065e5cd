# SPDX-License-Identifier: GPL-3.0-or-later
"""Phantom sensations along random paths, in the 100 Hz raster of a device, to 16 bits.

Expected gains are computed independently: barycentric coordinates by Delaunay and a linear
solution, arcs by angles.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.encoders import Channels
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.mounts import on_mount
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    BodyDescription,
    EffectDescription,
    SceneDescription,
    SkinBinding,
    SpotArea,
    TimeBase,
)
from hfx_blender.engine.track.header import TrackHeader

COUNT = 501
STRENGTH = 5.0
MODEL = "hfx-vibration-1"

PAD = load_device("mango_pad")
BELT = load_device("waist_belt")

seeds = st.integers(0, 2**32 - 1)


def with_law(law: str) -> DeviceConfig:
    return replace(PAD, scheme=replace(PAD.scheme, law=law))


def raster_of(device: DeviceConfig, path: np.ndarray) -> np.ndarray:
    """Return gains (COUNT, A) of a spot moving along a path at constant speed."""
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, COUNT - 1)
    effect = EffectDescription("spot", "Spot", "vibration", MODEL, SpotArea("body", path))
    scene = SceneDescription(time, (BodyDescription("body", "B", SkinBinding(())),), (effect,))
    header = TrackHeader.of(scene, {MODEL: load_model(MODEL)}, settings={}, tools={})
    renderer = Renderer(header, device, load_model, compensates_latency=False)
    focus = np.insert(along(path), 3, 0.0, axis=1).astype(np.float32)
    run = SampleRun(
        header.streams[0],
        indices=np.arange(COUNT),
        times_s=time.times_s(np.arange(COUNT)),
        levels=np.ones(COUNT),
        parameters=np.tile([STRENGTH, 200.0], (COUNT, 1)),
        offsets=np.arange(COUNT + 1),
        vertices=np.zeros(COUNT, np.int32),
        weights=np.ones(COUNT, np.float32),
        focus=focus,
    )
    renderer.add([run])
    values = renderer.raster().values
    channels = Channels(device, strengths_only=True)
    highest = np.array([a.type.strength.maximum for a in device.actuators])
    whole = np.array([channels.whole(channels.values(row), 0xFFFF) for row in values])
    return whole / 0xFFFF * highest / STRENGTH


def along(path: np.ndarray) -> np.ndarray:
    """Return points (COUNT, D) at equal distances along a polyline."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    positions = np.linspace(0.0, at[-1], COUNT)
    return np.stack([np.interp(positions, at, column) for column in path.T], axis=1)


def tactors() -> np.ndarray:
    return on_mount(PAD.mount, np.array([actuator.place.centre_m for actuator in PAD.actuators]))


def pad_path(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a random path inside the pad's hull, in space and in pad coordinates."""
    rng = np.random.default_rng(seed)
    corners = rng.dirichlet(np.full(len(PAD.actuators), 0.3), 4) @ tactors()
    axes = np.array([PAD.mount.x_axis, PAD.mount.y_axis])
    return np.array(PAD.mount.origin_m) + corners @ axes, along(corners)


def barycentric(places: np.ndarray) -> np.ndarray:
    """Return shares (n, A) of the tactors in the Delaunay triangles."""
    actual = tactors()
    mesh = Delaunay(actual)
    shares = np.zeros((len(places), len(actual)))
    inside = mesh.find_simplex(places, tol=1e-9)
    assert (inside >= 0).all()
    for k, simplex in enumerate(mesh.simplices[inside]):
        system = np.vstack([actual[simplex].T, np.ones(3)])
        shares[k, simplex] = np.linalg.solve(system, [*places[k], 1.0])
    return shares.clip(0.0)


@given(seeds)
@settings(deadline=None, max_examples=2)
def test_the_centre_of_linear_gains_follows_the_object_within_a_millimetre(seed: int) -> None:
    path, places = pad_path(seed)
    gains = raster_of(with_law("linear"), path)
    centres = gains @ tactors() / gains.sum(axis=1, keepdims=True)
    assert np.linalg.norm(centres - places, axis=1).max() < 0.001
    assert gains.sum(axis=1) == pytest.approx(1.0, abs=1e-3)


@given(seeds)
@settings(deadline=None, max_examples=2)
def test_log_gains_are_mangos(seed: int) -> None:
    path, places = pad_path(seed)
    assert PAD.scheme.law == "log", "the pad's default"
    expected = np.log2(1.0 + barycentric(places))
    assert np.abs(raster_of(PAD, path) - expected).max() < 5e-4


def decibels(gains: np.ndarray) -> float:
    """Return the deviation of the total power from 1, dB."""
    return float(np.abs(10.0 * np.log10((gains**2).sum(axis=1))).max())


@given(seeds)
@settings(deadline=None, max_examples=2)
def test_the_power_law_keeps_the_power_within_a_tenth_of_a_decibel(seed: int) -> None:
    assert decibels(raster_of(with_law("power"), pad_path(seed)[0])) < 0.1


@given(seeds)
@settings(deadline=None, max_examples=2)
def test_the_belt_keeps_the_power_within_a_tenth_of_a_decibel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = np.array([actuator.place.centre_m for actuator in BELT.actuators])
    middle, half = centres.mean(axis=0), 0.5 * np.ptp(centres, axis=0)
    angles = np.linspace(*rng.uniform(-np.pi, np.pi, 2), 40)
    ring = np.stack([half[0] * np.cos(angles), half[1] * np.sin(angles), 0.0 * angles], axis=1)
    gains = raster_of(BELT, ring + middle)
    assert decibels(gains) < 0.1
    assert ((gains > 0.0).sum(axis=1) <= 2).all(), "two neighbours at most"
