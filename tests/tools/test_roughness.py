# SPDX-License-Identifier: GPL-3.0-or-later
"""Roughness of profiles with values known by arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.errors import InputError
from hfx_tools.roughness import roughness_of_profile, roughness_of_surface

SPACING = 1e-6
LENGTH = 7 * 2.5e-3
X = np.arange(int(LENGTH / SPACING)) * SPACING


def _pulse(phase: np.ndarray) -> np.ndarray:
    """Return 1 for a fifth of each period, else 0."""
    return ((phase / (2.0 * np.pi) + 0.005) % 1.0 < 0.2).astype(float)


@pytest.mark.parametrize(
    ("wave", "ra", "rq", "depth", "rsk", "rku"),
    [
        (np.sin, 2.0 / np.pi, np.sqrt(0.5), 2.0, 0.0, 1.5),
        (lambda p: 2.0 / np.pi * np.arcsin(np.sin(p)), 0.5, np.sqrt(1 / 3), 2.0, 0.0, 1.8),
        (lambda p: np.sign(np.sin(p + 1e-9)), 1.0, 1.0, 2.0, 0.0, 1.0),
        # Of a share p: 2 p q, sqrt(p q), (1 - 2 p) / sqrt(p q), 1 + Rsk^2.
        (_pulse, 0.32, 0.4, 1.0, 1.5, 3.25),
    ],
    ids=["sine", "triangle", "square", "pulse"],
)
def test_profiles_have_the_arithmetic_roughness(  # type: ignore[no-untyped-def]
    wave, ra: float, rq: float, depth: float, rsk: float, rku: float
) -> None:
    roughness = roughness_of_profile(3e-6 * wave(2.0 * np.pi * X / 2.5e-4), SPACING)
    assert roughness.ra_m == pytest.approx(3e-6 * ra, rel=0.01)
    assert roughness.rq_m == pytest.approx(3e-6 * rq, rel=0.01)
    for value in (roughness.rz_m, roughness.rmax_m, roughness.pt_m):
        assert value == pytest.approx(3e-6 * depth, rel=0.01)
    assert roughness.rsk == pytest.approx(rsk, rel=0.01, abs=0.01)
    assert roughness.rku == pytest.approx(rku, rel=0.01)
    assert roughness.rsm_m == pytest.approx(2.5e-4, rel=1e-3)
    assert (roughness.sampling_lengths, roughness.cutoff_m) == (5, 2.5e-3)


def test_a_wave_of_twice_the_cutoff_is_filtered() -> None:
    """The mean line is the filter's, not the mean of each sampling length of half a wave."""
    roughness = roughness_of_profile(1e-6 * np.sin(2.0 * np.pi * X / 5e-3), SPACING)
    left = 1e-6 * (1.0 - 2.0**-0.25)  # ISO 16610-21
    assert roughness.ra_m == pytest.approx(2.0 / np.pi * left, rel=1e-3)
    assert roughness.rq_m == pytest.approx(np.sqrt(0.5) * left, rel=1e-3)
    assert roughness.rku == pytest.approx(1.5, rel=1e-3)
    assert roughness.pt_m == pytest.approx(2e-6, rel=1e-3)
    assert roughness.rsm_m == pytest.approx(5e-3, rel=1e-3)


def test_low_and_narrow_peaks_are_no_elements_of_their_own() -> None:
    plain = 1e-6 * np.sin(2.0 * np.pi * X / 5e-4)
    for height, width in ((0.12e-6, 4.1e-5), (3e-6, 1e-5)):  # below 10 % of Rz; below 25 um
        ripple = height * (X % 5e-4 < width)
        roughness = roughness_of_profile(plain + np.where(plain < 0.0, 0.0, ripple), SPACING)
        assert roughness.rsm_m == pytest.approx(5e-4, rel=1e-2)
    deep = 1e-6 * np.sin(2.0 * np.pi * X / 5e-4) + 1.5e-6 * np.sin(2.0 * np.pi * X / 2.5e-4)
    assert roughness_of_profile(deep, SPACING).rsm_m == pytest.approx(2.5e-4, rel=1e-2)


def test_a_single_scratch_counts_fully_in_rmax_and_a_fifth_in_rz() -> None:
    heights = 1e-6 * np.sin(2.0 * np.pi * X / 1e-4)
    middle = int(0.5 * LENGTH / SPACING)
    heights[middle : middle + 10] = -11e-6
    roughness = roughness_of_profile(heights, SPACING)
    assert roughness.rmax_m == pytest.approx(12e-6, rel=0.01)
    assert roughness.rz_m == pytest.approx((4 * 2e-6 + 12e-6) / 5, rel=0.01)


def test_form_and_slope_are_no_roughness() -> None:
    heights = 1e-6 * np.sin(2.0 * np.pi * X / 1e-4)
    plain = roughness_of_profile(heights, SPACING)
    roughness = roughness_of_profile(
        heights + 0.02 * X + 1e-4 * np.sin(2 * np.pi * X / 0.1), SPACING
    )
    assert roughness.ra_m == pytest.approx(plain.ra_m, rel=0.03)


def test_the_surface_has_the_roughness_of_its_profiles() -> None:
    x = (np.arange(100) + 0.5) / 100
    field = HeightField(np.tile(5e-6 * np.sin(2.0 * np.pi * x * 4), (10, 1)), (5e-6, 5e-6))
    across = roughness_of_surface(field, direction_rad=0.0)
    assert across.ra_m == pytest.approx(10e-6 / np.pi, rel=0.02)
    along = roughness_of_surface(field, direction_rad=np.pi / 2.0)
    assert along.ra_m < 1e-9


@pytest.mark.parametrize(
    ("heights", "spacing"),
    [
        (np.zeros(100), 1e-6),
        (np.zeros((10, 10)), 1e-4),
        (np.full(20_000, np.nan), 1e-6),
        (np.zeros(20_000), 0.0),
        (np.zeros(20), 1.0),
    ],
)
def test_a_profile_that_cannot_be_judged_is_refused(heights: np.ndarray, spacing: float) -> None:
    with pytest.raises(InputError):
        roughness_of_profile(heights, spacing)


def test_a_flat_surface_has_none() -> None:
    roughness = roughness_of_surface(HeightField(np.ones((50, 50)), (1e-4, 1e-4)))
    assert (
        max(roughness.ra_m, roughness.rq_m, roughness.rz_m, roughness.rmax_m, roughness.pt_m)
        < 1e-12
    )
    assert roughness.rsk is roughness.rku is roughness.rsm_m is None
