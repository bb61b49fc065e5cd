# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief estimated from pictures: symmetries, units, and better results than simple filters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import MapSettings, make_map
from hfx_blender.engine.texture.relief import relief_network
from hfx_blender.engine.texture.relief.relief_estimate import EstimatedRelief, estimate
from hfx_blender.errors import InputError
from hfx_tools.bench.surfaces import relief as bench
from hfx_tools.relief import weight_storage


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """Return lit bumps of 16 and 12 texels in two colours, 96 x 64, tiling."""
    y, x = np.mgrid[0:96, 0:64]
    light = 0.5 + 0.2 * np.cos(2 * np.pi * x / 16) * np.sin(2 * np.pi * y / 12)
    red = np.where(np.sin(2 * np.pi * (x + y) / 16) > 0, 1.0, 0.8)
    return np.stack([light * red, light, light], -1)


def layers(layers_found: EstimatedRelief) -> np.ndarray:
    return np.stack([layers_found.field.heights_m, layers_found.slope, layers_found.roughness])


@pytest.mark.parametrize("tiles", [True, False])
def test_the_relief_turns_with_the_picture(picture: np.ndarray, tiles: bool) -> None:
    straight = layers(estimate(picture, (0.064, 0.096), tiles=tiles))
    turned = layers(estimate(np.rot90(picture), (0.096, 0.064), tiles=tiles))
    assert np.ptp(straight[1]) > 0.01
    assert np.allclose(np.rot90(turned, -1, (1, 2)), straight, atol=1e-5)


def test_tiling_pictures_give_tiling_reliefs(picture: np.ndarray) -> None:
    straight = layers(estimate(picture, (0.064, 0.096), tiles=True))
    moved = layers(estimate(np.roll(picture, (64, 32), (0, 1)), (0.064, 0.096), tiles=True))
    assert np.allclose(np.roll(straight, (64, 32), (1, 2)), moved, atol=1e-5)


def test_slopes_have_no_scale_and_heights_grow_with_the_size(picture: np.ndarray) -> None:
    small, large = (estimate(picture, (s, 1.5 * s)) for s in (0.01, 0.1))
    assert np.allclose(small.slope, large.slope)
    assert np.allclose(10.0 * small.field.heights_m, large.field.heights_m)


def test_the_level_is_agreed_on_with_the_picture_at_half_its_resolution() -> None:
    (case,) = bench.cases(1, 0, ("interference",))
    full = case.srgb.astype(np.float32)
    half = full.reshape(128, 2, 128, 2, 3).mean((1, 3))
    weights = relief_network.stored_weights()
    alone = [relief_network.of_all_turns(item, weights, True).slope.mean() for item in (full, half)]
    agreed = relief_network.estimated(full, tiles=True).slope.mean()
    assert max(alone) > 1.3 * min(alone)
    assert agreed == pytest.approx(np.sqrt(alone[0] * alone[1]), rel=1e-4)


def test_any_size_is_kept(picture: np.ndarray) -> None:
    odd = estimate(picture[:37, :51], (0.02, 0.03), tiles=True)
    assert odd.slope.shape == odd.roughness.shape == odd.field.heights_m.shape == (37, 51)
    assert odd.field.size_m == pytest.approx((0.02, 0.03))
    assert 0.0 <= odd.roughness.min() and odd.roughness.max() <= 1.0 and odd.slope.min() >= 0.0


@pytest.mark.parametrize("wrong", [np.zeros((4, 4)), np.full((4, 4, 3), np.nan)])
def test_an_invalid_picture_is_refused(wrong: np.ndarray) -> None:
    with pytest.raises(InputError, match="Picture: "):
        estimate(wrong, (0.1, 0.1))


def test_the_estimate_beats_simple_filters_on_unseen_families() -> None:
    actual = []
    for case in bench.cases(1, 0, ("chevrons", "popcorn")):
        ways = bench.intensity_of(case), *bench.simple(case)
        actual.append([bench.correlation(way, case.truth) for way in ways])
    relief, sobel, contrast = np.mean(actual, axis=0)
    assert relief > 0.4 and relief > 0.15 + max(sobel, contrast)


@pytest.mark.parametrize("tiles", [True, False])
def test_a_convolution_is_that_of_scipy(tiles: bool) -> None:
    rng = np.random.default_rng(0)
    x, kernel = rng.normal(size=(2, 70, 5)), rng.normal(size=(1, 2, 3, 3))
    actual = relief_network.convolved(x, kernel, np.array([0.5]), tiles)[0]
    mode = "wrap" if tiles else "nearest"
    truth = sum(ndimage.correlate(x[k], kernel[0, k], mode=mode) for k in range(2))
    assert np.allclose(actual, truth + 0.5, atol=1e-5)


def test_weights_keep_their_values_within_half_a_step_of_their_output() -> None:
    rng = np.random.default_rng(3)
    kernel = rng.normal(size=(4, 5, 3, 3)).astype(np.float32) * 10.0 ** rng.integers(
        -3, 3, (4, 1, 1, 1)
    )
    kernel[2] = 0.0
    weights = {"a.weight": kernel.astype(np.float32), "a.bias": rng.random(4).astype(np.float32)}
    packed = weight_storage.packed(weights)
    assert packed["a.weight"].dtype == np.int8
    again = relief_network.unpacked(packed)
    assert again.keys() == weights.keys() and np.array_equal(again["a.bias"], weights["a.bias"])
    error = np.abs(again["a.weight"] - kernel).max((1, 2, 3))
    assert (error <= 0.501 * np.abs(kernel).max((1, 2, 3)) / 127.0).all() and error[0] > 0.0


def test_the_weights_are_a_small_file() -> None:
    assert relief_network.WEIGHTS.stat().st_size <= 300_000


def test_a_map_takes_a_slope_that_is_known_by_itself() -> None:
    flat = HeightField(np.zeros((8, 8)), (1e-4, 1e-4))
    slope = np.zeros((8, 8), np.float32)
    slope[2, 3] = 0.5
    settings = MapSettings(blur_m=1e-4, full_slope=2.0)
    assert np.array_equal(make_map(flat, None, settings, slope).intensity, slope / 2.0)
    soft = make_map(flat, None, MapSettings(blur_m=3e-4), slope).intensity
    assert soft.max() < 0.1 and soft.sum() == pytest.approx(0.5, rel=1e-3)
