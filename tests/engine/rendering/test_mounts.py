# SPDX-License-Identifier: GPL-3.0-or-later
"""Layouts on flat and bent mounts: positions in space, and unrolled."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS, SIDES
from hfx_blender.engine.rendering.device_config import BodyPlace, DeviceConfig, Mount, Scheme
from hfx_blender.engine.rendering.mounts import Pad, on_mount, place_on
from hfx_blender.engine.rendering.panning.positional import PlanarPanning
from hfx_blender.engine.rendering.schemes import cells_of, panned_layout

CHEST = Mount((0.0, -0.1, 1.2), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))  # seen from the front

radii = st.floats(0.003, 10.0).flatmap(lambda r: st.sampled_from([r, -r]))
turns = st.floats(-0.499, 0.499)


def bent(radius_m: float, mount: Mount = CHEST) -> Mount:
    return replace(mount, bend_radius_m=radius_m)


@st.composite
def mounts(draw: st.DrawFn) -> Mount:
    seed = draw(st.integers(0, 10_000))
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    origin = draw(st.tuples(*[st.floats(-2, 2)] * 3))
    return Mount(origin, tuple(axes[0]), tuple(axes[1]), draw(radii))


@pytest.mark.parametrize(
    ("quarters", "at"),
    [
        # The axis is 0.1 m behind the plane of the chest, at y = 0; up stays up.
        (0, (0.0, -0.1, 1.25)),
        (1, (0.1, 0.0, 1.25)),
        (-1, (-0.1, 0.0, 1.25)),
        (2, (0.0, 0.1, 1.25)),
    ],
)
def test_a_quarter_of_the_circumference_is_90_degrees_round(quarters, at):
    layout = np.array([[quarters * 0.1 * pi / 2, 0.05]])
    assert place_on(bent(0.1), layout)[0] == pytest.approx(at, abs=1e-12)


def test_a_hollow_bends_away_from_the_body():
    layout = np.array([[0.1 * pi / 2, 0.0]])
    assert place_on(bent(-0.1), layout)[0] == pytest.approx((0.1, -0.2, 1.2))


@given(mounts(), st.lists(st.tuples(turns, st.floats(-2, 2)), min_size=1, max_size=5))
def test_rolling_and_unrolling_are_inverse(mount, places):
    layout = np.array(places) * [2 * pi * mount.bend_radius_m, 1.0]
    actual = on_mount(mount, place_on(mount, layout))
    assert actual == pytest.approx(layout, abs=1e-9)


@given(mounts(), turns, st.floats(-1, 1), turns, st.floats(-1, 1))
@settings(max_examples=50)
def test_distances_along_the_curve_are_those_of_the_layout(mount, turn, y, other_turn, other_y):
    round_m = 2 * pi * mount.bend_radius_m
    ends = np.array([[turn * round_m, y], [other_turn * round_m, other_y]])
    way = place_on(mount, ends[0] + np.linspace(0, 1, 5001)[:, None] * (ends[1] - ends[0]))
    length_m = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert length_m == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=1e-6, abs=1e-9)


@given(mounts(), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_the_larger_the_radius_the_flatter_the_layout(mount, x, y):
    layout = np.array([[x, y]])
    flat = place_on(replace(mount, bend_radius_m=None), layout)
    for radius_m in (1.0, 1e3, 1e6):
        # The versed sine, x^2 / 2r, and the sine's lag, x^3 / 6r^2, and the rounding of places.
        within = x * x / (2 * radius_m) + abs(x) ** 3 / (6 * radius_m**2) + 1e-14
        rolled = place_on(bent(radius_m, mount), layout)
        assert np.linalg.norm(rolled - flat) <= within
        assert on_mount(bent(radius_m, mount), rolled) == pytest.approx(layout, abs=1e-8)


@given(mounts(), st.floats(-0.45, 0.45), st.floats(0.1, 3.0))
def test_skin_off_the_cylinder_counts_by_its_direction_from_the_axis(mount, turn, share):
    layout = np.array([[turn * 2 * pi * mount.bend_radius_m, 0.3]])
    axis = np.array(mount.origin_m) - mount.bend_radius_m * np.cross(mount.x_axis, mount.y_axis)
    axis = axis + 0.3 * np.array(mount.y_axis)
    point = axis + share * (place_on(mount, layout) - axis)
    assert on_mount(mount, point) == pytest.approx(layout, abs=1e-8)


def test_a_layout_is_cut_open_in_its_widest_gap():
    # 0 to 270 degrees: cut at 315, not at 180, so the order along x stays the layout's.
    mount = bent(0.1)
    layout = np.array([[0.1 * pi * k / 4, 0.0] for k in range(7)])
    pad = Pad(mount, place_on(mount, layout), 0.01)
    assert pad.at(place_on(mount, layout)) == pytest.approx(layout)
    assert pad.closed_m is None
    beyond = place_on(mount, np.array([[0.1 * pi * 1.8, 0.0]]))  # 324 degrees: before the start
    assert pad.at(beyond)[0] == pytest.approx((-0.1 * pi * 0.2, 0.0))


def test_a_layout_that_goes_round_is_closed_and_one_on_a_side_is_open():
    mount = bent(0.05)
    # Eight actuators around, 39 mm apart; and a layout of five of these, with the ends 180 degrees
    # apart.
    layout = np.array([[0.05 * pi * k / 4, 0.0] for k in range(8)])
    centres = place_on(mount, layout)
    spacing_m = float(np.linalg.norm(centres[1] - centres[0]))
    assert Pad(mount, centres, spacing_m).closed_m == pytest.approx(0.1 * pi)
    half = Pad(bent(0.3), place_on(bent(0.3), layout[:5]), spacing_m)
    assert half.closed_m is None
    assert Pad(CHEST, centres, spacing_m).closed_m is None


CLOSED_M = 0.3


@given(st.integers(1, 6), st.integers(1, 4), st.floats(-0.2, 0.2), st.booleans())
@settings(max_examples=60)
def test_a_closed_layout_plays_equally_at_both_ends(columns, rows, y, is_square):
    """Squares of a grid have two diagonals: both ends must have the same triangulation."""
    height = CLOSED_M / columns if is_square else 0.04
    x = (np.arange(columns) + 0.5) * CLOSED_M / columns
    layout = np.array([[item, height * row] for row in range(rows) for item in x])
    panning = PlanarPanning(layout, "linear", CLOSED_M)
    ends = panning.gains(np.array([[0.0, y], [CLOSED_M, y]]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-4)
    assert ends.sum(axis=1) == pytest.approx(1.0)


def test_half_way_over_the_seam_both_ends_play_the_same():
    layout = np.array([[0.05, 0.0], [0.15, 0.0], [0.25, 0.0]])  # 0.1 m apart, also over the seam
    shares = PlanarPanning(layout, "linear", CLOSED_M).gains(
        np.array([[0.0, 0.0], [0.3, 0.0], [0.275, 0.0], [0.1, 0.0], [0.15, 0.0]])
    )
    half = [0.5, 0.0, 0.5]
    assert shares[0] == pytest.approx(half) and shares[1] == pytest.approx(half)
    assert shares[2] == pytest.approx([0.25, 0.0, 0.75])
    assert shares[3] == pytest.approx([0.5, 0.5, 0.0])
    assert shares[4] == pytest.approx([0.0, 1.0, 0.0])


def test_coincident_actuators_of_a_closed_layout_share_gains():
    layout = np.array([[0.05, 0.0], [0.05, 0.0], [0.2, 0.0]])
    panning = PlanarPanning(layout, "linear", CLOSED_M)
    assert panning.gains(layout[:1])[0] == pytest.approx([0.5, 0.5, 0.0])


def test_a_closed_layout_of_one_actuator_plays_everywhere():
    panning = PlanarPanning(np.array([[0.1, 0.0]]), "log", CLOSED_M)
    assert panning.gains(np.array([[0.0, 0.1], [0.25, -1.0]])) == pytest.approx(1.0)


SLEEVE_RADIUS_M = 0.04


def sleeve(scheme: str, rows: int = 2) -> DeviceConfig:
    """Return rows of six actuators around the left forearm, along the arm's axis."""
    model = load_model("hfx-pressure-1")
    own = (model.part == PARTS.index("forearm")) & (model.side == SIDES.index("left"))
    skin = model.vertices[own].astype(np.float64)
    middle = skin.mean(axis=0)
    along = np.linalg.svd(skin - middle, full_matrices=False)[2][0]
    out = np.cross(along, [0.0, 1.0, 0.0])
    out /= np.linalg.norm(out)
    origin = middle + SLEEVE_RADIUS_M * out
    x = np.cross(along, out)
    mount = Mount(tuple(origin), tuple(x), tuple(along), SLEEVE_RADIUS_M)
    step = 2 * pi * SLEEVE_RADIUS_M / 6
    layout = np.array([[step * k, step * row] for row in range(rows) for k in range(6)])
    first = load_device("mango_pad").actuators[0]
    actuators = tuple(
        replace(first, id=str(k), place=BodyPlace(("forearm",), tuple(item), 0.02, "left"))
        for k, item in enumerate(place_on(mount, layout))
    )
    return replace(
        load_device("mango_pad"), actuators=actuators, mount=mount, scheme=Scheme(scheme)
    )


