# SPDX-License-Identifier: GPL-3.0-or-later
"""Row selection of a block: effect on, pose known, one sample following another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise
from math import isfinite
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .arrays import I64, Bool
from .counters import Counters
from .scene import AnimationBlock, BodyDescription, EffectBlock, EffectDescription, PoseBlock

FARTHEST = 1e12
"""Metres, and entries of matrices: a place beyond it is none, and its speed no float32."""

NOTHING: Final = 1e-9
"""A body whose matrix holds nothing larger is one point."""


def active_rows(
    effects: Sequence[EffectDescription], block: AnimationBlock, counters: Counters
) -> list[I64]:
    """Rows at which each effect is on and all its values are numbers."""
    if not effects:
        return []
    if len(block.indices) == 1 and block.own == slice(0, 1):
        values = [[*each.levels.tolist(), *each.parameters[0].tolist()] for each in block.effects]
        if all(map(isfinite, chain(*values))):
            none, only = np.zeros(0, np.int64), np.zeros(1, np.int64)
            return [only if level > 0.0 else none for level, *_ in values]
    parts = [animated.levels for animated in block.effects]
    parts += [animated.parameters.ravel() for animated in block.effects]
    together, count = np.concatenate(parts), len(block.indices)
    if np.isfinite(together).all():
        on = together[: len(effects) * count].reshape(len(effects), count) > 0.0
        _keep_own(on.T, block)
        numbers, rows = on.nonzero()
        cuts = np.searchsorted(numbers, np.arange(len(effects) + 1)).tolist()
        return [rows[first:last] for first, last in pairwise(cuts)]
    return [
        _finite_rows(effect, animated, block, counters)
        for effect, animated in zip(effects, block.effects, strict=True)
    ]


def _finite_rows(
    effect: EffectDescription, animated: EffectBlock, block: AnimationBlock, counters: Counters
) -> I64:
    finite = np.isfinite(animated.levels) & np.isfinite(animated.parameters).all(axis=1)
    judged = finite[block.own]
    if not judged.all():
        counters.warn(
            f"effect '{effect.name}': a value is not a finite number; it is silent there",
            int(np.count_nonzero(~judged)),
        )
    on = finite & (np.where(finite, animated.levels, 0.0) > 0.0)
    _keep_own(on, block)
    return np.flatnonzero(on)


def _keep_own(on: Bool, block: AnimationBlock) -> None:
    """Clear a mask (T, ...) at the rows of the blocks before and after."""
    on[: block.own.start] = False
    on[block.own.stop :] = False


def with_directions(
    effects: Sequence[EffectDescription], block: AnimationBlock, counters: Counters
) -> AnimationBlock:
    """A block whose winds all blow somewhere: to +Z where a direction is (0, 0, 0)."""
    found = None
    for k, effect in enumerate(effects):
        if effect.modality != "wind" or block.effects[k].parameters[:, 1:4].any(axis=1).all():
            continue
        animated = block.effects[k]
        still = ~animated.parameters[:, 1:4].any(axis=1)
        parameters = animated.parameters.copy()
        parameters[still, 1:4] = 0.0, 0.0, 1.0
        found = list(block.effects) if found is None else found
        found[k] = replace(animated, parameters=parameters)
        count = int(np.count_nonzero((still & (animated.levels > 0.0))[block.own]))
        if count and animated.matrices is None:  # contacts tell of a flattened volume
            text = f"effect '{effect.name}': its Z axis has no direction; its wind blows to +Z"
            counters.warn(text, count)
    return block if found is None else replace(block, effects=tuple(found))


def warn_of_controls(
    effect: EffectDescription, animated: EffectBlock, rows: I64, counters: Counters
) -> None:
    """Warn of a contact response whose controls are no numbers at rows where it is on."""
    if animated.response is None or np.isfinite(animated.response[rows]).all():
        return
    bad = ~np.isfinite(animated.response[rows]).all(axis=(1, 2))
    text = f"effect '{effect.name}': a value of its contact response is not a finite number"
    counters.warn(f"{text}; the default is taken there", int(np.count_nonzero(bad)))


def posed_rows(pose: PoseBlock) -> I64:
    """Rows that were read and hold nothing but numbers that a place can have."""
    finite = pose.valid.copy()
    for values in (pose.to_world, pose.bones, pose.surface):
        if values is not None and not _is_near(values):
            finite &= (np.abs(values) <= FARTHEST).reshape(len(values), -1).all(axis=1)
    return finite.nonzero()[0]


def _is_near(values: npt.NDArray[np.floating[Any]]) -> bool:
    """Quick test, by the sum of squares, that all values are finite and within FARTHEST."""
    flat = values.ravel()
    return bool(np.einsum("i,i->", flat, flat) <= 0.9 * FARTHEST**2)  # which is rounded


def warn_of_point(active: Bool, pose: PoseBlock, body: BodyDescription, counters: Counters) -> None:
    """Count a warning about a body scaled to nothing at rows (T,) where an effect is on."""
    is_point = (np.abs(pose.to_world[:, :3, :3]) <= NOTHING).all(axis=(1, 2))
    count = int(np.count_nonzero(is_point & pose.valid & active))
    if count:
        text = f"body '{body.name}' is scaled to nothing: all of it is felt at one point"
        counters.warn(text, count)


def of_read(rows: I64, pose: PoseBlock) -> I64:
    """Select the rows at which a body was read; a disabled body is not."""
    return rows if pose.valid.all() else rows[pose.valid[rows]]


def with_pose(
    rows: I64,
    posed: I64,
    body: BodyDescription,
    counters: Counters,
    *,
    needs_pose: bool = False,
) -> I64:
    """Select the rows, ascending, at which the pose is known; count a warning for the others.

    ``needs_pose``: painted effects are not felt without a pose, either.
    """
    if len(rows) and rows[-1] < len(posed) == posed[-1] + 1:
        return rows  # all up to the last
    known = np.isin(rows, posed)
    if not known.all():
        counters.warn(
            f"body '{body.name}': its pose is no usable number; "
            + ("nothing is" if needs_pose else "no volume is")
            + " felt there"
            + ("" if needs_pose else ", painted effects go on"),
            int(np.count_nonzero(~known)),
        )
    return rows[known]


def followed(
    rows: I64, posed: I64, animated: EffectBlock, block: AnimationBlock
) -> tuple[I64, Bool, Bool]:
    """Rows with those that precede them, and masks: to be reported, and following the row before.

    A row follows the sample before its own if the effect was on then and the pose is known.
    """
    count = len(block.indices)
    if count == 1:
        return rows, np.ones(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
    # For each row: whether it was requested; whether the next one follows it.
    is_asked, is_before = np.zeros(count, np.bool_), np.zeros(count + 1, np.bool_)
    is_asked[rows] = True
    levels = animated.levels[:-1]
    is_before[posed] = True
    is_before[: count - 1] &= (
        is_asked[1:]
        & (levels > 0.0)
        & np.isfinite(levels)
        & (block.indices[:-1] == block.indices[1:] - 1)
    )
    is_before[count - 1 :] = False
    together = np.flatnonzero(is_asked | is_before[:-1])
    return together, is_asked[together], is_before[together - 1]  # the last is before none
