# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of a coarse model along the skin, sampled by the vertices of a finer model."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I32, I64
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.body.parts import RIGHT
from hfx_blender.files.atomic import atomic_file

from .mesh_edges import edges_of

_SEED_LINKS: Final = 6  # number of fine vertices linked to a coarse vertex
_SHORTEST_M: Final = 1e-9  # scipy takes a length of zero for "no edge"

_Links = tuple[I64, I64, F64]  # from, to, metres


def owners(coarse: PerceptualModel, fine: PerceptualModel) -> I32:
    """Geodesically nearest vertex of ``coarse`` for each vertex of ``fine``.

    Distances are shortest paths (Dijkstra 1959) over the edges of the fine mesh and the straight
    lines across two neighbouring triangles unfolded into a plane. A path stays in its body part,
    so the two sides of a thin limb are far from each other.

    ``coarse``, ``fine``: models of one body.

    Returns (V,) int32: ids in ``coarse``, of the same part. Left and right are exact mirror images;
    a fine vertex on the midline belongs to the midline or to the left.
    """
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import dijkstra

    left_ids, seeds = np.flatnonzero(fine.side != RIGHT), np.flatnonzero(coarse.side != RIGHT)
    links = (*_along_the_mesh(fine), *_from_seeds(coarse, seeds, fine, left_ids))
    row, column, length_m = (np.concatenate(column_) for column_ in zip(*links, strict=True))
    size = (len(fine) + len(coarse),) * 2
    # One search from all seeds; ``source`` is the nearest seed of each node.
    _, _, source = dijkstra(
        csr_array(coo_array((np.maximum(length_m, _SHORTEST_M), (row, column)), shape=size)),
        directed=False,
        indices=len(fine) + seeds,
        return_predecessors=True,
        min_only=True,
    )
    owner = np.full(len(fine), -1, np.int64)
    owner[left_ids] = source[left_ids] - len(fine)
    right = fine.side == RIGHT
    owner[right] = coarse.mirror[owner[fine.mirror[right]]]
    return owner.astype(np.int32)


def _along_the_mesh(fine: PerceptualModel) -> list[_Links]:
    """Links along edges within parts of the left half, and along the flipped diagonals."""
    points = fine.vertices.astype(np.float64)
    edges = edges_of(fine.triangles.astype(np.int64), len(fine))
    (a, b), (c, d) = edges.ends.T, edges.opposite.T
    edge = np.linalg.norm(points[b] - points[a], axis=1)
    label = np.where(fine.side == RIGHT, -1, fine.part.astype(np.int64))
    inside = (label[a] == label[b]) & (label[a] >= 0)
    (x, y), (u, v) = _apex_in_plane(points, a, b, c, edge), _apex_in_plane(points, a, b, d, edge)
    # The straight line between both apexes is a path only if it crosses the common edge.
    crossing = x + (u - x) * y / np.maximum(y + v, _SHORTEST_M)
    straight = inside & ~edges.is_border & (label[c] == label[a]) & (label[d] == label[a])
    straight &= (crossing > 0.0) & (crossing < edge)
    across = np.hypot(u - x, y + v)
    return [
        (a[inside], b[inside], edge[inside]),
        (c[straight], d[straight], across[straight]),
    ]


def _apex_in_plane(points: F64, a: I64, b: I64, apex: I64, edge: F64) -> tuple[F64, F64]:
    """Coordinates of an apex in its triangle's plane: along the edge from a, and across."""
    along, offset = points[b] - points[a], points[apex] - points[a]
    x = np.einsum("ij,ij->i", offset, along) / edge
    return x, np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - x * x, 0.0))


def _from_seeds(
    coarse: PerceptualModel, seeds: I64, fine: PerceptualModel, left_ids: I64
) -> list[_Links]:
    """Links from each coarse vertex to the nearest fine vertices of the same part."""
    from scipy.spatial import cKDTree

    links: list[_Links] = []
    for number in np.unique(coarse.part[seeds]):
        start = seeds[coarse.part[seeds] == number]
        near = left_ids[fine.part[left_ids] == number]
        count = min(_SEED_LINKS, len(near))
        tree = cKDTree(fine.vertices[near].astype(np.float64))
        length_m, nearest = tree.query(
            coarse.vertices[start].astype(np.float64), k=[*range(1, count + 1)]
        )
        links.append((len(fine) + np.repeat(start, count), near[nearest.ravel()], length_m.ravel()))
    return links


def save(coarse: PerceptualModel, fine: PerceptualModel, path: Path) -> None:
    """Write :func:`owners` with id and hash of both models as ``.npz``."""
    with atomic_file(path) as file:
        np.savez_compressed(
            file,
            owner=owners(coarse, fine).astype(np.int16),
            model=np.array([coarse.id, coarse.content_hash]),
            fine=np.array([fine.id, fine.content_hash]),
        )
