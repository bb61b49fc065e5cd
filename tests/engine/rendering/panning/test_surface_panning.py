# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning along the skin of the shipped pressure model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model, manifest
from hfx_blender.engine.body.parts import PARTS, SIDES
from hfx_blender.engine.rendering.panning.surface_panning import MAX_SPAN_M, surface_gains


@pytest.fixture(scope="module")
def model():
    shipped = manifest()["models"].items()
    return load_model(next(id for id, item in shipped if item["modality"] == "pressure"))


def vertex_near(model, part: str, side: str, *point: float) -> int:
    own = np.flatnonzero((model.part == PARTS.index(part)) & (model.side == SIDES.index(side)))
    return int(own[np.argmin(np.linalg.norm(model.vertices[own] - point, axis=1))])


def back(model, rows: int = 3, columns: int = 4) -> np.ndarray:
    """Return a grid on the back, 7 cm apart."""
    torso = np.flatnonzero((model.part == PARTS.index("torso")) & (model.normals[:, 1] > 0.5))
    places = [
        ((c - (columns - 1) / 2) * 0.07, 1.15 + r * 0.07)
        for r in range(rows)
        for c in range(columns)
    ]
    flat = model.vertices[torso][:, [0, 2]]
    return np.array([torso[np.argmin(np.linalg.norm(flat - p, axis=1))] for p in places])


def test_below_an_actuator_only_that_actuator_plays(model):
    anchors = back(model)
    actual = surface_gains(model, anchors, "linear")
    at = np.searchsorted(actual.vertices, anchors)
    assert actual.gains[at] == pytest.approx(np.eye(len(anchors)), abs=1e-6)


def test_between_actuators_shares_sum_to_one_and_glide(model):
    anchors = back(model)
    actual = surface_gains(model, anchors, "linear")
    inside = actual.gains.sum(axis=1) > 0.999
    assert np.count_nonzero(inside) > 100
    assert actual.gains.sum(axis=1).max() == pytest.approx(1.0)
    # The centroid of gains follows the vertex, up to the body's curvature under flat triangles.
    torso = model.vertices[actual.vertices].astype(float)
    middle = np.linalg.norm(torso[:, [0, 2]] - [0.0, 1.22], axis=1) < 0.05
    samples = actual.gains[middle] @ model.vertices[anchors].astype(float)
    assert np.linalg.norm((samples - torso[middle])[:, [0, 2]], axis=1).max() < 0.006


def test_neighbouring_vertices_have_neighbouring_gains(model):
    actual = surface_gains(model, back(model), "linear")
    dense = np.zeros((len(model), actual.gains.shape[1]))
    dense[actual.vertices] = actual.gains
    a, b = model.triangles[:, 0], model.triangles[:, 1]
    step = np.linalg.norm(model.vertices[a] - model.vertices[b], axis=1)
    slope = np.abs(dense[a] - dense[b]).max(axis=1) / step
    assert slope.max() < 2.5 / 0.06  # 70 mm grid: 1 / height is 16 per metre, more on bent skin


def fingertips(model) -> list[int]:
    """Return the vertex farthest from the palm on each long finger of the left hand."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    palm = model.vertices[model.part == PARTS.index("hand_palm")]
    away = np.linalg.norm(model.vertices - palm[palm[:, 0] > 0].mean(axis=0), axis=1)
    is_finger = (model.part == PARTS.index("fingers")) & (model.side == SIDES.index("left"))
    is_end = is_finger & (away > 0.75 * away[is_finger].max())
    a, b = model.triangles[is_end[model.triangles].all(axis=1)][:, :2].T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(model),) * 2)
    _, piece = connected_components(graph, directed=False)
    pieces = [np.flatnonzero((piece == label) & is_end) for label in np.unique(piece[is_end])]
    return [int(piece[np.argmax(away[piece])]) for piece in pieces if len(piece) > 20]


def test_nothing_is_joined_through_the_air(model):
    """Pairs: neighbouring fingertips, wrist and thigh, arm and chest."""
    tips = fingertips(model)
    assert len(tips) == 4
    chest = vertex_near(model, "torso", "left", 0.15, 0.0, 1.3)
    arm = vertex_near(model, "upper_arm", "left", 0.2, 0.0, 1.3)
    anchors = np.array([*tips, chest, arm])
    actual = surface_gains(model, anchors, "linear")
    joined = {tuple(sorted(set(s))) for s in actual.simplices.tolist()}
    assert not any({4, 5} <= set(s) for s in joined)
    assert not any(len({*s} & {0, 1, 2, 3}) > 1 for s in joined)


def test_no_neighbours_are_farther_apart_than_the_limit(model):
    rng = np.random.default_rng(4)
    anchors = rng.choice(len(model), 60, replace=False)
    actual = surface_gains(model, anchors, "linear")
    for simplex in actual.simplices:
        corners = model.vertices[anchors[simplex]]
        assert np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max() <= MAX_SPAN_M
        limbs = {
            (PARTS[model.part[anchors[i]]] in ("torso", "head"), int(model.side[anchors[i]]))
            for i in simplex
            if PARTS[model.part[anchors[i]]] not in ("torso", "head")
        }
        assert len(limbs) <= 1


def test_a_lone_actuator_fades_out_along_the_skin(model):
    anchor = back(model)[5]
    actual = surface_gains(model, np.array([anchor]), "linear")
    distance = np.linalg.norm(model.vertices[actual.vertices] - model.vertices[anchor], axis=1)
    assert actual.gains[np.argmin(distance)] == pytest.approx(1.0)
    assert distance.max() <= MAX_SPAN_M / 2
    assert set(model.part[actual.vertices]) == {PARTS.index("torso")}


def test_two_actuators_share_a_vertex(model):
    anchor = back(model)[5]
    actual = surface_gains(model, np.array([anchor, anchor]), "linear")
    at = np.searchsorted(actual.vertices, anchor)
    assert actual.gains[at] == pytest.approx([0.5, 0.5])


def folded_sheet(model, angle: float):
    """Return a sheet on the torso, folded along the middle; (21, 11) vertices 1 cm apart."""
    u, v = np.meshgrid(np.linspace(-0.1, 0.1, 21), np.linspace(0.0, 0.1, 11), indexing="ij")
    u, v = u.ravel(), v.ravel()
    c, s = np.cos(angle), np.sin(angle)
    corner = np.arange(21 * 11).reshape(21, 11)
    quads = (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
    a, b, d, e = (quad.ravel() for quad in quads)
    return replace(
        model,
        vertices=np.column_stack((u * c, v, np.abs(u) * s)).astype(np.float32),
        triangles=np.concatenate([np.column_stack((a, b, d)), np.column_stack((a, d, e))]),
        normals=np.column_stack((-np.sign(u) * s, 0 * u, c + 0 * u)).astype(np.float32),
        part=np.full(len(u), PARTS.index("torso"), np.uint8),
        side=np.full(len(u), SIDES.index("left"), np.uint8),
    )


def test_skin_that_sees_itself_across_a_fold_is_not_joined(model):
    """Two points 6 cm from a fold: the path along the skin is only a third longer than through the
    air.
    """
    anchors = np.array([4 * 11 + 5, 16 * 11 + 5])
    flat = surface_gains(folded_sheet(model, 0.0), anchors, "linear")
    assert {0, 1} in [set(simplex) for simplex in flat.simplices.tolist()]
    folded = surface_gains(folded_sheet(model, np.radians(40.0)), anchors, "linear")
    assert {0, 1} not in [set(simplex) for simplex in folded.simplices.tolist()]
