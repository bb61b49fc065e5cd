# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts of the compiled library on whole bodies, and placement of volumes."""

from __future__ import annotations

import numpy as np
import pytest
from both_ways import by_reference, needs_library
from distorted_scenes import load
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from moving_scenes import SHAPES, moving_scene

from hfx_blender.engine.active_rows import FARTHEST
from hfx_blender.engine.contact import compiled_contacts
from hfx_blender.engine.contact.compiled_target import PlacedTarget
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.tolerance import PAPER, PREVIEW, STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.shape import Falloff, inverse_placement, world_bounds

pytestmark = needs_library

FINE = Tolerance("fine", 0.001, 0.25, 0.002, 0.0)  # strength is never taken to be even
TOLERANCES = (PREVIEW, STANDARD, PAPER, FINE)
FLAT = Falloff(), 0.0


def samples_and_counts(scene, block, tolerance):
    """Return all samples, and the engine's counters of volumes."""
    engine = Engine(scene, models=load, tolerance=tolerance)
    runs = engine.evaluate(block)
    rows = {
        run.stream.effect_id: [
            (round(100.0 * sample.time_s), sample.vertices.tolist(), sample.weights.tolist())
            for sample in run
        ]
        for run in runs
    }
    return rows, (engine.counters.volume_tests, engine.counters.clusters_tested)


def weights_at(time, rows):
    return {
        v: w
        for t, vertices, weights in rows
        if t == time
        for v, w in zip(vertices, weights, strict=True)
    }


@pytest.mark.parametrize("modality", ["temperature", "pressure"])
@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(
    seed=st.integers(0, 2**31), strength=st.floats(0.0, 0.6), speed=st.sampled_from([0.0, 0.1, 1.0])
)
@example(seed=2358, strength=0.32276461900142983, speed=1.0)  # a vertex on the boundary
def test_whole_bodies_agree_with_the_reference(modality, seed, strength, speed):
    """Compares vertex by vertex; many clusters, some within reach of the volumes."""
    scene, block = moving_scene(load(f"hfx-{modality}-1"), seed, strength, speed)
    actual, counted = samples_and_counts(scene, block, PAPER)
    with by_reference():
        expected, others = samples_and_counts(scene, block, PAPER)
    assert counted[0] == others[0] and actual.keys() == expected.keys()
    for name, rows in actual.items():
        for time in {row[0] for row in (*rows, *expected[name])}:
            first, second = weights_at(time, rows), weights_at(time, expected[name])
            # Vertices on either side of a boundary by rounding have a negligible weight.
            vertices = first.keys() | second.keys()
            np.testing.assert_allclose(
                [first.get(v, 0.0) for v in vertices],
                [second.get(v, 0.0) for v in vertices],
                *(0, 2e-7),
                err_msg=f"{name} at {time}",
            )


def test_the_library_was_asked(monkeypatch):
    """Guards the test above against comparing the reference with itself."""
    scene, block = moving_scene(load("hfx-pressure-1"), 3, 0.3, 0.1)
    calls = []
    begin = compiled_contacts.begin
    monkeypatch.setattr(compiled_contacts, "begin", lambda *a: calls.append(1) or begin(*a))
    samples_and_counts(scene, block, PAPER)
    assert calls
    calls.clear()
    with by_reference():
        samples_and_counts(scene, block, PAPER)
    assert not calls


numbers = st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1e-9, 1e9, 1e12, 1e13, np.nan, np.inf])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(numbers, min_size=12, max_size=12),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from(SHAPES),
)
def test_places_are_those_of_numpy(entries, scale, shape):
    matrix = np.eye(4)
    matrix[:3] = np.reshape(entries, (3, 4))
    matrix[:3, :3] *= scale
    body = np.eye(4)
    body[:3, 3] = 1.0, 2.0, 3.0
    with np.errstate(all="ignore"):
        inverse, usable = inverse_placement(matrix[None])
        usable = usable & (np.abs(matrix) <= FARTHEST).all()
    # The volume stands, and is another at first; only some rows are asked for.
    matrices, shapes = np.repeat(matrix[None], 4, 0), (Sphere(), shape)
    which = np.array([0, 1, 1, 1], np.int32)
    placed_target = PlacedTarget(
        shapes, which, matrices, np.repeat(body[None], 4, 0), np.array([1, 3]), *FLAT, FARTHEST
    )
    assert (placed_target.is_usable == usable[0]).all()
    if usable[0]:
        size, boxes = np.abs(inverse).max(), world_bounds(shape, matrix[None])
        expected = inverse @ body
        # The last column of an inverse sums products with the position; such products may cancel
        # out.
        columns = np.array([1.0, 1.0, 1.0, max(1.0, np.abs(matrix[:3, 3]).max())])
        for part, value, near in (
            ("to_shape", inverse, 1e-12 * size * columns),
            ("body_to_shape", expected, 1e-11 * size * columns),
            ("boxes", boxes, 1e-12 * np.abs(boxes).max()),
            ("matrices", matrix, 0.0),
            ("to_world", body, 0.0),
            ("turns", 0.0, 0.0),
        ):
            given = placed_target.part(part)
            value = np.broadcast_to(value, given.shape)
            assert (np.abs(given - value) <= near + 1e-9 * np.abs(value)).all(), part


def test_shapes_and_rows_that_are_not_there_are_refused():
    matrices = np.repeat(np.eye(4)[None], 2, 0)
    for which in (-1, 1):
        shape_index, rows = np.full(2, which, np.int32), np.array([0])
        placed_target = PlacedTarget(
            (Sphere(),), shape_index, matrices, matrices, rows, *FLAT, FARTHEST
        )
        assert not placed_target.is_usable.any()
    for row in (-1, 2):
        rows = np.array([row])
        with pytest.raises(IndexError, match="of a block of 2"):
            PlacedTarget((Sphere(),), None, matrices, matrices, rows, *FLAT, FARTHEST)
