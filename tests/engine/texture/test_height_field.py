# SPDX-License-Identifier: GPL-3.0-or-later
"""Height fields: sampling with and without tiling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from hfx_blender.engine.texture.height_field import (
    HeightField,
    from_image,
    gaussian_waviness,
    sample_grid,
)
from hfx_blender.engine.texture.relief.linear_light import (
    height_from_colour,
    luminance,
    srgb_to_linear,
)
from hfx_blender.errors import InputError


def _plane(rows: int, columns: int, texel: tuple[float, float]) -> HeightField:
    x = (np.arange(columns) + 0.5) * texel[0]
    y = (np.arange(rows) + 0.5) * texel[1]
    return HeightField(0.3 * x[None, :] - 0.2 * y[:, None] + 0.1, texel, tiles=False)


@pytest.mark.parametrize("order", ["linear", "cubic"])
def test_a_plane_stays_a_plane_for_any_texels(order: str) -> None:
    field = _plane(7, 9, (2e-3, 5e-3))
    points = np.random.default_rng(0).uniform((4e-3, 9e-3), (13e-3, 26e-3), (50, 2))
    expected = 0.3 * points[:, 0] - 0.2 * points[:, 1] + 0.1
    np.testing.assert_allclose(field.sample(points, order), expected, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 12),
    st.integers(1, 12),
    st.integers(-3, 3),
    st.integers(-3, 3),
    st.sampled_from(["linear", "cubic"]),
)
def test_tiling_fields_repeat(rows: int, columns: int, right: int, up: int, order: str) -> None:
    rng = np.random.default_rng(rows * 100 + columns)
    field = HeightField(rng.normal(size=(rows, columns)), (1e-3, 3e-3))
    points = rng.uniform(-0.05, 0.05, (20, 2))
    moved = points + np.array([right, up]) * field.size_m
    np.testing.assert_allclose(field.sample(moved, order), field.sample(points, order), atol=1e-9)


def test_linear_sampling_is_that_of_scipy() -> None:
    rng = np.random.default_rng(1)
    grid = rng.normal(size=(16, 12))
    points = rng.uniform(-0.1, 0.1, (40_000, 2))  # more than are looked up together
    places = np.stack([points[:, 1] / 3e-3 - 0.5, points[:, 0] / 2e-3 - 0.5])
    expected = ndimage.map_coordinates(grid, places, order=1, mode="grid-wrap")
    np.testing.assert_allclose(sample_grid(grid, points, (2e-3, 3e-3), True), expected, atol=1e-12)


def test_beyond_the_edge_non_tiling_fields_are_flat() -> None:
    field = HeightField(np.array([[1.0, 2.0], [3.0, 4.0]]), (1.0, 1.0), tiles=False)
    far = np.array([[-9.0, -9.0], [9.0, -9.0], [-9.0, 9.0], [9.0, 9.0]])
    np.testing.assert_array_equal(field.sample(far), [1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize(
    ("heights", "texel", "words"),
    [
        (np.zeros((0, 4)), (1.0, 1.0), "rows and columns"),
        (np.zeros(4), (1.0, 1.0), "rows and columns"),
        (np.array([[1.0, np.nan]]), (1.0, 1.0), "1 of 2 heights"),
        (np.array([[1.0, np.inf]]), (1.0, 1.0), "1 of 2 heights"),
        (np.ones((2, 2)), (0.0, 1.0), "texel of 0 x 1000 mm"),
        (np.ones((2, 2)), (1.0, np.nan), "texel"),
    ],
)
def test_an_invalid_surface_is_refused(
    heights: np.ndarray, texel: tuple[float, float], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        HeightField(heights, texel)


def test_a_constant_picture_is_a_flat_surface() -> None:
    field = from_image(np.full((4, 4), 0.5), 1e-3, (0.01, 0.02))
    assert field.texel_m == (0.0025, 0.005)
    np.testing.assert_allclose(field.sample(np.zeros((3, 2))), 0.5e-3)


def test_codes_of_srgb_are_made_linear() -> None:
    # From the standard: 0.04045 / 12.92, and code 188 is 0.5029 of the light.
    np.testing.assert_allclose(
        srgb_to_linear([0.0, 0.04045, 188 / 255, 1.0]), [0.0, 0.0031308, 0.50289, 1.0], atol=1e-5
    )
    assert luminance([0.0, 1.0, 0.0]) == pytest.approx(0.7152)
    assert height_from_colour(np.ones((2, 2, 4))).tolist() == [[1.0, 1.0], [1.0, 1.0]]


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 17), st.integers(1, 17), st.booleans(), st.integers(0, 1000))
def test_places_in_texels_have_the_heights_of_the_same_points(
    rows: int, columns: int, tiles: bool, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    field = HeightField(rng.normal(size=(rows, columns)), (1e-3, 3e-3), tiles)
    points = rng.uniform(-0.05, 0.05, (3, 7, 2))
    places = np.stack([points[..., 1] / 3e-3 - 0.5, points[..., 0] / 1e-3 - 0.5])
    np.testing.assert_allclose(field.at_places(places), field.sample(points), atol=1e-9)


def test_half_of_a_wave_as_long_as_the_cutoff_passes_the_waviness_filter() -> None:
    x = (np.arange(64) + 0.5) / 64
    wave = np.sin(2.0 * np.pi * x)
    field = HeightField(np.tile(wave, (8, 1)), (2.5e-3 / 64, 1e-3))
    np.testing.assert_allclose(gaussian_waviness(field, 2.5e-3), 0.5 * field.heights_m, atol=1e-9)
