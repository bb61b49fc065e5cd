# SPDX-License-Identifier: GPL-3.0-or-later
"""Heights from normals, and scans seen from above."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.texture.height_field import heights_of_normals
from hfx_blender.engine.texture.scan import seen_from_above
from hfx_blender.errors import InputError

TEXEL = (0.2e-3, 0.5e-3)


def normals_of(slope_x: np.ndarray, slope_y: np.ndarray) -> np.ndarray:
    normals = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


@settings(max_examples=25, deadline=None)
@given(st.integers(-5, 5), st.integers(-3, 3), st.floats(0.0, 6.28), st.floats(1e-6, 2e-4))
def test_waves_that_tile_come_back_exactly(
    across: int, up: int, phase: float, amplitude: float
) -> None:
    rows, columns = 16, 32
    x, y = np.meshgrid(np.arange(columns) / columns, np.arange(rows) / rows)
    angle = 2.0 * np.pi * (across * x + up * y) + phase
    factor = 2.0 * np.pi * amplitude
    slope_x = factor * across / (columns * TEXEL[0]) * np.cos(angle)
    slope_y = factor * up / (rows * TEXEL[1]) * np.cos(angle)
    heights = heights_of_normals(normals_of(slope_x, slope_y), TEXEL, tiles=True)
    expected = amplitude * np.sin(angle) if across or up else np.zeros_like(x)
    if np.hypot(slope_x, slope_y).max() < 10.0:  # steeper is a fault of the map
        assert np.allclose(heights, expected, atol=1e-6 * amplitude + 1e-12)


def test_a_slope_without_end_is_followed_where_the_map_does_not_tile() -> None:
    slope = np.full((24, 40), 0.1)
    heights = heights_of_normals(normals_of(slope, 0.0 * slope), TEXEL)
    steps = np.diff(heights[12, 4:-4])
    assert np.allclose(steps, 0.1 * TEXEL[0], rtol=0.05)


def test_invalid_normals_are_flat() -> None:
    normals = normals_of(np.zeros((8, 8)), np.zeros((8, 8)))
    normals[2:4, 2:4] = np.nan
    normals[5, 5] = (1.0, 0.0, 0.0)  # vertical
    assert np.isfinite(heights_of_normals(normals, TEXEL)).all()
    normals[5, 5] = (0.0, 0.0, 1.0)
    assert np.allclose(heights_of_normals(normals, TEXEL), 0.0)


def sheet(count: int = 400) -> np.ndarray:
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.0, 1.0, (count, 3)) * (0.02, 0.01, 0.0005)
    return points


def turned(points: np.ndarray, axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    one, two = [k for k in range(3) if k != axis]
    matrix = np.eye(3)
    matrix[one, one] = matrix[two, two] = c
    matrix[one, two], matrix[two, one] = -s, s
    return points @ matrix.T


def test_a_sheet_that_lies_keeps_its_own_coordinates() -> None:
    points = turned(sheet(), 1, 20.0) + np.array([5.0, 6.0, 7.0])
    assert np.array_equal(seen_from_above(points), points)


@pytest.mark.parametrize("degrees", [60.0, 90.0, 120.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_sheet_that_stands_is_laid_down(axis: int, degrees: float) -> None:
    points = sheet()
    actual = seen_from_above(turned(points, axis, degrees))
    assert np.ptp(actual[:, 2]) < 0.0015
    assert sorted(np.ptp(actual[:, :2], axis=0)) == pytest.approx([0.02, 0.04], rel=0.05)
    between = np.linalg.norm(actual[1:] - actual[:-1], axis=1)
    assert np.allclose(between, np.linalg.norm(points[1:] - points[:-1], axis=1))
    assert np.linalg.det(np.linalg.lstsq(points, actual - actual.mean(0), rcond=None)[0]) > 0.0


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((2, 3)), "2 points"),
        (np.zeros((5, 3)), "one place"),
        (np.outer(np.arange(9.0), (1.0, 2.0, 3.0)), "on a line"),
        (np.random.default_rng(0).normal(size=(500, 3)), "no sheet"),
        (np.eye(3) * 1e200, r"1e\+200 m, allowed is up to 1e\+07 m"),
    ],
)
def test_an_invalid_sheet_is_refused(points: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        seen_from_above(points)
