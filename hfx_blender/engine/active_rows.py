# SPDX-License-Identifier: GPL-3.0-or-later
"""Row selection within a block: effect on, pose known, successive samples."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from .arrays import I64, Bool
from .counters import Counters
from .scene import AnimationBlock, BodyDescription, EffectBlock, EffectDescription, PoseBlock

FARTHEST = 1e12  # largest valid coordinate (metres) or matrix entry; larger speeds overflow float32
NOTHING: Final = 1e-9  # largest matrix entry of a body scaled to a point


@dataclass(frozen=True, eq=False)
class ActiveEffect:
    """Effect of a block with the rows to evaluate."""

    effect: EffectDescription
    animated: EffectBlock
    rows: I64  # (n,) ascending rows of the block
    block: AnimationBlock


def active_rows(
    effects: Sequence[EffectDescription], block: AnimationBlock, counters: Counters
) -> list[I64]:
    """Own rows of a block, ascending, at which each effect has a level above 0 and finite values; a
    list in the order of ``effects``. Warns of non-finite values."""
    if not effects:
        return []
    # Quick path: blocks of finite values only. Many silent effects share one block.
    blocks, count = [*dict.fromkeys(block.effects)], len(block.indices)
    values = np.concatenate([*(b.levels for b in blocks), *(b.parameters.ravel() for b in blocks)])
    if np.isfinite(values).all():
        is_on = values[: len(blocks) * count].reshape(len(blocks), count) > 0.0
        _keep_own(is_on.T, block)
        numbers, rows = is_on.nonzero()
        parts = np.split(rows, np.searchsorted(numbers, np.arange(1, len(blocks))))
        rows_of = dict(zip(blocks, parts, strict=True))
        return [rows_of[animated] for animated in block.effects]
    return [
        _finite_rows(effect, animated, block, counters)
        for effect, animated in zip(effects, block.effects, strict=True)
    ]


def _finite_rows(
    effect: EffectDescription, animated: EffectBlock, block: AnimationBlock, counters: Counters
) -> I64:
    """Own rows at which one effect is on with finite values, ascending; warns with the number of
    others."""
    finite = np.isfinite(animated.levels) & np.isfinite(animated.parameters).all(axis=1)
    # Rows of history and future are counted by the blocks with these as own rows.
    lost = int(np.count_nonzero(~finite[block.own]))
    if lost:
        text = f"effect '{effect.name}': a value is not a finite number; it is silent there"
        counters.warn(text, lost)
    on = finite & (np.where(finite, animated.levels, 0.0) > 0.0)
    _keep_own(on, block)
    return np.flatnonzero(on)


def _keep_own(on: Bool, block: AnimationBlock) -> None:
    """Set a mask (T, ...) to False at a block's history and future rows, in place."""
    on[: block.own.start] = False
    on[block.own.stop :] = False


def with_directions(
    effects: Sequence[EffectDescription], block: AnimationBlock, counters: Counters
) -> AnimationBlock:
    """Block with wind directions (0, 0, 0) replaced by +Z; the block itself if none is on.
    Warns of effects other than volumes and surfaces, where on."""
    replaced: dict[int, EffectBlock] = {}
    for k, (effect, animated) in enumerate(zip(effects, block.effects, strict=True)):
        if effect.modality != "wind":
            continue
        still = ~animated.parameters[:, 1:4].any(axis=1)
        lost = still & (animated.levels > 0.0)
        if not lost.any():
            continue
        parameters = animated.parameters.copy()
        parameters[still, 1:4] = 0.0, 0.0, 1.0
        replaced[k] = replace(animated, parameters=parameters)
        count = int(np.count_nonzero(lost[block.own]))
        if count and animated.matrices is None:  # contacts warn of flattened volumes
            text = f"effect '{effect.name}': its Z axis has no direction; its wind blows to +Z"
            counters.warn(text, count)
    if not replaced:
        return block
    effects_of_block = (replaced.get(k, animated) for k, animated in enumerate(block.effects))
    return replace(block, effects=tuple(effects_of_block))


