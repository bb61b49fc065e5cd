# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of a body and a volume at rest: found once, and counted as often as they occur."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from both_ways import by_reference, needs_library
from coverage_synthetic import ball, evaluated, placed
from distorted_scenes import load
from moving_scenes import moving_scene

from hfx_blender.engine.contact import contacts
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.scene import AnimationBlock, PoseBlock, SceneDescription
from hfx_blender.engine.tolerance import EXACT, PAPER, STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Sphere

STAYS = np.array([1, 3, 2, 4, 1, 5])
"""Number of samples at each of the six stops of a moving scene."""


@needs_library
@pytest.mark.parametrize("tolerance", [PAPER, STANDARD, EXACT], ids=lambda each: each.name)
def test_samples_at_rest_equal_the_definition_and_are_evaluated_once(tolerance: Tolerance) -> None:
    """A ball passes through skin, rests half inside, leaves fast, and rests again."""
    stops = [(-0.3, 1), (0.3, 3), (-0.09, 6), (0.3, 1), (0.08, 2), (0.0801, 5)]
    places = [x for x, count in stops for _ in range(count)]
    matrices = np.stack([placed(0.03, (x, 0.0, 0.0)) for x in places])
    weights, _, engine = evaluated(ball(0.1, 2), Sphere(), matrices, tolerance=tolerance)
    with by_reference():
        expected, _, _ = evaluated(ball(0.1, 2), Sphere(), matrices, tolerance=tolerance)
    allowed = 0.01 if tolerance is STANDARD else 1e-6
    np.testing.assert_allclose(weights, expected, atol=allowed)
    assert weights[6].any() and weights[-1].any()
    # 34 more samples at rest need no further posing.
    longer = np.concatenate([matrices, np.repeat(matrices[-1:], 34, 0)])
    more, _, later = evaluated(ball(0.1, 2), Sphere(), longer, tolerance=tolerance)
    np.testing.assert_array_equal(more[len(matrices) :], np.repeat(weights[-1:], 34, 0))
    assert later.counters.vertices_posed == engine.counters.vertices_posed > 0


def _resting(seed: int, history: int) -> tuple[SceneDescription, AnimationBlock]:
    """Return a scene whose body and volumes rest at each stop; one volume is flattened."""
    scene, block = moving_scene(load("hfx-pressure-1"), seed, 0.4, 0.5)
    rows = np.repeat(np.arange(len(STAYS)), STAYS)
    if history:
        rows = np.concatenate([rows[:1], rows])

    def at_rest(item: Any) -> Any:
        columns = {field.name: getattr(item, field.name) for field in fields(item)}
        arrays = {n: c[rows].copy() for n, c in columns.items() if isinstance(c, np.ndarray)}
        return replace(item, **arrays)

    (pose,) = block.poses
    resting: PoseBlock = at_rest(pose)
    effects = [at_rest(effect) for effect in block.effects]
    effects[1].matrices[4:12, :3, 0] = 0.0
    return scene, AnimationBlock(np.arange(len(rows)), tuple(effects), (resting,), history)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    return value


@needs_library
@pytest.mark.parametrize("tolerance", [PAPER, STANDARD], ids=lambda each: each.name)
@pytest.mark.parametrize("seed", range(4))
def test_resting_samples_change_no_bit_and_no_count(
    seed: int, tolerance: Tolerance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Warnings count each sample of a flattened volume at rest, as without shared contacts."""
    scene, block = _resting(seed, seed % 2)

    def found() -> tuple[list[Any], dict[str, Any]]:
        engine = Engine(scene, tolerance=tolerance)
        runs = engine.evaluate(block)
        columns = [_plain(getattr(run, f.name)) for run in runs for f in fields(run)]
        return columns, engine.counters.as_dict()

    shared, counts = found()
    monkeypatch.setattr(contacts, "_copies", lambda query: np.zeros(len(query.rows), np.bool_))
    alone, every = found()
    assert shared == alone and counts["contacts"] > 0
    assert 0 < counts.pop("vertices_posed") < every.pop("vertices_posed")
    assert counts == every
    assert sum(counts["flattened"].values()) == 8
