# SPDX-License-Identifier: GPL-3.0-or-later
"""Illusions of movement: onsets and durations of bursts, worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from rendering_synthetic import MODELS, make_device, make_header, make_run

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.device_config import Scheme, VertexPlace, VertexSet
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.rendering.panning.bursts import Bursts, brush_interval_ms
from hfx_blender.engine.rendering.renderer import Renderer


@pytest.mark.parametrize(
    ("duration_ms", "interval_ms"), [(40.0, 60.1), (100.0, 79.3), (160.0, 98.5), (250.0, 127.3)]
)
def test_the_law_of_the_tactile_brush(duration_ms: float, interval_ms: float) -> None:
    """Israr and Poupyrev 2011: SOA = 0.32 duration + 47.3 ms."""
    assert brush_interval_ms(duration_ms) == pytest.approx(interval_ms)


def _crossing(cut: int | None = None) -> np.ndarray:
    """Play a place that crosses from actuator 0 to 1 in 300 ms, by bursts of 150 ms every 100 ms,
    at 100 samples a second, in one block or two."""
    bursts = Bursts(0.1, 0.15)
    times = np.arange(30) / 100.0
    share = times / 0.3
    gains = np.stack([1.0 - share, share], axis=1)
    blocks = [slice(0, 30)] if cut is None else [slice(0, cut), slice(cut, 30)]
    return np.concatenate([bursts.gains(times[b], gains[b]) for b in blocks])


@pytest.mark.parametrize("cut", [None, 1, 7, 10, 15, 25])
def test_bursts_keep_the_place_of_their_onset(cut: int | None) -> None:
    """Onsets at 0, 100, 200 ms with places 0, 1/3, 2/3; each 150 ms; the strongest counts."""
    played = _crossing(cut)
    third = 1.0 / 3.0
    expected = np.repeat(
        [[1, 0], [1, third], [1 - third, third], [1 - third, 2 * third], [third, 2 * third]],
        [10, 5, 5, 5, 5],
        axis=0,
    )
    np.testing.assert_allclose(played, expected, atol=1e-12)


def test_a_tap_shorter_than_a_sample_takes_one_sample() -> None:
    played = Bursts(0.05, 0.002).gains(np.arange(12) / 100.0, np.ones((12, 1)))
    assert np.flatnonzero(played[:, 0]).tolist() == [0, 5, 10]


def test_a_paused_place_is_played_and_followed() -> None:
    bursts = Bursts(0.1, 0.02)
    bursts.gains(np.array([1.0]), np.array([[1.0, 0.0]]))
    assert not bursts.gains(np.array([1.05]), np.array([[1.0, 0.0]])).any()
    assert bursts.gains(np.array([1.05]), np.array([[0.0, 1.0]])).tolist() == [[0.0, 1.0]]


def test_a_jump_back_discards_later_bursts() -> None:
    bursts = Bursts(0.1, 0.15)
    bursts.gains(np.array([2.0]), np.array([[1.0, 0.0]]))
    assert bursts.gains(np.array([1.98]), np.array([[0.0, 1.0]])).tolist() == [[0.0, 1.0]]


PLACE = VertexPlace((VertexSet("dots-vibration", MODELS["dots-vibration"].content_hash, (4,)),))


def _tapping(rate: int) -> tuple[Renderer, np.ndarray, np.ndarray]:
    """Render a resting vibration of 300 ms by taps; also as single moments, as live."""
    device = replace(make_device({"motor": ("vibration", PLACE)}), scheme=Scheme("saltation"))
    header = make_header({"buzz": "vibration"}, 3 * rate // 10, rate_hz=Fraction(rate))
    count = header.time.sample_count
    run = make_run(header, "buzz", {k: {4: 1.0} for k in range(count)}, [6.0, 100.0])
    renderer = Renderer(header, device, lambda name: MODELS[name])
    renderer.add([run])
    moments = MomentRenderer(header, device, lambda name: MODELS[name])
    live = []
    for k in range(count):
        one = make_run(header, "buzz", {0: {4: 1.0}}, [6.0, 100.0])
        moment = replace(one, times_s=header.time.times_s(np.array([k])))
        live.append(moments.ahead([moment], {})[0][0])
    return renderer, renderer.raster().values[:, 0], np.array(live)


def test_tracks_and_live_moments_tap_alike() -> None:
    """Taps of 20 ms every 50 ms: rows 0, 1, 5, 6, 10 ... at 100 samples a second."""
    renderer, exported, live = _tapping(100)
    rows = np.arange(30)
    expected = np.where(rows % 5 < 2, 6.0, 0.0)
    np.testing.assert_array_equal(exported, expected)
    np.testing.assert_array_equal(live, expected)
    assert not renderer.notes()
    assert not renderer.raster().shortfalls, "pauses between taps count as rendered"


def test_too_few_samples_are_reported() -> None:
    renderer, _, _ = _tapping(30)
    (note,) = renderer.notes()
    assert "30 samples a second are too few for the scheme 'saltation', which needs 40" in note


@pytest.mark.parametrize("scheme", ["brush", "saltation"])
def test_shipped_devices_take_the_schemes(scheme: str) -> None:
    assert load_device("back_pad").rendered_by(scheme).scheme == Scheme(scheme)
