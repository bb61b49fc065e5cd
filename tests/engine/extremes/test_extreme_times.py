# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact times for frame numbers up to a million, negative, sub-frames, any frame rate."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from extreme_cases import SHAPES, feel, person, volume
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hfx_blender.engine.scene import TimeBase

NTSC = Fraction(24000, 1001)  # 23.976
RATES = [Fraction(n) for n in (1, 12, 24, 25, 30, 48, 50, 60, 90, 120, 144, 240)] + [NTSC]
FRAMES = st.integers(-1_000_000, 1_000_000)


@settings(max_examples=300, deadline=None)
@given(
    fps=st.sampled_from(RATES),
    rate=st.sampled_from([Fraction(1), Fraction(24), NTSC, Fraction(100), Fraction(1000)]),
    start=FRAMES,
    first=FRAMES,
    length=st.integers(1, 100_000),
)
@example(fps=NTSC, rate=Fraction(100), start=1, first=-1_000_000, length=2_000_000)
@example(fps=Fraction(240), rate=Fraction(1), start=0, first=1_000_000, length=1)
def test_samples_cover_the_range_and_no_more(fps, rate, start, first, length):
    time = TimeBase(fps, rate, start, first, first + length - 1)
    count = time.sample_count
    assert count >= 1
    end = first + length  # the last frame lasts a whole frame
    assert first == time.frame(0) and time.frame(count - 1) < end <= time.frame(count)
    ends = np.array([0, count // 2, count - 1])
    for index, seconds in zip(ends.tolist(), time.times_s(ends).tolist(), strict=True):
        exact = (time.frame(index) - start) / fps
        assert abs(Fraction(seconds) - exact) <= Fraction(1, 10**9) + abs(exact) / 10**15


@pytest.mark.parametrize("fps", RATES)
def test_a_sample_a_frame_where_the_rates_agree(fps):
    time = TimeBase(fps, fps, 1, -1_000_000, 1_000_000)
    assert time.sample_count == 2_000_001
    assert time.frame(1_000_000) == 0 and time.frame(2_000_000) == 1_000_000


def test_sub_frames_are_exact():
    time = TimeBase(Fraction(24), Fraction(1000), 1, -5, 5)
    assert time.frame(125) == -2 and time.frame(1) == Fraction(-5) + Fraction(24, 1000)
    assert time.sample_count == 459  # 11 frames of 1/24 s are 458.33 samples


@pytest.mark.parametrize("first", [-1_000_000, -1, 0, 999_000])
@pytest.mark.parametrize("fps", [Fraction(1), NTSC, Fraction(240)])
def test_contacts_do_not_depend_on_when_they_are(fps, first, rng):
    model = person(rng, 200)
    matrices = np.tile(np.diag([0.3, 0.3, 0.3, 1.0]), (8, 1, 1))
    matrices[:, 2, 3] = np.linspace(0.2, 1.6, 8)
    early = feel(model, volume(matrices, SHAPES["sphere"]))
    time = TimeBase(fps, Fraction(100), first, first, first + 900)
    late = feel(model, volume(matrices, SHAPES["sphere"]), time=time)
    np.testing.assert_array_equal(early.weights, late.weights)
    assert early.weights.any(axis=2).all()
    (run,) = late.runs
    np.testing.assert_allclose(run.times_s, run.indices / 100.0, atol=1e-12)


@pytest.mark.parametrize(
    ("fps", "rate", "first", "last"),
    [(0, 100, 1, 2), (-24, 100, 1, 2), (24, 0, 1, 2), (24, -1, 1, 2), (24, 100, 2, 1)],
)
def test_impossible_times_are_refused(fps, rate, first, last):
    with pytest.raises(ValueError, match=r"positive|empty"):
        TimeBase(Fraction(fps), Fraction(rate), 1, first, last)
