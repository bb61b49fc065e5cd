# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's skin in flat arrays, cluster by cluster; filled where it is first needed.

A *unit* is a vertex of the skin, and of each triangle around it the *quad* next to the vertex:
from it over a place on one edge and a place inside to a place on the other edge. These places
divide edges and triangle by the size of the cells, so that skin next to a much finer neighbour
belongs to the coarser one. A quad is sampled at ``steps`` by ``steps`` places; where a pose
stretches it, at more of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F32, F64, I32, I64, missing_ids, sorted_by
from ..body.model import PerceptualModel
from ..native import skin_arrays as native
from ..tolerance import Tolerance

_LEAST_SHARE: Final = 0.01
"""A vertex may stand for this share of its unit, however exact the rest of it has to be."""


class SkinTable:
    """The skin of a model's cells. A *place* is a vertex of the skin in one of the clusters.

    Each cluster has a place for each of its units, in the order of their cells, and then one
    for each corner around them. Units are known by their places. Memory is only taken by what
    :meth:`need` has filled.

    Parameters
    ----------
    surface : PerceptualModel
        Whose triangles are the skin.
    cells : list of (C,) int32
        Each cluster's vertices of the perceptual model.
    outlines : list of (n,) int32
        Each cluster's vertices of the skin: one for each unit, then corners around them.
    owner : (skin vertices,) int32
        The vertex of the model whose cell each vertex of the skin is in.
    distance, finest : (skin vertices,) float64
        How far skin at rest may be from its sample, metres, and how far at the finest.
    is_split : bool
        Whether vertices stand for more than themselves.
    tolerance : Tolerance
        Says how far skin that is posed may be from its sample, and how much of a unit may be
        counted where its vertex is.

    Attributes
    ----------
    surface : PerceptualModel
        As given.
    mesh : SkinMesh
        Its triangles.
    starts : (clusters + 1,) int64
        Each cluster's first place.
    place_counts : (clusters,) int64
        How many places each cluster has.
    unit_counts, cell_starts : (clusters,), (clusters + 1,) int64
        How many of a cluster's places are units; its first cell, where cells are counted in
        the order of the clusters.
    is_simple : bool
        Each cell is one unit.
    vertices : (P,) int32
        The vertex of the skin at each place.
    is_split : bool
        As given; else the vertex is a unit's only sample.
    cell_of, unit_shares, vertex_shares, reaches, means : (P,)
        Of each unit: its cell; its share of the cell's area, and what the sample at the vertex
        stands for; how far its skin goes towards the farthest corner, as a share, at most and on
        average.
    quad_starts : (P + 1,) int64
        The first quad of each unit.
    unit_of, around : (Q,), (Q, 2) int64
        Each quad's unit, and the places of its triangle's other corners.
    is_ringed : (P,) uint8
        Whether the first of these already are all neighbours of a unit.
    steps, finest, wholes, sample_starts : (Q,)
        Of each quad: samples both ways at rest, and the most in any pose; share of the cell's
        area, all samples together; its first sample.
    quads : (Q, 10) float64
        Of each quad, what places its samples: shares of the ways to both other corners, of its
        place on the edge to each and, both, of its place in the middle; the area of a sample as a
        share of the cell's, and how it changes along and across; the bulges of its triangle's
        edges, 0 where none counts.
    most_samples : (clusters,)
        The most samples of any of its cells.
    largest_cell : int
        The most samples of any cell that is filled in.
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
        self.starts = np.cumsum([0, *(len(some) for some in outlines)], dtype=np.int64)
        self.place_counts = np.diff(self.starts)
        self.cell_starts = np.cumsum([0, *(len(some) for some in cells)], dtype=np.int64)
        self.unit_counts = np.add.reduceat(counts[self.cells], self.cell_starts[:-1])
        self.is_simple = len(self.cells) == int(self.unit_counts.sum())
        self.vertices = np.concatenate(outlines)
        total = len(self.vertices)
        self._is_made = np.zeros(len(cells), np.bool_)
        self._cluster = np.repeat(np.arange(len(cells)), np.diff(self.starts))

        is_unit = np.arange(total) - self.starts[self._cluster] < self.unit_counts[self._cluster]
        self.cell_of = np.zeros(total, np.int64)
        self.cell_of[is_unit] = np.repeat(np.arange(len(self.cells)), counts[self.cells])
        numbers = np.where(is_unit & is_split, np.diff(self.mesh.starts)[self.vertices], 0)
        self.quad_starts = np.concatenate([[0], np.cumsum(numbers, dtype=np.int64)])
        quads = int(self.quad_starts[-1])
        self.unit_shares, self.vertex_shares = np.zeros(total), np.zeros(total)
        self.reaches = np.zeros(total)
        self.means, self.is_ringed = np.zeros(total), np.zeros(total, np.uint8)
        self.unit_of, self.around = np.zeros(quads, np.int64), np.zeros((quads, 2), np.int64)
        self.steps, self.finest = np.zeros(quads, np.int64), np.zeros(quads, np.int64)
        self.wholes = np.zeros(quads)
        self.sample_starts, self.quads = np.zeros(quads, np.int64), np.zeros((quads, 10))
        self.most_samples = np.ones(len(cells), np.int64)
        self._sample_count, self.largest_cell = 0, 1
        self._samples = np.zeros((4, 0))

    @property
    def samples(self) -> F64:
        """Barycentric placement of each sample, (4, S): the shares of the ways to both other
        corners; the height, as a share of the triangle's size; the sample's share of the cell's
        area."""
        return self._samples

    def need(self, clusters: I64) -> None:
        """Fill in the skin of clusters that have not been filled yet."""
        new = missing_ids(self._is_made, clusters)
        if not len(new):
            return
        self._fill(new)
        self._is_made[new] = True
        self.largest_cell = int(self.most_samples.max())

    def _fill(self, new: I64) -> None:
        count = native.fill(
            *(self, self.mesh, new, self._sample_count, self._spacing, self._most_share)
        )
        self._make_room(count)
        native.place_samples(self, new)

    def _make_room(self, count: int) -> None:
        """Make room for samples in a new array, as others may be reading the present one."""
        self._sample_count = count
        if count > self._samples.shape[1]:
            larger = np.empty((4, max(count, 2 * self._samples.shape[1])))
            larger[:, : self._samples.shape[1]] = self._samples
            self._samples = larger

    @cached_property
    def _spacing(self) -> F64:
        """Distances as given, and the reciprocal spacing of vertices, up to a constant factor,
        (3, skin vertices)."""
        closeness = 1.0 / np.sqrt(np.maximum(self.mesh.areas_m2, 1e-12))
        return np.stack([*self._distances, closeness.astype(np.float64)])


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """A model's surface, with the corners of its triangles by their vertices.

    A corner is ``3 f + k``: that of triangle ``f`` which is at its ``k``-th vertex.
    """

    vertices: F32  # (V, 3)
    normals: F32  # (V, 3)
    areas_m2: F32  # (V,)
    triangles: I32  # (F, 3)
    corners: I64  # (3 F,)
    starts: I64  # (V + 1,) each vertex's first

    @classmethod
    def of(cls, model: PerceptualModel) -> SkinMesh:
        """Mesh of a model, which must not change; cached."""
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


_KNOWN: Final[WeakKeyDictionary[PerceptualModel, SkinMesh]] = WeakKeyDictionary()
