# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering schemes, mounts and pads in device configurations."""

from __future__ import annotations

import math

import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_tools.commands.device_faults import faults_of


def read(stored, content):
    return load_device(str(stored(content)))


@pytest.mark.parametrize(
    ("rendering", "attribute", "value"),
    [
        ({"scheme": "barycentric"}, "law", "log"),  # Schneider et al. 2015: the pad's default
        ({"scheme": "barycentric", "options": {"law": "power"}}, "law", "power"),
        ({"scheme": "surface", "options": {"law": "linear"}}, "law", "linear"),
        ({"scheme": "splat", "options": {"sigma_m": 0.03}}, "sigma_m", 0.03),
        ({"scheme": "brush", "options": {"duration_ms": 100}}, "duration_ms", 100.0),
        ({"scheme": "saltation", "options": {"tap_ms": 5}}, "tap_ms", 5.0),
        ({"scheme": "ring"}, "name", "ring"),
    ],
)
def test_schemes_and_their_options_are_read(full, stored, rendering, attribute, value):
    full["rendering"] = rendering
    assert getattr(read(stored, full).scheme, attribute) == value


@pytest.mark.parametrize(
    ("rendering", "message"),
    [
        ({"scheme": "magic"}, "rendering.scheme"),
        ({"scheme": "ring", "options": {"law": "log"}}, "law"),
        ({"scheme": "barycentric", "options": {"law": "square"}}, "rendering.options.law"),
        ({"scheme": "splat", "options": {"sigma_m": 0}}, "rendering.options.sigma_m"),
        ({"scheme": "coverage", "options": {"statistic": "mode"}}, "statistic"),
    ],
)
def test_faults_of_a_scheme_name_their_place(full, stored, rendering, message):
    full["rendering"] = rendering
    with pytest.raises(InputError, match=message):
        read(stored, full)


def pad(full):
    """Return the full example with the first actuator on a pad in front of the chest."""
    full["mount"] = {"origin_m": [0.0, -0.1, 1.2], "x_axis": [1, 0, 0], "y_axis": [0, 0, 1]}
    full["actuators"][0]["place"] = {
        "pad": {"parts": ["torso"], "at_mm": [63.5, -20], "radius_m": 0.02}
    }
    return full


def test_a_place_on_the_pad_is_put_on_the_body_by_the_mount(full, stored):
    device = read(stored, pad(full))
    assert device.actuators[0].place.centre_m == pytest.approx((0.0635, -0.1, 1.18))


def test_axes_of_a_mount_become_orthogonal_and_of_unit_length(full, stored):
    pad(full)["mount"].update(x_axis=[0.5, 0, 0], y_axis=[0.3, 0, 0.3])
    mount = read(stored, full).mount
    assert mount.x_axis == pytest.approx((1, 0, 0))
    assert mount.y_axis == pytest.approx((0, 0, 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x_axis": [0, 0, 0]}, "mount.x_axis"),
        ({"y_axis": [1, 0, 0]}, "mount.y_axis"),
        ({"origin_m": [0, 0]}, "mount.origin_m"),
        ({"z_axis": [0, 1, 0]}, "z_axis"),
    ],
)
def test_faults_of_a_mount_name_their_place(full, stored, change, message):
    pad(full)["mount"].update(change)
    with pytest.raises(InputError, match=message):
        read(stored, full)


def test_a_pad_without_a_mount_is_refused(full, stored):
    del pad(full)["mount"]
    assert any("mount" in fault for fault in faults_of(stored(full)))


def bent(full, radius_mm):
    pad(full)["mount"]["bend_radius_mm"] = radius_mm
    return full


def test_a_pad_bent_round_the_body_stands_where_its_arc_ends(full, stored):
    # A quarter of 4 x 63.5 mm is 90 degrees: level with the cylinder's axis, a radius behind the
    # pad.
    radius_mm = 4 * 63.5 / math.tau
    at = read(stored, bent(full, radius_mm)).actuators[0].place.centre_m
    assert at == pytest.approx((radius_mm / 1000, -0.1 + radius_mm / 1000, 1.18))


def test_a_pad_bent_to_a_hollow_comes_to_the_other_side(full, stored):
    radius_mm = 4 * 63.5 / math.tau
    at = read(stored, bent(full, -radius_mm)).actuators[0].place.centre_m
    assert at == pytest.approx((radius_mm / 1000, -0.1 - radius_mm / 1000, 1.18))


@pytest.mark.parametrize("radius_mm", [0, 2.9, -2.9, 10_001, -10_001, None, True, "150"])
def test_a_bend_that_is_none_is_refused(full, stored, radius_mm):
    with pytest.raises(InputError, match=r"mount.bend_radius_mm is .*, allowed is a number from"):
        read(stored, bent(full, radius_mm))


@pytest.mark.parametrize("sign", [1, -1])
def test_pads_that_go_round_more_than_once_are_refused(full, stored, sign):
    bent(full, sign * 20)["actuators"][1]["place"] = {
        "pad": {"parts": ["torso"], "at_mm": [-36.5, 0], "radius_m": 0.02}
    }
    # 63.5 + 36.5 mm are 100 mm, of 40 pi = 125.7 mm.
    assert read(stored, full).mount.bend_radius_m == pytest.approx(sign * 0.02)
    full["actuators"][1]["place"]["pad"]["at_mm"][0] = -62.3
    with pytest.raises(InputError) as refused:
        read(stored, full)
    # 125.8 / 2 pi is 20.0217.
    assert str(refused.value).endswith(
        f"mount.bend_radius_mm is {sign * 20}, allowed is at least 20.03 mm: pads are 125.8 mm "
        "apart along x, and the circumference is 125.7 mm."
    )
