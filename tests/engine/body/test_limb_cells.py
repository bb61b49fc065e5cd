# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances along the skin between temperature cells of the limbs, and why they cannot be even."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body.levels_and_cells import cell_of_skin
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.skin_distance import SkinDistances, edge_graph

ROOT = Path(__file__).resolve().parents[3]
TARGET_MM = 150.0


def measured(part: str) -> tuple[np.ndarray, np.ndarray]:
    """Distances along the skin (n,) between vertices of one side whose cells touch, and upper
    bounds: the shortest ways over edges of the pressure mesh, millimetres."""
    from scipy.sparse.csgraph import dijkstra

    model, fine = load_model("hfx-temperature-1"), load_model("hfx-pressure-1")
    _, cell = cell_of_skin(model)
    skin = SkinDistances(fine.vertices, fine.triangles)
    graph = edge_graph(fine.vertices, fine.triangles)
    corners = fine.triangles
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = np.unique(np.sort(cell[edges], axis=1), axis=0)
    mine = model.part == PARTS.index(part)
    mine &= model.side == model.side[mine].max()
    distances, bounds = [], []
    for first, second in pairs[(pairs[:, 0] != pairs[:, 1]) & mine[pairs].all(axis=1)]:
        start, end = (skin.nearest(model.vertices[k].astype(float)) for k in (first, second))
        ids, ways = skin.around(start, 0.4)
        ends = ways[np.searchsorted(ids, end.corners)]
        distances.append(1000.0 * float(end.weights @ ends))
        over_edges = dijkstra(graph, directed=False, indices=start.corners, limit=0.5)
        to_corner = np.linalg.norm(fine.vertices[start.corners] - start.point, axis=1)
        longest = (over_edges[:, end.corners] + to_corner[:, None]).min(axis=0)
        bounds.append(1000.0 * float(end.weights @ longest))
    return np.array(distances), np.array(bounds)


@pytest.mark.parametrize("part", ["upper_arm", "forearm", "lower_leg", "foot_dorsum"])
def test_the_page_has_the_distances_along_the_skin(part: str) -> None:
    page = (ROOT / "docs" / "body-models.md").read_text(encoding="utf-8")
    section = page.partition("### Temperature on the limbs")[2]
    row = next(r for r in section.splitlines() if r.startswith(f"| {part.replace('_', ' ')} |"))
    pairs, mean, spread = (float(cell) for cell in row.split("|")[3:6])
    distances, bounds = measured(part)
    assert len(distances) == pairs
    assert distances.mean() == pytest.approx(mean, abs=1.0)
    assert distances.std() == pytest.approx(spread, abs=1.0)
    # Ways over edges are never shorter, and on such a mesh at most a seventh longer.
    assert (distances <= bounds + 0.5).all() and (distances >= bounds / 1.15).all()


def test_an_even_net_closes_only_around_some_girths() -> None:
    """Lengths of the vectors of a triangular lattice, a^2 + ab + b^2."""
    girths = {
        round(TARGET_MM * np.sqrt(a * a + a * b + b * b)) for a in range(4) for b in range(4)
    } - {0}
    assert sorted(girths)[:5] == [150, 260, 300, 397, 450]
    page = (ROOT / "docs" / "body-models.md").read_text(encoding="utf-8")
    assert "150, 260, 300, 397 and 450 mm" in page.replace("\n", " ")