@pytest.mark.parametrize(
    "scheme", ["coverage", "nearest", "barycentric", "surface", "ring", "line", "vbap", "splat"]
)
def test_every_scheme_plays_every_actuator_of_a_sleeve(scheme):
    device = sleeve(scheme, 1 if scheme in ("ring", "line") else 2)
    model = load_model("hfx-pressure-1")
    cells = cells_of(device, device.actuators, model)
    vertices = cells.reached.astype(np.int32)
    gains = cells.gains(
        np.arange(len(vertices) + 1), vertices, np.ones(len(vertices), np.float32), "strongest"
    )
    assert np.isfinite(gains).all() and gains.min() >= 0.0 and gains.max() <= 1.0 + 1e-6
    assert (gains.max(axis=0) > 0.2).all(), gains.max(axis=0)
    assert {PARTS[p] for p in model.part[vertices]} == {"forearm"}


@pytest.mark.parametrize("scheme", ["barycentric", "ring", "line", "vbap"])
@pytest.mark.parametrize("rows", [1, 2])
def test_round_a_sleeve_nothing_jumps_and_each_neighbour_follows(scheme, rows):
    device = sleeve(scheme, rows)
    panned = panned_layout(device, device.actuators, load_model("hfx-pressure-1"))
    count = 3601
    angle = np.linspace(0.0, 2 * pi, count)
    way = place_on(device.mount, np.column_stack((SLEEVE_RADIUS_M * angle, np.zeros(count))))
    gains = panned.at(way)
    assert gains[0] == pytest.approx(gains[-1], abs=1e-6)
    # A square root rises over the first of 600 steps to sqrt(1 / 600) = 0.041.
    assert np.abs(np.diff(gains, axis=0)).max() < 0.05
    if scheme == "barycentric":
        at = gains[::600][:6]
        assert at[:, :6] == pytest.approx(np.eye(6), abs=1e-6)


def test_along_a_row_bent_and_flat_pads_agree():
    """Shares follow distances in millimetres along the pad, for any bend."""
    layout = np.array([[0.0, 0.0], [0.03, 0.0], [0.06, 0.0], [0.015, 0.03], [0.045, 0.03]])
    places = np.column_stack((np.linspace(0.0, 0.06, 50), np.linspace(0.0, 0.03, 50)))
    flat = PlanarPanning(layout, "log").gains(places)
    mount = bent(0.05)
    pad = Pad(mount, place_on(mount, layout), 0.03)
    panning = PlanarPanning(pad.at(place_on(mount, layout)), "log", pad.closed_m)
    assert pad.closed_m is None
    assert panning.gains(pad.at(place_on(mount, places))) == pytest.approx(flat, abs=1e-9)
