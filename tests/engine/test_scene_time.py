# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample times."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.scene import TimeBase

_RATES = st.sampled_from(
    [Fraction(24), Fraction(30), Fraction(60), Fraction(30000, 1001), Fraction(25, 2)]
)
_SAMPLES = st.sampled_from(
    [Fraction(1), Fraction(7), Fraction(100), Fraction(1000), Fraction(1, 3)]
)


def test_a_hundred_hertz_at_sixty_frames() -> None:
    time = TimeBase(Fraction(60), Fraction(100), 1, 1, 60)
    assert time.sample_count == 100
    assert time.frame(0) == 1
    assert time.frame(1) == Fraction(8, 5)
    assert time.frame(5) == 4
    assert time.times_s(np.array([0, 1, 50])).tolist() == [0.0, 0.01, 0.5]


def test_one_frame_lasts_a_frame() -> None:
    assert TimeBase(Fraction(24), Fraction(24), 1, 5, 5).sample_count == 1
    assert TimeBase(Fraction(24), Fraction(100), 1, 5, 5).sample_count == 5  # 0 to 40 ms, 41.7 ms
    assert TimeBase(Fraction(24), Fraction(1), 1, 5, 5).sample_count == 1


def test_time_zero_is_the_first_frame_of_the_scene() -> None:
    time = TimeBase(Fraction(24), Fraction(100), 1, 25, 48)
    assert time.times_s(np.array([0, 10])).tolist() == [1.0, 1.1]
    before = TimeBase(Fraction(24), Fraction(100), 1, -23, 48)
    assert before.times_s(np.array([0]))[0] == -1.0


@given(_RATES, _SAMPLES, st.integers(-100, 100), st.integers(0, 500))
def test_samples_cover_the_range(fps: Fraction, rate_hz: Fraction, first: int, length: int) -> None:
    time = TimeBase(fps, rate_hz, 0, first, first + length)
    end = time.frame_last + 1
    assert time.frame(0) == first
    assert time.frame(time.sample_count - 1) < end <= time.frame(time.sample_count)
    assert time.frame(7) - time.frame(6) == fps / rate_hz


@given(_RATES, _SAMPLES, st.integers(-100, 100), st.integers(0, 10**6))
def test_times_are_those_of_the_frames(
    fps: Fraction, rate_hz: Fraction, first: int, index: int
) -> None:
    time = TimeBase(fps, rate_hz, 3, first, first + 10)
    exact = (time.frame(index) - 3) / fps
    assert time.times_s(np.array([index]))[0] == pytest.approx(float(exact), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("fps", "rate_hz", "last", "message"),
    [(0, 100, 9, "positive"), (24, 0, 9, "positive"), (24, -1, 9, "positive"), (24, 1, 0, "empty")],
)
def test_impossible_times(fps: int, rate_hz: int, last: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TimeBase(Fraction(fps), Fraction(rate_hz), 1, 1, last)