def warn_of_controls(
    effect: EffectDescription, animated: EffectBlock, rows: I64, counters: Counters
) -> None:
    """Warn of non-finite controls of a contact response at given rows, with their number; nothing
    without a response."""
    if animated.response is None or np.isfinite(animated.response[rows]).all():
        return
    is_bad = ~np.isfinite(animated.response[rows]).all(axis=(1, 2))
    text = f"effect '{effect.name}': a value of its contact response is not a finite number"
    counters.warn(f"{text}; the default is taken there", int(np.count_nonzero(is_bad)))


def posed_rows(pose: PoseBlock) -> I64:
    """Ascending rows of a pose that were read, with matrices, bones and surface finite and at most
    ``FARTHEST``."""
    is_posed = pose.valid.copy()
    for values in (pose.to_world, pose.bones, pose.surface):
        if values is None:
            continue
        # Quick sufficient test: a small sum of squares has no large or non-finite term. The factor
        # covers rounding.
        flat = values.ravel()
        if not np.einsum("i,i->", flat, flat) <= 0.9 * FARTHEST**2:
            is_posed &= (np.abs(values) <= FARTHEST).reshape(len(values), -1).all(axis=1)
    return is_posed.nonzero()[0]


def warn_of_point(active: Bool, pose: PoseBlock, body: BodyDescription, counters: Counters) -> None:
    """Warn of a body whose matrix entries are all at most ``NOTHING``, with the number of read rows
    in ``active`` (T,)."""
    is_point = (np.abs(pose.to_world[:, :3, :3]) <= NOTHING).all(axis=(1, 2))
    count = int(np.count_nonzero(is_point & pose.valid & active))
    if count:
        text = f"body '{body.name}' is scaled to nothing: all of it is felt at one point"
        counters.warn(text, count)


def with_pose(
    rows: I64, posed: I64, body: BodyDescription, counters: Counters, *, needs_pose: bool = False
) -> I64:
    """Rows, of ascending ``rows``, in ``posed`` (known pose); warns with the number of others.
    ``needs_pose``: the warning says that painted effects are silent as well."""
    # As many poses as the last number says: every row up to there is posed.
    if len(rows) and rows[-1] < len(posed) == posed[-1] + 1:
        return rows
    is_posed = np.isin(rows, posed)
    if not is_posed.all():
        lost = "no volume is felt there, painted effects go on"
        if needs_pose:
            lost = "nothing is felt there"
        text = f"body '{body.name}': its pose is no usable number; {lost}"
        counters.warn(text, int(np.count_nonzero(~is_posed)))
    return rows[is_posed]


def followed(
    rows: I64, posed: I64, animated: EffectBlock, block: AnimationBlock
) -> tuple[I64, Bool, Bool]:
    """Rows and their preceding rows (ascending), and masks of requested rows and of followers.
    Preceding rows have the effect on and a pose (in ``posed``). A follower is one sample after the
    row before."""
    count = len(block.indices)
    if count == 1:  # live: a single row follows none
        return rows, np.ones(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
    # is_before[k]: row k + 1 is requested and follows row k by one sample.
    is_requested, is_before = np.zeros(count, np.bool_), np.zeros(count + 1, np.bool_)
    is_requested[rows] = True
    levels = animated.levels[:-1]
    is_before[posed] = True
    is_before[: count - 1] &= (
        is_requested[1:]
        & (levels > 0.0)
        & np.isfinite(levels)
        & (block.indices[:-1] == block.indices[1:] - 1)
    )
    is_before[count - 1 :] = False
    all_rows = np.flatnonzero(is_requested | is_before[:-1])
    # Index -1 of row 0 reads the last element, which is always False.
    return all_rows, is_requested[all_rows], is_before[all_rows - 1]
