# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh of half a body that is thinned and relaxed: owners, movement and merging of vertices.

A vertex moves to the centre of its cell of skin (Lloyd's method for centroidal Voronoi cells,
Du et al. 1999). Only edge collapses and flips change the mesh, so that it stays closed and
without handles however coarse it becomes.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.parts import PARTS

from ..left_skin import Half, LeftSkin, sample
from . import measure, mesh_edges, mesh_edit

HEXAGON: Final = np.sqrt(3.0) / 2.0
"""Area of one cell of an even triangular grid, over the square of its spacing."""

_COARSEST: Final = 0.6  # longest edge to thin from, over the spacing
_ERROR_STRIDE: Final = 7  # of the samples that measure the error


class Remesher:
    """Remesher of half a body to one table of spacings."""

    def __init__(self, skin: LeftSkin, spacing_m: F64) -> None:
        half = skin.medium
        self.spacing_m = spacing_m
        self.samples = sample(skin, spacing_m)
        self.points = half.points.copy()
        self.normals = skin.normals[: len(half.points)].copy()
        self.triangles = half.triangles
        self.part = half.part
        self.is_midline = half.is_midline
        self.owner = self.samples.vertex.copy()  # (S,) vertex in whose cell a sample lies
        self.midline_m = self._midline_lengths()

    def _midline_lengths(self) -> F64:
        ends = mesh_edges.edges_of(self.triangles, len(self.points))
        border = ends.ends[ends.is_border]
        lengths = np.linalg.norm(self.points[border[:, 0]] - self.points[border[:, 1]], axis=1)
        total = np.bincount(self.part[border[:, 0]], lengths, minlength=len(PARTS))
        return total.astype(np.float64)

    def expected(self) -> tuple[I64, I64]:
        """Vertices beside the midline and on it, for each part, by area and length."""
        area = np.bincount(self.samples.part, self.samples.areas_m2, minlength=len(PARTS))
        on = np.rint(self.midline_m / self.spacing_m).astype(np.int64)
        cells = area / (HEXAGON * self.spacing_m**2)
        beside = np.maximum(np.rint(cells - 0.5 * on), 1).astype(np.int64)
        return np.where(area > 0.0, beside, 0), on

    def refine(self) -> None:
        """Split edges until there are enough vertices everywhere."""
        while True:
            edges = mesh_edges.edges_of(self.triangles, len(self.points))
            one, other = edges.ends.T
            lengths = np.linalg.norm(self.points[one] - self.points[other], axis=1)
            wanted = lengths / self.spacing_m[self.part[one]]
            wanted[self.part[one] != self.part[other]] = 0.0
            order = np.argsort(-wanted, kind="stable")
            chosen = order[wanted[order] > _COARSEST]
            if not len(chosen):
                break
            self.triangles, done = mesh_edit.split(self.triangles, edges, chosen)
            one, other = edges.ends[done].T
            self.points = np.concatenate(
                (self.points, 0.5 * (self.points[one] + self.points[other]))
            )
            normal = self.normals[one] + self.normals[other]
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            self.normals = np.concatenate((self.normals, normal))
            self.part = np.concatenate((self.part, self.part[one]))
            self.is_midline = np.concatenate((self.is_midline, edges.is_border[done]))
            self._find_owners(2)

    def thin(self, beside: I64, on: I64) -> None:
        """Merge vertices along short edges until each part has its number of them."""
        seed = 0
        reach = 0.35
        while True:
            kinds = self.part.astype(np.int64) + len(PARTS) * self.is_midline
            excess = self._counts(kinds) - np.concatenate((beside, on))
            if (excess <= 0).all() or reach > 8.0:
                return
            # A limb thinner than its cells can only be reached by letting triangles turn.
            fold = 0.2 if reach < 2.0 else -1.0
            removed = self._thin_once(kinds, excess, reach, fold, seed)
            seed += 1
            if removed < 0.02 * excess.clip(0).sum() or removed == 0:
                reach *= 1.2

    def _counts(self, kinds: I64) -> I64:
        alive = np.unique(self.triangles)
        return np.bincount(kinds[alive], minlength=2 * len(PARTS))

    def _thin_once(self, kinds: I64, excess: I64, reach: float, fold: float, seed: int) -> int:
        edges = mesh_edges.edges_of(self.triangles, len(self.points))
        one, other = edges.ends.T
        lengths = np.linalg.norm(self.points[one] - self.points[other], axis=1)
        short = (kinds[one] == kinds[other]) & (excess[kinds[one]] > 0)
        short &= lengths < reach * self.spacing_m[self.part[one]]
        short &= ~self.is_midline[one] | edges.is_border
        index = np.flatnonzero(short)
        rank = mesh_edit.scatter_ranks(len(index), seed)
        swap = (rank & 1).astype(bool)
        gone = np.where(swap, one[index], other[index])
        kept = np.where(swap, other[index], one[index])
        good = mesh_edit.collapsible(
            self.points, self.normals, self.triangles, edges, gone, kept, fold
        )
        gone, kept, rank = gone[good], kept[good], rank[good]
        chosen = mesh_edit.independent(edges, gone, kept, rank)
        gone, kept, rank = gone[chosen], kept[chosen], rank[chosen]
        order = np.argsort(rank, kind="stable")
        gone, kept = gone[order], kept[order]
        taken = _first_of_each(kinds[gone], excess)
        gone, kept = gone[taken], kept[taken]
        self.triangles = mesh_edit.collapse(self.triangles, gone, kept, len(self.points))
        target = np.arange(len(self.points))
        target[gone] = kept
        self.owner = target[self.owner]
        return len(gone)

    def compact(self) -> None:
        """Drop the vertices that no triangle uses any more."""
        alive = np.unique(self.triangles)
        renumber = np.full(len(self.points), -1, np.int64)
        renumber[alive] = np.arange(len(alive))
        self.points, self.normals = self.points[alive], self.normals[alive]
        self.part, self.is_midline = self.part[alive], self.is_midline[alive]
        self.triangles, self.owner = renumber[self.triangles], renumber[self.owner]

    def relax(self, steps: int, push: float = 1.0) -> None:
        """Move every vertex to the middle of its cell, steps times; ``push`` overshoots."""
        for _ in range(steps):
            self.triangles = mesh_edit.flip_to_delaunay(
                self.points, self.triangles, self.is_midline, rounds=4
            )
            self._find_owners(1)
            self._centre(push)
        self.triangles = mesh_edit.flip_to_delaunay(self.points, self.triangles, self.is_midline)
        self._find_owners(3)

    def _find_owners(self, rounds: int) -> None:
        """Move each sample to a neighbour of its owner that is nearer, in the same part."""
        edges = mesh_edges.edges_of(self.triangles, len(self.points))
        same = self.part[edges.ends[:, 0]] == self.part[edges.ends[:, 1]]
        inner = mesh_edges.Edges(
            edges.ends[same],
            edges.triangle[same],
            edges.opposite[same],
            edges.keys[same],
            edges.count,
        )
        offsets, around = mesh_edit.neighbours(inner)
        degree = offsets[1:] - offsets[:-1]
        row = np.repeat(np.arange(len(self.points)), degree)
        column = np.arange(len(around)) - offsets[row]
        table = np.repeat(np.arange(len(self.points))[:, None], degree.max(), axis=1)
        table[row, column] = around
        # Nothing is nearer to a sample than its owner within half the way to the next vertex.
        safe = np.full(len(self.points), np.inf)
        np.minimum.at(safe, row, 0.25 * _squared(self.points[row] - self.points[around]))
        for _ in range(rounds):
            best = _squared(self.samples.points - self.points[self.owner])
            open_ = np.flatnonzero(best > safe[self.owner])
            where, best, owner = self.samples.points[open_], best[open_], self.owner[open_]
            found = owner.copy()
            for candidates in table.T:
                active = np.flatnonzero(candidates[owner] != owner)
                candidate = candidates[owner[active]]
                distance = _squared(where[active] - self.points[candidate])
                nearer = distance < best[active]
                best[active[nearer]] = distance[nearer]
                found[active[nearer]] = candidate[nearer]
            self.owner[open_] = found

    def _centre(self, push: float) -> None:
        """Move each vertex to the centre of its cell, and from there back onto the skin."""
        count = len(self.points)
        weight = self.samples.areas_m2
        total = np.bincount(self.owner, weight, minlength=count)
        has = total > 0.0
        centre = self.points.copy()
        for axis in range(3):
            mean = np.bincount(self.owner, weight * self.samples.points[:, axis], minlength=count)
            centre[has, axis] = mean[has] / total[has]
        centre = self.points + push * (centre - self.points)
        centre[self.is_midline, 0] = 0.0
        distance = _squared(self.samples.points - centre[self.owner])
        least = np.full(count, np.inf)
        np.minimum.at(least, self.owner, distance)
        hits = np.flatnonzero(distance == least[self.owner])[::-1]
        nearest_of = np.zeros(count, np.int64)
        nearest_of[self.owner[hits]] = hits
        owner, first = np.flatnonzero(has), nearest_of[has]
        nearest, normal = self.samples.points[first], self.samples.normals[first]
        # Onto the skin: into the tangent plane of the nearest sample, unless that is far.
        height = np.einsum("ij,ij->i", centre[owner] - nearest, normal)
        flat = centre[owner] - height[:, None] * normal
        is_near = _squared(flat - nearest) < self.samples.areas_m2[first]
        place = np.where(is_near[:, None], flat, nearest)
        place[self.is_midline[owner], 0] = 0.0
        self.points[owner], self.normals[owner] = place, normal

    def result(self) -> Half:
        """Current state of the mesh."""
        return Half(self.points, self.triangles, self.part, self.is_midline)

    def areas_m2(self) -> F64:
        """Skin in the cell of each vertex, on the left half."""
        areas = np.bincount(self.owner, self.samples.areas_m2, minlength=len(self.points))
        return areas.astype(np.float64)

    def largest_gaps_m(self) -> F64:
        """Distance from the farthest skin of each part to the nearest vertex of all."""
        mirrored = self.points * (-1.0, 1.0, 1.0)
        return measure.gaps_m(self.samples, np.concatenate((self.points, mirrored)))

    def errors_m(self) -> F64:
        """Mean distance of the skin from the mesh, for each part."""
        return measure.errors_m(self.samples, self.points, self.triangles, _ERROR_STRIDE)

    def mean_spacing(self, points: F64) -> F64:
        """Mean distance between neighbours of the same part, for each part, metres.

        Parameters
        ----------
        points : (V, 3) float64
            Where the vertices are taken to be.
        """
        edges = mesh_edges.edges_of(self.triangles, len(points))
        one, other = edges.ends.T
        lengths = np.linalg.norm(points[one] - points[other], axis=1)
        # An edge beside the midline counts twice, one on it once.
        copies = np.where(edges.is_border, 1.0, 2.0)
        same = self.part[one] == self.part[other]
        labels = self.part[one][same]
        total = np.bincount(labels, (copies * lengths)[same], minlength=len(PARTS))
        number = np.bincount(labels, copies[same], minlength=len(PARTS))
        return total / np.maximum(number, 1.0)


def _squared(offsets: F64) -> F64:
    found: F64 = np.einsum("ij,ij->i", offsets, offsets)
    return found


def _first_of_each(kinds: I64, limit: I64) -> I64:
    """Positions of the first ``limit[k]`` entries of each kind ``k``."""
    order = np.argsort(kinds, kind="stable")
    sorted_kinds = kinds[order]
    start = np.searchsorted(sorted_kinds, sorted_kinds)
    taken: I64 = np.sort(order[np.arange(len(order)) - start < limit[sorted_kinds]])
    return taken
