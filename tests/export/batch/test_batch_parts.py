# SPDX-License-Identifier: GPL-3.0-or-later
"""Division of a scene's samples into parts."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.export.batch.units import even_parts, parts_of

CHUNK = 128


def _check(parts: list[tuple[int, int]], count: int) -> None:
    assert parts[0][0] == 0 and parts[-1][1] == count
    assert all(first < stop for first, stop in parts)
    assert all(parts[k][1] == parts[k + 1][0] for k in range(len(parts) - 1))
    assert all(first % CHUNK == 0 for first, _ in parts)


@given(st.integers(1, 20_000), st.integers(1, 5000))
def test_parts_of_a_size_are_whole_chunks_covering_all_samples(count: int, size: int) -> None:
    parts = parts_of(size, count)
    _check(parts, count)
    assert all(size <= stop - first < size + CHUNK for first, stop in parts[:-1])


@given(
    count=st.integers(1, 20_000),
    expected=st.integers(1, 9),
    active=st.floats(0.0, 1.0),
    begin=st.floats(0.0, 1.0),
)
def test_even_parts_share_the_samples_that_are_work(
    count: int, expected: int, active: float, begin: float
) -> None:
    first = int(begin * (1.0 - active) * count)
    samples = np.arange(first, first + int(active * count))
    parts = even_parts(samples, count, expected, shortest=8 * CHUNK)
    _check(parts, count)
    assert len(parts) <= max(min(expected, len(samples) // (8 * CHUNK)), 1)
    work = [int(((samples >= low) & (samples < high)).sum()) for low, high in parts]
    assert max(work) - min(work) <= 2 * CHUNK + 2  # each cut is rounded


def test_short_scenes_stay_whole() -> None:
    assert even_parts(np.arange(8 * CHUNK * 2 - 1), 5000, 8) == [(0, 5000)]
    assert even_parts(np.zeros(0, np.int64), 5000, 8) == [(0, 5000)]
