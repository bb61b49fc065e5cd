# SPDX-License-Identifier: GPL-3.0-or-later
"""Scans: measured heights are correct, including holes."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.texture.scan import fill_holes, from_points
from hfx_blender.errors import InputError


def _bump(xy: np.ndarray) -> np.ndarray:
    return 1e-3 * np.exp(-np.square(xy - 0.05).sum(axis=1) / 2e-4)


@pytest.mark.parametrize("count", [20_000, 300_000])
def test_scattered_points_become_the_surface_that_they_were_taken_from(count: int) -> None:
    xy = np.random.default_rng(0).uniform(0.0, 0.1, (count, 2))
    field = from_points(np.column_stack([xy, _bump(xy)]))
    rows, columns = field.heights_m.shape
    assert rows * columns == pytest.approx(count, rel=0.05)
    points = np.random.default_rng(1).uniform(0.01, 0.09, (500, 2))
    # The mean of the bump, pi 2e-4 / 0.1^2 mm, is subtracted; even points have no further slope.
    np.testing.assert_allclose(field.sample(points), _bump(points) - 1e-3 * np.pi * 2e-2, atol=3e-5)


def test_a_tilted_scan_is_levelled() -> None:
    xy = np.random.default_rng(0).uniform(0.0, 0.1, (3000, 2))
    tilted = np.column_stack([xy, 0.3 * xy[:, 0] - 2.0 * xy[:, 1] + 7.0])
    assert np.abs(from_points(tilted).heights_m).max() < 1e-9


def test_a_hole_goes_on_smoothly_and_the_rest_stays() -> None:
    x, y = np.meshgrid(np.arange(50), np.arange(40))
    plane = 0.1 * x + 0.2 * y
    holed = plane.copy()
    holed[10:20, 15:30] = np.nan
    holed[0, 0] = np.inf
    filled = fill_holes(holed)
    known = np.isfinite(holed)
    np.testing.assert_array_equal(filled[known], plane[known])
    assert np.isfinite(filled).all()
    assert np.abs(filled - plane)[10:20, 15:30].max() < 1.0  # of a span of 12


def test_a_scan_with_holes_and_nan_is_a_surface() -> None:
    xy = np.random.default_rng(0).uniform(0.0, 0.1, (5000, 2))
    points = np.column_stack([xy, _bump(xy)])
    points[::50] = np.nan
    points = points[~((np.abs(xy - 0.03) < 0.01).all(axis=1))]
    assert np.isfinite(from_points(points).heights_m).all()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((2, 3)), "2 usable points"),
        (np.zeros((0, 3)), "0 usable points"),
        (np.zeros((5, 2)), "expected points"),
        (np.zeros((9, 3)), "on one line"),
        (np.arange(12.0)[:, None] * np.ones(3), "on one line"),
        (np.full((9, 3), np.nan), "0 usable points"),
    ],
)
def test_an_invalid_surface_is_refused(points: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        from_points(points)


def test_too_fine_a_texel_is_refused() -> None:
    points = np.random.default_rng(0).uniform(size=(10, 3))
    with pytest.raises(InputError, match="choose larger"):
        from_points(points, 1e-6)
    with pytest.raises(InputError, match="more than 0"):
        from_points(points, 0.0)
    with pytest.raises(InputError, match="only holes"):
        fill_holes(np.full((3, 3), np.nan))
