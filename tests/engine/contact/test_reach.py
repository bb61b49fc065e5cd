# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes clear of a body during a whole block are skipped, without effect on contacts."""

from __future__ import annotations

import numpy as np
import pytest
from coverage_synthetic import evaluated, placed, rigid, sheet

from hfx_blender.engine.contact import broad_phase
from hfx_blender.engine.contact.reachable_bounds import ReachableBounds
from hfx_blender.engine.volume.analytic import Cuboid, Sphere


def _turned(angle: float) -> np.ndarray:
    matrix = np.eye(4)
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix[0, [0, 2]], matrix[2, [0, 2]] = (cosine, sine), (-sine, cosine)
    return matrix


def _rod(angle: float) -> np.ndarray:
    """Return a motion by half a metre to both sides, turning about Y, 0.3 m above the sheet."""
    matrix = _turned(angle) @ np.diag([0.5, 0.02, 0.02, 1.0])
    matrix[2, 3] = 0.3
    return matrix


def _both_ways(monkeypatch: pytest.MonkeyPatch, *arguments, **options) -> tuple:
    actual = []
    for fewest in (1, 10**9):
        monkeypatch.setattr(broad_phase, "FEWEST_PAIRS", fewest)
        actual.append(evaluated(sheet(), *arguments, **options))
    assert (actual[0][0] == actual[1][0]).all()
    return actual[0]


def test_a_volume_near_by_rotation_only_is_included(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    matrices = np.stack([_rod(0.0), _rod(np.radians(170.0))])
    weights, _, _ = _both_ways(monkeypatch, Cuboid(), matrices)
    assert not weights[0].any() and weights[1].any()


def test_a_volume_passing_between_two_samples_is_included(monkeypatch: pytest.MonkeyPatch) -> None:
    matrices = np.stack([placed(0.05, (0.0, 0.0, z)) for z in (2.0, -2.0)])
    weights, _, _ = _both_ways(monkeypatch, Sphere(), matrices)
    assert not weights[0].any() and weights[1].any()


def test_a_volume_hit_by_a_swinging_body_is_included(monkeypatch: pytest.MonkeyPatch) -> None:
    posed = rigid(2, np.stack([_turned(angle) for angle in np.radians([-80.0, 80.0])]))
    posed.bones[..., 2, 3] = -1.0  # the skin hangs a metre below the pivot
    matrices = np.stack([placed(0.05, (0.0, 0.0, -1.0))] * 2)
    weights, _, _ = _both_ways(monkeypatch, Sphere(), matrices, posed=posed)
    assert not weights[0].any() and weights[1].any()


def test_no_cluster_is_bounded_for_a_volume_that_stays_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    matrices = np.stack([placed(0.1, (0.0, 0.0, z)) for z in (0.5, 0.6, 0.7)])
    _, runs, engine = _both_ways(monkeypatch, Sphere(), matrices)
    assert runs == []
    monkeypatch.setattr(broad_phase, "FEWEST_PAIRS", 1)
    _, _, engine = evaluated(sheet(), Sphere(), matrices)
    assert (engine.counters.volume_tests, engine.counters.clusters_tested) == (3, 0)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_degenerate_volume_is_reported_at_any_position(
    value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrices = np.stack([placed(0.1, (0.0, 0.0, 9.0))] * 3)
    matrices[1, 0, 0] = value
    _, _, engine = _both_ways(monkeypatch, Sphere(), matrices)
    assert list(engine.counters.flattened.values()) == [1]


def test_a_row_that_is_no_place_hides_no_other_of_its_cluster() -> None:
    low = np.zeros((2, 1, 3))
    low[0] = np.nan
    bounds = ReachableBounds.around(np.arange(2), low, low + 1.0)
    assert bounds.of_clusters.tolist() == [[[0.0] * 3, [1.0] * 3]]
