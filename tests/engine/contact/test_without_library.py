# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine without the compiled library: equal contacts, by definition."""

from __future__ import annotations

import numpy as np
import pytest
from both_ways import by_reference, needs_library
from coverage_synthetic import ball, evaluated, moved_along, placed
from distorted_scenes import load
from moving_scenes import moving_scene

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.native import library
from hfx_blender.engine.tolerance import EXACT, PAPER
from hfx_blender.engine.volume.analytic import Sphere


def _weights(modality: str) -> dict[tuple[str, int], np.ndarray]:
    """Return weights by effect and sample, for a bending, stretching and turning body among
    volumes.
    """
    model = load(f"hfx-{modality}-1")
    scene, block = moving_scene(model, 3, 0.3, 0.4)
    weights_by_sample = {}
    for run in Engine(scene, models=load, tolerance=PAPER).evaluate(block):
        for index, sample in zip(run.indices.tolist(), run, strict=True):
            weights = weights_by_sample[run.stream.effect_id, index] = np.zeros(len(model))
            weights[sample.vertices] = sample.weights
    return weights_by_sample


@needs_library
@pytest.mark.parametrize("modality", ["pressure", "temperature"])
def test_vertices_of_shipped_models_feel_the_same(modality: str) -> None:
    expected = _weights(modality)
    with by_reference():
        actual = _weights(modality)
    assert actual.keys() == expected.keys() and len(actual) > 4
    for key, weights in actual.items():
        np.testing.assert_allclose(weights, expected[key], atol=1e-6)


def test_fast_volumes_touch_between_samples() -> None:
    """A ball of 4 mm at a metre per sample through a ball of skin: contacts at entry and exit."""
    matrices = moved_along(placed(0.002, (-1.5, 0.0, 0.0)), (3.0, 0.0, 0.0), 4)
    with by_reference():
        weights, _, engine = evaluated(ball(0.1, 2), Sphere(), matrices, tolerance=EXACT)
    poles = np.flatnonzero(weights[2])
    assert not weights[[0, 1, 3]].any() and len(poles)
    places = ball(0.1, 2).vertices[poles]
    assert (np.abs(places[:, 1:]) < 0.03).all() and {*np.sign(places[:, 0])} == {-1.0, 1.0}
    assert engine.counters.vertices_posed < 20  # cells away from the path are skipped


def test_a_report_says_so_once_and_only_then() -> None:
    scene, _ = moving_scene(load("hfx-pressure-1"), 3, 0.0, 0.0)
    with by_reference():
        (note,) = Engine(scene).notes
    assert "without the compiled part" in note
    assert library.is_there() == (not Engine(scene).notes)
