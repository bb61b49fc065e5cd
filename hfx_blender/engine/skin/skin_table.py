# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin of a model in flat arrays by cluster, filled on demand.

A *unit* is a vertex of the skin with the *quads* next to the vertex, one of each adjacent triangle.
A quad has the corners vertex, point on an edge, point inside, point on the other edge. These points
divide edges and triangles in proportion to cell sizes, so that skin next to a much finer neighbour
belongs to the coarser cell. A quad is sampled at ``steps`` by ``steps`` points, at more where a
pose stretches the quad.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F32, F64, I32, I64, missing_ids, sorted_by
from ..body.model import PerceptualModel
from ..native.cluster_bounds import cut
from ..native.library import loaded, structure
from ..tolerance import Tolerance

_LEAST_SHARE: Final = 0.01  # fraction of a unit always represented by the vertex, at any tolerance
_EXTENT: Final = 7  # float64 elements of the C structure ``extent``


class SkinTable:
    """Skin of a model's cells. A *place* is a vertex of the skin within a cluster.

    The places of a cluster are its units, in the order of their cells, then the corners around the
    units. Memory is used only by clusters filled by :meth:`need`.

    Arguments: ``surface``, the model with the triangles of the skin; for each cluster ``cells``,
    vertices (C,) of the perceptual model, and ``outlines``, vertices (n,) of the skin: units, then
    corners around them; for each vertex of the skin ``owner``, the vertex of the perceptual model
    with the cell around it, and ``distance`` and ``finest``, largest and smallest distance of skin
    at rest from its sample, metres; ``is_split``, False if the vertex is the only sample of a unit;
    ``tolerance`` of posed skin.

    Attributes
    ----------
    starts, place_counts : (clusters + 1,), (clusters,) int64
        First place, and number of places, of each cluster.
    unit_counts, cell_starts : (clusters,), (clusters + 1,) int64
        Number of units of each cluster, and its first cell in the order of clusters.
    is_simple : bool
        True if each cell is one unit.
    vertices : (P,) int32
        Vertex of the skin at each place.
    cell_of, unit_shares, vertex_shares, reaches, means : (P,)
        For each unit: cell; fraction of the cell's area; fraction represented by the sample at the
        vertex; largest and mean extent of its skin as a fraction of the way to the farthest corner.
    quad_starts, unit_of, around : (P + 1,), (Q,) int64, (Q, 2) int32
        First quad of each unit; unit of each quad, and places of the two other corners of its
        triangle.
    is_ringed : (P,) uint8
        1 if the first of these corners already are all neighbours of a unit.
    steps, finest, wholes, heights, diagonals, sample_starts : (Q,)
        For each quad: samples along each side at rest, and the most in any pose; fraction of the
        cell's area of all samples; largest bulge of the triangle, as a share of its normal; bound
        of the size of the quad's parts, see ``hfx_longest``; first sample in the cluster's array.
    quads : (Q, 10) float64
        Placement of the samples of each quad: fractions of the ways to both other corners for its
        points on the two edges, then both for its inner point; area of a sample as a fraction of
        the cell's, with derivatives along both sides; bulges of the triangle's edges (0 if
        ignored).
    most_samples, largest_cell : (clusters,), int
        Largest number of samples of a cell in each cluster, and of a filled cell.
    samples : dict of (4, S) float64
        For each filled cluster, placement of the samples of all clusters filled at the same time:
        barycentric fractions towards both other corners; height relative to the size of the
        triangle; fraction of the cell's area.
    blocks, rooms : (clusters,) int64
        For each filled cluster, address of the array of samples, and its number S.
    """

    def __init__(
        self,
        surface: PerceptualModel,
        cells: list[I32],
        outlines: list[I32],
        owner: I32,
        distance: F64,
        finest: F64,
        is_split: bool,
        tolerance: Tolerance,
    ) -> None:
        self.surface, self.mesh = surface, SkinMesh.of(surface)
        self._distances, self.is_split = np.stack([distance, finest]), is_split
        self.spacing_share, self.distance_m = tolerance.spacing_share, tolerance.distance_m
        self._most_share = max(tolerance.amplitude, _LEAST_SHARE)
        self.cells = np.concatenate(cells)
        counts = np.bincount(owner, minlength=len(self.cells)).astype(np.int64, copy=False)
        self.starts = np.cumsum([0, *(len(places) for places in outlines)], dtype=np.int64)
        self.place_counts = np.diff(self.starts)
        self.cell_starts = np.cumsum([0, *(len(ids) for ids in cells)], dtype=np.int64)
        self.unit_counts = np.add.reduceat(counts[self.cells], self.cell_starts[:-1])
        self.is_simple = len(self.cells) == int(self.unit_counts.sum())
        self.vertices = np.concatenate(outlines)
        total = len(self.vertices)
        self._is_made = np.zeros(len(cells), np.bool_)
        self._cluster = np.repeat(np.arange(len(cells)), np.diff(self.starts))

        # The first places of a cluster are its units, in the order of the cells.
        is_unit = np.arange(total) - self.starts[self._cluster] < self.unit_counts[self._cluster]
        self.cell_of = np.zeros(total, np.int64)
        self.cell_of[is_unit] = np.repeat(np.arange(len(self.cells)), counts[self.cells])
        # A unit has a quad in each triangle around its vertex; without a split no quads.
        numbers = np.where(is_unit & is_split, np.diff(self.mesh.starts)[self.vertices], 0)
        self.quad_starts = np.concatenate([[0], np.cumsum(numbers, dtype=np.int64)])
        quads = int(self.quad_starts[-1])
        self.unit_shares, self.vertex_shares = np.zeros(total), np.zeros(total)
        self.reaches = np.zeros(total)
        self.means, self.is_ringed = np.zeros(total), np.zeros(total, np.uint8)
        self.unit_of, self.around = np.zeros(quads, np.int64), np.zeros((quads, 2), np.int32)
        self.steps, self.finest = np.zeros((2, quads), np.int32)
        self.wholes, self.heights, self.diagonals = np.zeros((3, quads))
        self.sample_starts, self.quads = np.zeros(quads, np.int64), np.zeros((quads, 10))
        self.most_samples = np.ones(len(cells), np.int64)
        self.largest_cell = 1
        self.samples: dict[int, F64] = {}
        self.blocks, self.rooms = np.zeros((2, len(cells)), np.int64)

    def need(self, clusters: I64) -> None:
        """Fill clusters not filled before; ``clusters`` are ids in any order. Updates the arrays in
        place, and adds an array of samples."""
        new = missing_ids(self._is_made, clusters)
        if not len(new):
            return
        samples = np.empty((4, self._fill(new)))
        loaded().hfx_place_samples(self.structure, len(new), new, samples, samples.shape[1])
        self.samples.update(dict.fromkeys(new.tolist(), samples))
        self._is_made[new] = True
        self.largest_cell = int(self.most_samples.max())

    def _fill(self, clusters: I64) -> int:
        """Fill in tables of clusters (k,), ascending, without samples; returns the sample count."""
        first = self.starts[clusters]
        quads = self.quad_starts[first + self.unit_counts[clusters]] - self.quad_starts[first]
        cells = int((self.cell_starts[clusters + 1] - self.cell_starts[clusters]).max())
        # Work space for the largest cluster.
        rooms = (
            *np.zeros((2, len(self.mesh.vertices)), np.int64),
            np.empty((int(quads.max()), _EXTENT)),
            np.empty(int(self.unit_counts[clusters].max())),
            np.empty(cells),
            np.empty(cells, np.int64),
        )
        spacing = structure("hfx_spacing")(*self._spacing, self._most_share)
        shared = self.structure, self.mesh.structure, spacing
        count: int = loaded().hfx_fill(*shared, len(clusters), clusters, *rooms)
        return count

    @cached_property
    def structure(self) -> Any:
        """``hfx_table`` of these arrays, valid as long as the table lives."""
        kind = structure("hfx_table")
        known = kind(*(getattr(self, name) for name, _ in kind._fields_))
        # Work space of the largest cluster, float64 elements; see ``hfx_narrow_phase``.
        rooms = 12 * self.place_counts + 7 * self.unit_counts + 2 * np.diff(self.cell_starts)
        known.most_room = int(rooms.max(initial=0))
        return known

    @cached_property
    def _spacing(self) -> F64:
        """Largest and smallest sample distances, metres, and 1 / sqrt(cell area), (3, skin
        vertices)."""
        # 1e-12 m2: far below any cell, so that a vertex without area does not divide by 0.
        closeness = 1.0 / np.sqrt(np.maximum(self.mesh.areas_m2, 1e-12))
        return np.stack([*self._distances, closeness.astype(np.float64)])


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """Surface of a model, and the triangle corners of each vertex. Corner ``3 f + k`` is the
    ``k``-th corner of triangle ``f``."""

    vertices: F32  # (V, 3)
    normals: F32  # (V, 3)
    areas_m2: F32  # (V,)
    triangles: I32  # (F, 3)
    corners: I64  # (3 F,) sorted by vertex
    starts: I64  # (V + 1,) first corner of each vertex

    @classmethod
    def of(cls, model: PerceptualModel) -> "SkinMesh":
        """Mesh of a model, cached by model; the model must not change."""
        if model not in _KNOWN:
            corners = sorted_by(model.triangles.ravel(), len(model))
            _KNOWN[model] = cls(
                np.ascontiguousarray(model.vertices, np.float32),
                np.ascontiguousarray(model.normals, np.float32),
                np.ascontiguousarray(model.areas_m2, np.float32),
                np.ascontiguousarray(model.triangles, np.int32),
                *corners,
            )
        return _KNOWN[model]

    @cached_property
    def structure(self) -> Any:
        """``hfx_skin_mesh``, valid as long as the mesh lives."""
        kind = structure("hfx_skin_mesh")
        return kind(*(getattr(self, name) for name, _ in kind._fields_))

    def outlined(self, starts: I64, units: I32, cluster_of: I64) -> tuple[list[I32], F64]:
        """Compute the outline of each of C clusters and the margin of its skin.

        ``starts`` (C + 1,) is the first unit of each cluster; ``units`` (V,) the mesh's vertices,
        cluster by cluster; ``cluster_of`` (V,) the cluster of each vertex. Returns outlines, the
        units of each cluster in the given order, then the corners of adjacent triangles, ascending;
        and margins (C,), the largest bulge of curved skin above the flat triangles, m.
        """
        clusters, margins = len(starts) - 1, np.zeros(len(starts) - 1)
        loaded().hfx_margins(self.structure, len(self.triangles), cluster_of, margins)
        outlines = np.empty(len(units) + 2 * self.triangles.size, np.int32)
        seen, ends = np.empty(len(units), np.int64), np.zeros(clusters, np.int64)
        arrays = starts, units, cluster_of, len(units), seen, outlines, ends
        loaded().hfx_outlines(self.structure, clusters, *arrays)
        return cut(outlines[: ends[-1]].copy(), ends), margins


_KNOWN: Final[WeakKeyDictionary[PerceptualModel, SkinMesh]] = WeakKeyDictionary()
