# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering schemes of whole devices on the shipped body: playing actuators, and transitions."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.device_config import DeviceConfig, Scheme
from hfx_blender.engine.rendering.schemes import cells_of
from hfx_blender.errors import InputError

PANNING = ("nearest", "barycentric", "surface", "ring", "line", "vbap", "splat")
MODEL = "hfx-pressure-1"


def with_scheme(name: str, scheme: str, **options: object) -> DeviceConfig:
    return replace(load_device(name), scheme=Scheme(scheme, **options))  # type: ignore[arg-type]


def gains_of_single_vertices(device: DeviceConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, gains (n, A)) for single touched vertices with any gain."""
    model = load_model(MODEL)
    cells = cells_of(device, device.actuators, model)
    vertices = cells.reached
    gains = cells.gains(
        np.arange(len(vertices) + 1),
        vertices.astype(np.int32),
        np.ones(len(vertices), np.float32),
        "strongest",
    )
    return vertices, gains


@pytest.mark.parametrize("scheme", PANNING)
@pytest.mark.parametrize("name", ["back_pad", "forearm_band_left", "insoles"])
def test_every_scheme_plays_every_device_on_its_own_skin(name, scheme):
    device = with_scheme(name, scheme)
    vertices, gains = gains_of_single_vertices(device)
    model = load_model(MODEL)
    parts = {part for a in device.actuators for part in a.place.parts}
    assert {PARTS[p] for p in model.part[vertices]} <= parts
    assert np.isfinite(gains).all() and gains.min() >= 0.0 and gains.max() <= 1.0 + 1e-6
    # A pad is not a strip: the rows are farther apart than actuators sharing a point may be.
    is_strip = (name, scheme) != ("back_pad", "line")
    assert (gains.max(axis=0) > 0.0).all() or not is_strip, "an actuator is never played"


@pytest.mark.parametrize("scheme", ["barycentric", "surface", "ring"])
def test_a_panning_band_has_constant_power_below(scheme):
    device = with_scheme("forearm_band_left", scheme, law="power")
    vertices, gains = gains_of_single_vertices(device)
    model = load_model(MODEL)
    centres = np.array([a.place.centre_m for a in device.actuators])
    distance = np.linalg.norm(model.vertices[vertices][:, None] - centres[None], axis=2).min(axis=1)
    under = distance < 0.01
    assert np.count_nonzero(under) >= 3
    power = np.sum(gains[under] ** 2, axis=1)
    assert np.abs(10 * np.log10(power)).max() < 0.1


def test_a_belt_plays_only_neighbours_round_its_ring():
    _, gains = gains_of_single_vertices(with_scheme("forearm_band_left", "ring"))
    for row in gains:
        playing = np.flatnonzero(row > 1e-6)
        assert len(playing) <= 2
        if len(playing) == 2:
            assert (playing[1] - playing[0]) in (1, 7)


def test_a_mirrored_device_pans_as_the_mirror_image():
    model = load_model(MODEL)
    left, right = (
        cells_of(d, d.actuators, model)
        for d in (with_scheme(f"forearm_band_{s}", "barycentric") for s in ("left", "right"))
    )
    for a, b in zip(left.rows, right.rows, strict=True):
        assert np.array_equal(np.sort(model.mirror[a]), b)
    first = gains_of_single_vertices(with_scheme("forearm_band_left", "barycentric"))
    second = gains_of_single_vertices(with_scheme("forearm_band_right", "barycentric"))
    order = np.searchsorted(second[0], model.mirror[first[0]])
    assert second[1][order] == pytest.approx(first[1])


def test_the_law_shapes_the_middle_between_actuators():
    linear = gains_of_single_vertices(with_scheme("back_pad", "barycentric", law="linear"))
    power = gains_of_single_vertices(with_scheme("back_pad", "barycentric", law="power"))
    assert np.array_equal(linear[0], power[0])
    full = linear[1].sum(axis=1) > 0.999
    assert power[1][full] == pytest.approx(np.sqrt(linear[1][full]), abs=1e-6)


def test_touching_the_whole_back_plays_all_of_a_panning_pad():
    device = with_scheme("back_pad", "barycentric", law="linear")
    model = load_model(MODEL)
    cells = cells_of(device, device.actuators, model)
    torso = np.flatnonzero(model.part == PARTS.index("torso")).astype(np.int32)
    weights = np.ones(len(torso), np.float32)
    gains = cells.gains(np.array([0, len(torso)]), torso, weights, "strongest")
    assert gains.min() > 0.7


def test_devices_in_the_room_are_not_panned():
    device = with_scheme("fan_heater", "barycentric")
    cells = cells_of(device, device.actuators, load_model(MODEL))
    assert (cells.counts == len(load_model(MODEL))).all()


def test_a_scheme_names_missing_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    model, pad = load_model(MODEL), with_scheme("back_pad", "barycentric")
    monkeypatch.setitem(sys.modules, "scipy.spatial", None)
    with pytest.raises(InputError, match="'barycentric' needs the Python package scipy"):
        cells_of(pad, pad.actuators, model)
    belt = load_device("waist_belt")
    assert cells_of(belt, belt.actuators, model).counts.all(), "a ring needs none"
