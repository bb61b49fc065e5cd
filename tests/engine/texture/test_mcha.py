# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collision maps: layers against independent arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture.haptic_map import DeviceRange, HapticMap, NoticeableSteps
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import MapSettings, blurred_slope, make_map
from hfx_blender.errors import InputError
from hfx_blender.files.limits import TooLargeError


def _slow_slope(heights: np.ndarray, texel: tuple[float, float], blur_m: float) -> np.ndarray:
    """Blur and Sobel after the written definition, texel by texel, with wrap."""
    rows, columns = heights.shape
    reach = [int(4.0 * blur_m / t + 0.5) for t in texel]
    blurred = np.zeros_like(heights)
    total = 0.0
    for v in range(-reach[1], reach[1] + 1):
        for u in range(-reach[0], reach[0] + 1):
            weight = np.exp(-((u * texel[0]) ** 2 + (v * texel[1]) ** 2) / (2.0 * blur_m**2))
            blurred += weight * np.roll(heights, (-v, -u), (0, 1))
            total += weight
    blurred /= total
    slope = np.zeros_like(heights)
    for j in range(rows):
        for i in range(columns):
            around = blurred[np.ix_([j - 1, j, (j + 1) % rows], [i - 1, i, (i + 1) % columns])]
            gx = (around[:, 2] - around[:, 0]) @ [1, 2, 1] / (8.0 * texel[0])
            gy = (around[2] - around[0]) @ [1, 2, 1] / (8.0 * texel[1])
            slope[j, i] = np.sqrt(gx**2 + gy**2)
    return slope


@pytest.mark.parametrize("texel", [(1e-4, 1e-4), (1e-4, 0.7e-4)])
def test_the_slope_is_that_of_an_independent_computation(texel: tuple[float, float]) -> None:
    heights = np.random.default_rng(0).normal(size=(20, 24)) * 1e-4
    expected = _slow_slope(heights, texel, 1.2e-4)
    actual = blurred_slope(HeightField(heights, texel), 1.2e-4)
    np.testing.assert_allclose(actual, expected, atol=2e-6 * expected.max(), rtol=1e-4)


def test_a_blur_far_wider_than_the_surface_removes_the_relief() -> None:
    heights = np.random.default_rng(0).normal(size=(20, 24)) * 1e-9
    field = HeightField(heights, (1e-9, 1e-9), tiles=False)  # a scan in a wrong unit
    rough, blurred = (blurred_slope(field, blur) for blur in (0.0, 1e-3))
    assert blurred.shape == heights.shape and blurred.max() < 1e-3 * rough.max()


def test_where_the_surface_lies_changes_nothing() -> None:
    heights = np.random.default_rng(0).normal(size=(20, 24)) * 1e-6
    slopes = [
        blurred_slope(HeightField(heights + far, (1e-4, 1e-4)), 1.2e-4) for far in (0.0, 10.0)
    ]
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-4, atol=1e-7)


def test_a_ramp_has_its_own_slope_in_non_square_texels() -> None:
    x, y = np.arange(40) * 1e-4, np.arange(30) * 2e-4
    heights = 0.3 * x[None, :] + 0.4 * y[:, None]
    slope = blurred_slope(HeightField(heights, (1e-4, 2e-4), tiles=False), 1e-4)
    np.testing.assert_allclose(slope[8:-8, 8:-8], 0.5, rtol=1e-5)
    height_map = make_map(
        HeightField(heights, (1e-4, 2e-4), tiles=False), settings=MapSettings(full_slope=2.0)
    )
    np.testing.assert_allclose(height_map.intensity[8:-8, 8:-8], 0.25, rtol=1e-5)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 3))
def test_a_turned_or_tiled_picture_gives_the_turned_or_tiled_map(seed: int, turns: int) -> None:
    rng = np.random.default_rng(seed)
    heights, rough = rng.normal(size=(12, 12)) * 1e-4, rng.uniform(size=(12, 12))
    field = HeightField(heights, (1e-4, 1e-4))
    height_map = make_map(field, rough)
    turned = make_map(HeightField(np.rot90(heights, turns), (1e-4, 1e-4)), np.rot90(rough, turns))
    np.testing.assert_allclose(turned.intensity, np.rot90(height_map.intensity, turns), atol=1e-6)
    np.testing.assert_array_equal(turned.sharpness, np.rot90(height_map.sharpness, turns))
    tiled = make_map(HeightField(np.tile(heights, (2, 3)), (1e-4, 1e-4)), np.tile(rough, (2, 3)))
    np.testing.assert_allclose(tiled.intensity, np.tile(height_map.intensity, (2, 3)), atol=1e-6)
    np.testing.assert_array_equal(tiled.sharpness, np.tile(height_map.sharpness, (2, 3)))


