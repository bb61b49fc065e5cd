# SPDX-License-Identifier: GPL-3.0-or-later
"""Shipped devices sit where they say, on all perceptual models."""

import numpy as np
import pytest

from hfx_blender.devices.configuration import list_devices, load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_blender.engine.rendering.device import BodyPlace
from hfx_blender.engine.rendering.schemes import cells_of

MODELS = ("hfx-vibration-1", "hfx-pressure-1", "hfx-temperature-1")
EXPECTED = {  # part, sides, actuators
    "forearm_band_left": ("forearm", {LEFT}, 8),
    "forearm_band_right": ("forearm", {RIGHT}, 8),
    "back_pad": ("torso", None, 20),
    "pressure_vest": ("torso", None, 32),
    "insoles": ("foot_sole", {LEFT, RIGHT}, 8),
    "fan_heater": (None, None, 2),
}


def cells(name, model_id):
    device, model = load_device(name), load_model(model_id)
    return device, model, cells_of(device, device.actuators, model)


def test_nothing_ships_untested():
    assert set(list_devices()) == set(EXPECTED)


@pytest.mark.parametrize("model_id", MODELS)
@pytest.mark.parametrize("name", EXPECTED)
def test_actuators_lie_on_their_part(name, model_id):
    device, model, found = cells(name, model_id)
    part, sides, count = EXPECTED[name]
    assert len(device.actuators) == count and found.counts.min() >= 1
    if part is None:
        assert (found.counts == len(model)).all()
        return
    assert {PARTS[p] for p in model.part[found.reached]} == {part}
    if sides is not None:
        assert set(model.side[found.reached]) == sides
    for row in found.rows:
        assert (np.diff(row) > 0).all()


@pytest.mark.parametrize("name", sorted(set(EXPECTED) - {"fan_heater"}))
def test_actuators_are_centred_on_the_skin_and_tile_it(name):
    device, model, found = cells(name, "hfx-pressure-1")
    mirror = np.array([-1.0, 1.0, 1.0]) if device.is_mirrored else np.ones(3)
    for actuator, row in zip(device.actuators, found.rows, strict=True):
        assert isinstance(actuator.place, BodyPlace)
        centre = np.array(actuator.place.centre_m) * mirror
        # Centres are on the skin: within one vertex spacing (25 mm) of a vertex.
        assert np.linalg.norm(model.vertices[row] - centre, axis=1).min() < 0.0125
    overlaps = np.bincount(np.concatenate(found.rows), minlength=len(model))
    assert overlaps.max() <= 3
    assert len({row.tobytes() for row in found.rows}) == len(found.rows)


@pytest.mark.parametrize("name", ["back_pad", "pressure_vest"])
def test_a_torso_device_leaves_no_gap_between_its_actuators(name):
    device, model, found = cells(name, "hfx-pressure-1")
    for is_back in (True, False):
        centres = np.array(
            [a.place.centre_m for a in device.actuators if (a.place.centre_m[1] > 0) == is_back]
        )
        if not len(centres):
            continue
        low, high = centres.min(axis=0), centres.max(axis=0)
        x, y, z = model.vertices.T
        is_inside = (x > low[0]) & (x < high[0]) & (z > low[2]) & (z < high[2])
        is_inside &= (y > 0.0) == is_back
        is_inside &= model.part == PARTS.index("torso")
        is_reached = np.isin(np.flatnonzero(is_inside), found.reached)
        assert is_reached.mean() > 0.9


def test_left_and_right_bands_mirror_each_other():
    _, model, left = cells("forearm_band_left", "hfx-vibration-1")
    _, _, right = cells("forearm_band_right", "hfx-vibration-1")
    for a, b in zip(left.rows, right.rows, strict=True):
        flipped = model.vertices[a] * np.array([-1.0, 1.0, 1.0])
        gaps = np.linalg.norm(flipped[:, None] - model.vertices[b][None], axis=2).min(axis=1)
        assert gaps.max() < 1e-5


def test_the_band_goes_once_round_the_arm():
    device, model, found = cells("forearm_band_left", "hfx-pressure-1")
    centres = np.array([model.vertices[row].mean(axis=0) for row in found.rows])
    steps = np.linalg.norm(np.roll(centres, -1, axis=0) - centres, axis=1)
    assert 0.02 < steps.min() and steps.max() < 0.05  # 8 steps round about 25 cm
    assert np.linalg.norm(centres[0] - centres[4]) > 0.06
    assert np.argmax(centres[:, 0]) in (7, 0, 1)  # the first is on the outer side
    assert device.actuators[0].id == "m1"
