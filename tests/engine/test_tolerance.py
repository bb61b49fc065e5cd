# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances: documented presets, and user input."""

from __future__ import annotations

import math

import pytest

from hfx_blender.engine import tolerance
from hfx_blender.errors import UsageError


def test_presets_are_those_that_the_product_promises():
    assert tolerance.PREVIEW.time_s == 0.040
    assert tolerance.PREVIEW.edge_m(0.030) == 0.030
    assert tolerance.PREVIEW.amplitude == 0.20
    assert tolerance.STANDARD.time_s == 0.010
    assert tolerance.STANDARD.edge_m(0.006) == 0.003
    assert tolerance.STANDARD.edge_m(0.040) == 0.005
    assert tolerance.STANDARD.amplitude == 0.05
    assert tolerance.EXACT.edge_m(0.040) == 0.0
    assert tolerance.PAPER.edge_m(0.040) == math.inf


def test_values_are_read_in_their_units():
    read = tolerance.parse(" 3mm, 5 ms,2% ")
    assert (read.distance_m, read.time_s, read.amplitude) == (0.003, 0.005, 0.02)
    assert read.edge_m(0.001) == 0.003
    assert tolerance.parse("3mm,5ms").amplitude == tolerance.STANDARD.amplitude
    assert tolerance.parse("Standard") is tolerance.STANDARD


@pytest.mark.parametrize(
    "text", ["", "fast", "3mm", "5ms", "3mm,5ms,3mm", "-1mm,5ms", "nanmm,5ms", "1e999mm,5ms", "3,5"]
)
def test_an_unknown_tolerance_is_refused_with_the_allowed(text):
    with pytest.raises(UsageError, match="expected"):
        tolerance.parse(text)


def test_a_negative_tolerance_is_a_defect_of_the_caller():
    with pytest.raises(ValueError, match="negative"):
        tolerance.Tolerance("x", -1.0, 1.0, math.inf, 0.1)