def test_the_blur_is_in_millimetres_not_in_texels() -> None:
    x = (np.arange(400) + 0.5) / 400
    wave = 1e-5 * np.sin(2.0 * np.pi * 4 * x)
    coarse = HeightField(np.tile(wave[::2], (4, 1)), (2e-4, 2e-4))
    fine = HeightField(np.tile(wave, (8, 1)), (1e-4, 1e-4))
    slopes = [blurred_slope(field, 1e-3).max() for field in (coarse, fine)]
    assert slopes[0] == pytest.approx(slopes[1], rel=5e-3)
    # 4 waves in 40 mm: a blur of 1 mm leaves the share exp(-2 pi^2 sigma^2 / L^2).
    expected = 1e-5 * 2.0 * np.pi / 1e-2 * np.exp(-2.0 * np.pi**2 * 1e-2)
    assert slopes[1] == pytest.approx(expected, rel=5e-3)


def test_rough_is_low_and_smooth_is_high() -> None:
    field = HeightField(np.zeros((2, 2)), (1e-3, 1e-3))
    height_map = make_map(field, np.array([[0.0, 1.0], [0.5, 0.25]]))
    np.testing.assert_allclose(
        height_map.device.frequency_of(height_map.sharpness), [[260.0, 80.0], [170.0, 215.0]]
    )
    assert not height_map.device.amplitude_m_s2(height_map.intensity).any()


def test_a_roughness_of_another_size_covers_the_same_surface() -> None:
    field = HeightField(np.zeros((8, 8)), (1e-3, 1e-3), tiles=False)
    rough = np.linspace(0.0, 1.0, 16)[None, :] * np.ones((2, 1))
    height_map = make_map(field, rough)
    expected = 1.0 - np.interp((np.arange(8) + 0.5) * 2 - 0.5, np.arange(16), rough[0])
    np.testing.assert_allclose(height_map.sharpness, np.tile(expected, (8, 1)), atol=1e-6)


def test_ranges_belong_to_the_device() -> None:
    device = DeviceRange(amplitude_g=(0.1, 0.6), frequency_hz=(100.0, 200.0))
    half = np.full((1, 2), 0.5, np.float32)
    haptic_map = HapticMap(half, half, (1.0, 1.0), device=device)
    np.testing.assert_allclose(
        haptic_map.device.amplitude_m_s2(haptic_map.intensity), 0.35 * 9.80665
    )
    np.testing.assert_allclose(haptic_map.device.frequency_of(haptic_map.sharpness), 150.0)
    assert DeviceRange().amplitude_m_s2(1.0) == pytest.approx(1.3 * 9.80665)
    assert device.amplitude_m_s2(0.0) == 0.0  # silence, though the range begins above 0


def test_noticeable_steps_are_those_of_the_paper() -> None:
    level = np.linspace(0.0, 1.0, 10_001, dtype=np.float32)[None, :]
    stepped = HapticMap(level, level, (1.0, 1.0)).in_steps()
    g = np.unique(np.round(stepped.device.amplitude_m_s2(stepped.intensity) / 9.80665, 6))
    np.testing.assert_allclose(g, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2], atol=1e-6)
    hz = np.unique(np.round(stepped.device.frequency_of(stepped.sharpness), 3))
    np.testing.assert_allclose(hz, [80.0, 120.0, 160.0, 200.0, 240.0], atol=1e-3)
    nearest = np.abs(
        stepped.device.frequency_of(stepped.sharpness) - stepped.device.frequency_of(level)
    )
    assert nearest[:, :9444].max() <= 20.01


@pytest.mark.parametrize("full", [255, 65535])
def test_each_code_of_a_picture_is_a_height_of_its_own(full: int) -> None:
    codes = np.arange(full + 1)[None, :] * np.ones((3, 1))
    field = HeightField(codes / full * 1e-3, (1e-6, 1e-6), tiles=False)
    slope = blurred_slope(field, 0.0)[1, 2:-2]
    # No banding: a ramp of one code per texel has a constant slope, not runs of flat and steep.
    np.testing.assert_allclose(slope, 1e-3 / full / 1e-6, rtol=0.02 if full > 255 else 1e-4)


@pytest.mark.parametrize(
    "make",
    [
        lambda: MapSettings(blur_m=-1.0),
        lambda: MapSettings(full_slope=0.0),
        lambda: DeviceRange(frequency_hz=(200.0, 100.0)),
        lambda: DeviceRange(amplitude_g=(0.0, float("nan"))),
        lambda: NoticeableSteps(amplitude_g=0.0),
        lambda: HapticMap(np.ones((2, 2), np.float32), np.ones((2, 3), np.float32), (1.0, 1.0)),
        lambda: HapticMap(2 * np.ones((2, 2), np.float32), np.ones((2, 2), np.float32), (1.0, 1.0)),
        lambda: make_map(HeightField(np.ones((2, 2)), (1.0, 1.0)), np.array([[np.nan]])),
    ],
)
def test_meaningless_values_are_refused(make: object) -> None:
    with pytest.raises(InputError):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(("size_m", "blur_m"), [(1e-12, 1e-4), (0.1, 1e6)])
def test_a_blur_that_is_huge_for_its_texels_is_refused_before_memory_is_taken(size_m, blur_m):
    field = HeightField(np.zeros((16, 16)), (size_m / 16, size_m / 16), tiles=False)
    with pytest.raises(TooLargeError, match="allowed are 1,073,741,824 bytes"):
        blurred_slope(field, blur_m)
