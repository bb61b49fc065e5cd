# SPDX-License-Identifier: GPL-3.0-or-later
"""Consecutive runs are joined into a single run with the same samples in order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.samples import Drive, Impact, SampleRun, Stream, joined_runs

ONE, TWO = (Stream(name, "body", "pressure", "m") for name in ("one", "two"))
ORDER = (ONE, TWO)


def _run(stream: Stream, first: int, *, shared: bool = False, full: bool = False) -> SampleRun:
    """Return three samples of 2, 1 and 3 vertices; shared: the first two have equal sets."""
    random = np.random.default_rng(first)
    sizes = [2, 3] if shared else [2, 1, 3]
    total = sum(sizes)

    def values(*shape: int) -> Any:
        return random.random(shape).astype(np.float32)

    more: dict[str, Any] = {}
    if full:
        more = {
            "positions": values(total, 3),
            "velocities": values(total, 3),
            "depth_m": values(total),
            "surface": values(total, 3),
            "surface_normals": values(total, 3),
            "impact": Impact(random.random(total), values(total), values(total, 3)),
            "focus": values(3, 4),
            "drive": Drive("d", ("a", "b"), values(3, 2)),
        }
    return SampleRun(
        stream=stream,
        indices=np.arange(first, first + 3),
        times_s=np.arange(first, first + 3) / 10.0,
        levels=random.random(3),
        parameters=random.random((3, 1)),
        offsets=np.cumsum([0, *sizes]),
        vertices=np.arange(total, dtype=np.int32),
        weights=values(total),
        sets=np.array([0, 0, 1]) if shared else None,
        **more,
    )


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Impact | Drive):
        return {name: _plain(item) for name, item in vars(value).items()}
    return value


def _samples(runs: list[SampleRun]) -> list[dict[str, Any]]:
    return [{name: _plain(item) for name, item in vars(s).items()} for run in runs for s in run]


@pytest.mark.parametrize("full", [False, True])
def test_the_same_samples_come_out(full: bool) -> None:
    parts = [_run(ONE, first, full=full) for first in (0, 3, 9)]
    (whole,) = joined_runs([[part] for part in parts], ORDER)
    assert _samples([whole]) == _samples(parts)
    assert (whole.sets is None) and len(whole) == 9


def test_sets_that_are_shared_stay_so() -> None:
    parts = [_run(ONE, 0, shared=True), _run(ONE, 3), _run(ONE, 6, shared=True)]
    (whole,) = joined_runs([[part] for part in parts], ORDER)
    assert _samples([whole]) == _samples(parts)
    assert whole.set_of.tolist() == [0, 0, 1, 2, 3, 4, 5, 5, 6]


def test_streams_are_apart_and_in_order_whichever_came_first() -> None:
    blocks = [[_run(TWO, 0)], [_run(ONE, 3), _run(TWO, 3)], [_run(ONE, 6)]]
    actual = joined_runs(blocks, ORDER)
    assert [(run.stream, run.indices.tolist()) for run in actual] == [
        (ONE, [3, 4, 5, 6, 7, 8]),
        (TWO, [0, 1, 2, 3, 4, 5]),
    ]


def test_nothing_is_nothing() -> None:
    assert joined_runs([], ORDER) == [] and joined_runs([[], []], ORDER) == []


@pytest.mark.parametrize("name", ["depth_m", "impact", "drive"])
def test_changes_within_a_stream_are_refused(name: str) -> None:
    one, two = _run(ONE, 0, full=True), _run(ONE, 3, full=True)
    with pytest.raises(ValueError, match="what its samples carry changes"):
        joined_runs([[one], [replace(two, **{name: None})]], ORDER)
