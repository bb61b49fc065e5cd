# SPDX-License-Identifier: GPL-3.0-or-later
"""Editing of painted areas, on the shipped models and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body import areas
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT

MODEL = load_model("hfx-pressure-1")
FINE = load_model("hfx-vibration-1")
COARSE = load_model("hfx-temperature-1")


def on_part(model, part: str) -> np.ndarray:
    return (model.part == PARTS.index(part)).astype(np.float64)


def neighbours(model, vertex: int) -> set[int]:
    return {int(v) for t in model.triangles if vertex in t for v in t}


def test_growing_a_vertex_reaches_exactly_its_neighbours():
    weights = np.zeros(len(MODEL))
    weights[4000] = 0.7
    grown = areas.grow(MODEL, weights)
    assert set(np.flatnonzero(grown).tolist()) == neighbours(MODEL, 4000)
    assert set(grown[grown > 0]) == {0.7}


@given(seed=st.integers(0, 2**31), steps=st.integers(1, 3))
@settings(max_examples=15, deadline=None)
def test_shrinking_undoes_no_more_than_growing_did(seed, steps):
    weights = np.round(np.random.default_rng(seed).random(len(COARSE)))
    closed = areas.shrink(COARSE, areas.grow(COARSE, weights, steps), steps)
    opened = areas.grow(COARSE, areas.shrink(COARSE, weights, steps), steps)
    assert (closed >= weights).all() and (opened <= weights).all()


def test_smoothing_keeps_constants_and_softens_edges():
    even = np.full(len(MODEL), 0.4)
    assert areas.smooth(MODEL, even, 3) == pytest.approx(even)
    hand = on_part(MODEL, "hand_palm")
    soft = areas.smooth(MODEL, hand, 4)
    assert soft.min() >= 0.0 and soft.max() <= 1.0
    first, second = MODEL.triangles[:, 0], MODEL.triangles[:, 1]
    assert np.abs(soft[first] - soft[second]).max() < np.abs(hand[first] - hand[second]).max()


def test_mirroring_twice_is_nothing_and_sides_change():
    weights = on_part(MODEL, "forearm") * (MODEL.side == LEFT)
    flipped = areas.mirrored(MODEL, weights)
    assert np.array_equal(
        np.flatnonzero(flipped), np.flatnonzero(on_part(MODEL, "forearm") * (MODEL.side == RIGHT))
    )
    assert np.array_equal(areas.mirrored(MODEL, flipped), weights)


def test_symmetrising_copies_one_side_and_keeps_the_middle():
    rng = np.random.default_rng(0)
    weights = rng.random(len(MODEL))
    actual = areas.symmetric(MODEL, weights, LEFT)
    own = MODEL.side != RIGHT
    assert np.array_equal(actual[own], weights[own])
    assert np.array_equal(actual, actual[MODEL.mirror])


def test_blends_by_hand():
    first, second = np.array([0.0, 0.5, 0.9]), np.array([0.3, 0.5, 0.9])
    assert areas.blended(first, second, "replace").tolist() == [0.3, 0.5, 0.9]
    assert areas.blended(first, second, "add") == pytest.approx([0.3, 1.0, 1.0])
    assert areas.blended(first, second, "subtract") == pytest.approx([0.0, 0.0, 0.0])
    assert areas.blended(first, second, "multiply") == pytest.approx([0.0, 0.25, 0.81])
    with pytest.raises(ValueError, match="replace, add"):
        areas.blended(first, second, "xor")  # type: ignore[arg-type]


@pytest.mark.parametrize("target", [MODEL, COARSE, FINE], ids=["same", "coarse", "fine"])
def test_a_whole_part_stays_whole_on_another_model(target):
    for part in ("torso", "hand_palm", "forearm"):
        actual = areas.transferred(MODEL, on_part(MODEL, part), target)
        assert actual == pytest.approx(on_part(target, part))


def test_a_patch_keeps_its_place_and_roughly_its_area():
    centre = np.array([0.0, 0.03, 1.2])
    weights = (np.linalg.norm(MODEL.vertices - centre, axis=1) < 0.1).astype(float)
    actual = areas.transferred(MODEL, weights, FINE)
    area = weights @ MODEL.areas_m2
    assert actual @ FINE.areas_m2 == pytest.approx(area, rel=0.1)
    middle = (actual * FINE.areas_m2) @ FINE.vertices / (actual @ FINE.areas_m2)
    expected = (weights * MODEL.areas_m2) @ MODEL.vertices / area
    assert np.linalg.norm(middle - expected) < 0.005


def test_an_image_is_read_between_its_pixels_by_hand():
    pixels = np.array([[0.0, 1.0], [0.5, 0.25]])
    uv = np.array([[0.25, 0.25], [0.75, 0.25], [0.5, 0.25], [0.25, 0.5], [1.25, 0.25], [np.nan, 0]])
    # The last column repeats into the first: half way over the edge is half of both.
    assert areas.from_image(pixels, uv) == pytest.approx([0.0, 1.0, 0.5, 0.25, 0.0, 0.0])
    assert areas.from_image(pixels, np.array([[1.0, 0.25]])) == pytest.approx([0.5])


def test_cells_of_a_small_model_by_hand():
    # Six vertices on a line, of areas 1, 1, 2, 1, 1, 1; the coarse model has one at 1 m and 11 m.
    fine = replace(
        MODEL,
        vertices=np.array([(x, 0, 0) for x in (0, 1, 2, 10, 11, 12)], np.float32),
        part=np.zeros(6, MODEL.part.dtype),
        areas_m2=np.array([1, 1, 2, 1, 1, 1], np.float32),
    )
    coarse = replace(fine, vertices=fine.vertices[[1, 4]], part=fine.part[:2])
    moved = areas.transferred(fine, np.array([1.0, 0.0, 0.5, 0.0, 0.0, 0.0]), coarse)
    assert moved == pytest.approx([(1 * 1 + 1 * 0 + 2 * 0.5) / 4, 0.0])
    # One painted vertex of three at 11 m: a third of the cell, and nothing at 1 m.
    moved = areas.transferred(fine, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.9]), coarse)
    assert moved == pytest.approx([0.0, 0.3])
