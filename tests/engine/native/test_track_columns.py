# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets as changes, and actuators in reach of sets: the compiled code equals numpy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.native.library import library
from hfx_blender.engine.rendering import coverage
from hfx_blender.engine.rendering.coverage import ActuatorCells
from hfx_blender.engine.track import codec
from hfx_blender.engine.track.codec import Section

pytestmark = pytest.mark.skipif(library() is None, reason="no library was built")

_IDS = st.lists(st.sets(st.integers(0, 30) | st.integers(65530, 65540), max_size=12), max_size=8)


def _sets(drawn: list[set[int]], seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return offsets, vertices and weights; some sets are repeated with equal weights."""
    random = np.random.default_rng(seed)
    vertices, weights = [], []
    for ids in drawn:
        vertices.append(np.array(sorted(ids), np.int32))
        weights.append(random.integers(1, 4, len(ids)).astype(np.uint8))
        for _ in range(random.integers(0, 3)):
            vertices.append(vertices[-1])
            weights.append(weights[-1].copy())
            if len(ids) and random.random() < 0.5:
                weights[-1][random.integers(0, len(ids))] += 200
    offsets = np.cumsum([0, *map(len, vertices)]).astype(np.int64)
    return (
        offsets,
        np.concatenate([np.zeros(0, np.int32), *vertices]),
        np.concatenate([np.zeros(0, np.uint8), *weights]),
    )


def _section(offsets: np.ndarray, vertices: np.ndarray, weights: np.ndarray) -> Section:
    count = len(offsets) - 1
    return Section(
        stream=0,
        steps=np.arange(count),
        levels=np.ones(count),
        parameters=np.ones((count, 1)),
        is_new=np.ones(count, np.bool_),
        sizes=np.diff(offsets),
        vertices=vertices,
        weights=weights,
    )


@given(_IDS, st.integers(0, 2**32 - 1))
def test_changes_of_sets_are_the_same_bytes(drawn: list[set[int]], seed: int) -> None:
    section = _section(*_sets(drawn, seed))
    compiled = codec.encode(section)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(codec, "library", lambda: None)
        assert codec.encode(section) == compiled


def test_a_set_of_no_model_is_left_to_numpy() -> None:
    """The lookup would be out of bounds."""
    offsets, vertices = np.array([0, 2]), np.array([-5, 3], np.int32)
    assert codec._compiled_columns(_section(offsets, vertices, np.ones(2, np.uint8))) is None


@given(_IDS, st.integers(0, 2**32 - 1), st.sampled_from([np.uint8, np.float32]))
def test_sets_that_stay_are_found(drawn: list[set[int]], seed: int, kind: type) -> None:
    offsets, vertices, weights = _sets(drawn, seed)
    weights = weights.astype(kind)
    parts = [slice(a, b) for a, b in pairwise(offsets)]
    expected = [
        k > 0
        and np.array_equal(vertices[parts[k - 1]], vertices[part])
        and np.array_equal(weights[parts[k - 1]], weights[part])
        for k, part in enumerate(parts)
    ]
    assert codec.repeated_sets(offsets, vertices, weights).tolist() == expected


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_strongest_weight_is_the_same_bit_by_bit(seed: int, pans: bool) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 60))
    rows = [
        np.sort(random.choice(count, random.integers(0, count), replace=False)).astype(np.int32)
        for _ in range(random.integers(1, 6))
    ]
    factors = [random.random(len(row)) for row in rows] if pans else None
    cells = ActuatorCells(rows, count, factors)
    sets = [np.flatnonzero(random.random(count) < 0.4) for _ in range(random.integers(0, 6))]
    offsets = np.cumsum([0, *map(len, sets)]).astype(np.int64)
    vertices = np.concatenate([np.zeros(0, np.int32), *sets]).astype(np.int32)
    weights = random.random(len(vertices)).astype(np.float32)
    if len(weights) and random.random() < 0.2:
        weights[random.integers(0, len(weights))] = random.choice([np.nan, np.inf, 0.0])
    gains = cells.gains(offsets, vertices, weights, "strongest")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "library", lambda: None)
        with np.errstate(invalid="ignore"):
            expected = cells.gains(offsets, vertices, weights, "strongest")
    assert np.array_equal(gains, expected, equal_nan=True)
