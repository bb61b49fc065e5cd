# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows count where an effect is on and all values are finite, for any number of rows."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.engine.active_rows import (
    FARTHEST,
    active_rows,
    followed,
    posed_rows,
    warn_of_controls,
    with_directions,
    with_pose,
)
from hfx_blender.engine.counters import Counters
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    PoseBlock,
    SkinBinding,
)
from hfx_blender.engine.volume.shape import Falloff

values = st.sampled_from([0.0, 1.0, -1.0, 0.5, 1e13, np.nan, np.inf, -np.inf])


def _drawn(data: st.DataObject, *shape: int) -> np.ndarray:
    count = int(np.prod(shape))
    return np.reshape(data.draw(st.lists(values, min_size=count, max_size=count)), shape) * 1.0


@given(st.data(), st.integers(1, 3), st.integers(0, 3), st.integers(0, 1), st.booleans())
def test_an_effect_is_active_while_on_with_finite_values(data, rows, effects, history, is_tame):
    blocks = []
    for k in range(effects):
        levels, parameters = _drawn(data, rows), _drawn(data, rows, k)
        if is_tame:
            levels, parameters = np.nan_to_num(levels), np.nan_to_num(parameters)
        blocks.append(EffectBlock(levels, parameters))
    block = AnimationBlock(np.arange(rows), tuple(blocks), (), min(history, rows))
    descriptions = [
        EffectDescription(f"e{k}", f"e{k}", "vibration", "m", HapticVolume(Falloff()))
        for k in range(effects)
    ]
    counters = Counters()
    actual = active_rows(descriptions, block, counters)
    bad = 0
    for item, animated in zip(actual, blocks, strict=True):
        finite = np.isfinite(animated.levels) & np.isfinite(animated.parameters).all(axis=1)
        bad += np.count_nonzero(~finite[block.history :])
        expected = [
            row for row in range(block.history, rows) if finite[row] and animated.levels[row] > 0.0
        ]
        assert item.tolist() == expected
    assert sum(counters.warnings.values()) == bad


@given(st.data(), st.integers(0, 3), st.sampled_from(["to_world", "bones", "surface"]))
def test_a_pose_counts_only_if_all_values_are_finite(data, rows, which):
    arrays = {
        "to_world": np.tile(np.eye(4), (rows, 1, 1)),
        "bones": np.zeros((rows, 2, 3, 4)),
        "surface": np.zeros((rows, 5, 3), np.float32),
    }
    for row, drawn in zip(arrays[which], _drawn(data, rows, 2), strict=True):
        row.ravel()[:2] = drawn
    valid = np.array(data.draw(st.lists(st.booleans(), min_size=rows, max_size=rows)), np.bool_)
    expected = [
        row
        for row in range(rows)
        if valid[row]
        and all(abs(value) <= FARTHEST for value in arrays[which][row].ravel().tolist())
    ]
    before = valid.copy()
    assert posed_rows(PoseBlock(valid, **arrays)).tolist() == expected
    assert (valid == before).all()


@given(st.sets(st.integers(0, 5)), st.sets(st.integers(0, 5)))
def test_rows_without_a_pose_are_reported_and_left_out(expected_rows, posed):
    body, counters = BodyDescription("b", "B", SkinBinding(())), Counters()
    rows, known = (np.array(sorted(item), np.int64) for item in (expected_rows, posed))
    assert with_pose(rows, known, body, counters).tolist() == sorted(expected_rows & posed)
    assert sum(counters.warnings.values()) == len(expected_rows - posed)


def test_a_row_of_its_own_follows_none():
    block = AnimationBlock(np.array([7]), (), ())
    animated = EffectBlock(np.ones(1), np.ones((1, 1)))
    only = np.zeros(1, np.int64)
    rows, is_on, follows = followed(only, only, animated, block)
    assert (rows.tolist(), is_on.tolist(), follows.tolist()) == ([0], [True], [False])


def test_wind_without_a_direction_blows_up_and_is_reported():
    levels, still = np.array([1.0, 1.0, 0.0, 1.0]), np.zeros(3)
    along = np.array([still, [1.0, 0.0, 0.0], still, still])
    parameters = np.column_stack([np.full(4, 5.0), along])
    effect = EffectDescription(
        "w", "Draught", "wind", "m", PaintedArea("b", np.zeros(0), np.zeros(0))
    )
    block = AnimationBlock(np.arange(4), (EffectBlock(levels, parameters),), (), 1)
    counters = Counters()
    actual = with_directions([effect], block, counters).effects[0].parameters
    assert actual[:, 1:].tolist() == [[0, 0, 1], [1, 0, 0], [0, 0, 1], [0, 0, 1]]
    (warning,) = counters.warnings.items()  # neither before the block nor while off
    assert "'Draught'" in warning[0] and warning[1] == 1
    assert (parameters[0, 1:] == 0.0).all()
    same = AnimationBlock(np.arange(4), (EffectBlock(levels, actual),), (), 1)
    assert with_directions([effect], same, counters) is same


def test_nan_controls_of_a_response_are_reported():
    response = np.ones((3, 1, 2))
    response[1, 0, 1] = np.nan
    effect = EffectDescription("v", "Wall", "vibration", "m", HapticVolume(Falloff()))
    animated = EffectBlock(np.ones(3), np.ones((3, 2)), response=response)
    counters = Counters()
    warn_of_controls(effect, animated, np.array([0, 2]), counters)
    assert not counters.warnings
    warn_of_controls(effect, animated, np.array([0, 1]), counters)
    (warning,) = counters.warnings.items()
    assert "'Wall'" in warning[0] and warning[1] == 1
