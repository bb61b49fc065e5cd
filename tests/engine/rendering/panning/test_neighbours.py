# SPDX-License-Identifier: GPL-3.0-or-later
"""Phantom sensations never join two limbs, or span more than 200 mm of skin, in any scheme."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.device_config import DeviceConfig, Scheme
from hfx_blender.engine.rendering.panning.constant_power import RingPanning
from hfx_blender.engine.rendering.panning.surface_panning import (
    MAX_SPAN_M,
    SkinNeighbours,
    limbs_of,
    parted,
)
from hfx_blender.engine.rendering.schemes import panned_layout

MODEL = load_model("hfx-vibration-1")
BELT = load_device("waist_belt")
SCHEMES = ("barycentric", "ring", "line", "vbap", "splat")


def centres_of(device: DeviceConfig) -> np.ndarray:
    return np.array([a.place.centre_m for a in device.actuators])


def anchors_of(device: DeviceConfig) -> np.ndarray:
    distances = np.linalg.norm(MODEL.vertices[None] - centres_of(device)[:, None], axis=2)
    return np.argmin(distances, axis=1)


def joined_on_skin(model, centres: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    first, second = np.triu_indices(len(centres), 1)
    eye = np.eye(len(centres), dtype=np.bool_)
    eye[first, second] = eye[second, first] = SkinNeighbours(model, centres, anchors).are_joined(
        first, second
    )
    return eye


def with_scheme(device: DeviceConfig, scheme: str, *, only: list[int] | None = None):
    actuators = device.actuators if only is None else tuple(device.actuators[k] for k in only)
    return replace(device, scheme=Scheme(scheme), actuators=actuators)  # type: ignore[arg-type]


def layout_of(device: DeviceConfig):
    layout = panned_layout(device, device.actuators, MODEL)
    assert layout is not None
    return layout


def test_the_belt_of_eight_is_joined_all_round_and_not_across():
    actual = joined_on_skin(MODEL, centres_of(BELT), anchors_of(BELT))
    for k in range(8):
        assert actual[k, (k + 1) % 8]
        assert not actual[k, (k + 4) % 8]


def test_straight_through_the_body_is_not_along_the_skin():
    """Navel and spine are 197 mm apart in space, and half a waist along the skin."""
    places = centres_of(BELT)[[0, 4]]
    assert np.linalg.norm(places[0] - places[1]) < MAX_SPAN_M
    assert not joined_on_skin(MODEL, places, anchors_of(BELT)[[0, 4]])[0, 1]


def test_two_thighs_that_nearly_touch_are_not_one_limb():
    thigh = MODEL.part == PARTS.index("upper_leg")
    left, right = (np.flatnonzero(thigh & (MODEL.side == side)) for side in (1, 2))
    away = np.linalg.norm(MODEL.vertices[left][:, None] - MODEL.vertices[right][None], axis=2)
    first, second = np.unravel_index(away.argmin(), away.shape)
    anchors = np.array([left[first], right[second]])
    places = MODEL.vertices[anchors].astype(np.float64)
    assert np.linalg.norm(places[0] - places[1]) < 0.05
    assert not joined_on_skin(MODEL, places, anchors)[0, 1]
    same = np.array([left[first], left[first]])
    assert joined_on_skin(MODEL, MODEL.vertices[same].astype(np.float64), same)[0, 1]


def test_a_belt_of_two_is_silent_half_way_and_does_not_jump():
    layout = layout_of(with_scheme(BELT, "ring", only=[0, 4]))
    middle = centres_of(BELT).mean(axis=0)
    angles = np.linspace(0.0, 2.0 * np.pi, 2001)
    ring = middle + np.column_stack((np.sin(angles), -np.cos(angles), 0.0 * angles)) * 0.14
    gains = layout.at(ring)
    assert not (gains > 0.0).all(axis=1).any()
    assert gains[0] == pytest.approx([1.0, 0.0], abs=1e-6)
    assert gains[1000] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert gains.max(axis=1)[[500, 1500]] == pytest.approx([0.0, 0.0], abs=0.02)
    assert np.abs(np.diff(gains, axis=0)).max() < 0.02


@pytest.mark.parametrize("scheme", SCHEMES)
def test_nothing_is_played_on_both_feet_at_once(scheme):
    device = with_scheme(load_device("insoles"), scheme)
    limb = limbs_of(MODEL)[anchors_of(device)]
    assert len(set(limb.tolist())) == 2
    layout = layout_of(device)
    between = np.linspace(centres_of(device)[0], centres_of(device)[4], 101)
    for gains in (layout.gains, layout.at(between)):
        on_feet = np.stack([(gains[:, limb == foot] > 0.0).any(axis=1) for foot in set(limb)])
        assert on_feet.any(axis=1).all()
        assert not on_feet.all(axis=0).any()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", ["back_pad", "waist_belt", "forearm_band_left"])
def test_actuators_playing_together_are_near_along_the_skin(name, scheme):
    device = with_scheme(load_device(name), scheme)
    is_joined = joined_on_skin(MODEL, centres_of(device), anchors_of(device))
    playing = layout_of(device).gains > 0.0
    together = playing.astype(np.float64).T @ playing
    assert not (together[~is_joined] > 0.0).any()


def test_a_ring_without_wide_gaps_keeps_its_power():
    layout = layout_of(with_scheme(BELT, "ring"))
    under = layout.fade == 1.0
    assert under.any()
    assert np.sum(layout.gains[under] ** 2, axis=1) == pytest.approx(1.0)


def test_a_gap_fades_from_a_quarter_to_the_middle():
    """Power shares are linear: 1 - x and x; half of the power is left at a ratio of 2 : 1."""
    ring = RingPanning(np.radians([0.0, 180.0]))
    is_joined = np.eye(2, dtype=np.bool_)
    degrees = np.array([0.0, 30.0, 45.0, 67.5, 90.0, 135.0, 180.0])[:, None]
    actual = parted(ring.gains(np.radians(degrees)), lambda a, b: is_joined[a, b])
    # Shares: 1, 5/6, 3/4, 5/8, 1/2; twice their lead: 2, 4/3, 1, 1/2, 0.
    expected = [1.0, np.sqrt(5 / 6), np.sqrt(3 / 4), 0.5 * np.sqrt(5 / 8), 0.0, 0.0, 0.0]
    assert actual[:, 0] == pytest.approx(expected, abs=1e-7)
    assert actual[5:, 1] == pytest.approx([np.sqrt(3 / 4), 1.0], abs=1e-7)


gain_rows = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4)


@given(gain_rows, gain_rows, st.integers(0, 63))
@settings(deadline=None)
def test_no_two_that_are_apart_play_together_and_nothing_jumps(one, second, pairs):
    is_joined = np.eye(4, dtype=np.bool_)
    for k, (a, b) in enumerate([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]):
        is_joined[a, b] = is_joined[b, a] = bool(pairs >> k & 1)
    way = np.linspace(0.0, 1.0, 4001)[:, None]
    gains = np.array(one) * (1.0 - way) + np.array(second) * way
    actual = parted(gains, lambda a, b: is_joined[a, b])
    assert (actual <= gains).all() and (actual >= 0.0).all()
    for a, b in zip(*np.nonzero(~is_joined), strict=True):
        assert not ((actual[:, a] > 0.0) & (actual[:, b] > 0.0)).any()
    assert np.abs(np.diff(actual, axis=0)).max() < 0.02
    if is_joined.all():
        assert (actual == gains).all()
