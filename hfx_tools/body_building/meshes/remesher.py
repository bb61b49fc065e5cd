# SPDX-License-Identifier: GPL-3.0-or-later
"""Thinning and relaxation of half a body's mesh: owners, movement and merging of vertices.

A vertex moves to the centre of its cell of skin (Lloyd's method for centroidal Voronoi cells,
Du et al. 1999). Only edge collapses and flips change the mesh, so even a coarse mesh is closed
and without handles.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.body.parts import PARTS

from ..joint_gradient import UNIFORM, JointGradient
from ..left_skin import Half, LeftSkin, sample
from . import measure, mesh_edges, mesh_edit

HEXAGON: Final = np.sqrt(3.0) / 2.0
"""Area of one cell of an even triangular grid, divided by its squared spacing."""

_COARSEST: Final = 0.6  # longest edge before thinning, relative to the spacing
_ERROR_STRIDE: Final = 7  # stride of the samples for the error


class Remesher:
    """Mesh of half a body under change, with skin samples owned by its vertices."""

    def __init__(self, skin: LeftSkin, spacing_m: F64, gradient: JointGradient = UNIFORM) -> None:
        half = skin.medium
        self.spacing_m = spacing_m  # (parts,) without the gradient
        self.gradient = gradient
        self.samples = sample(skin, spacing_m, gradient)
        self.sample_relative = gradient.relative(self.samples.points, self.samples.part)
        # A density of spacing^-4 gives centroidal cells of this spacing (Du et al. 1999).
        self.sample_weight = self.samples.areas_m2 / self.sample_relative**4
        self.points = half.points.copy()
        self.normals = skin.normals[: len(half.points)].copy()
        self.triangles = half.triangles
        self.part = half.part
        self.is_midline = half.is_midline
        self.owner = self.samples.vertex.copy()  # (S,) vertex with the sample in its cell
        self.midline_m = self._midline_lengths()

    def _midline_lengths(self) -> F64:
        ends = mesh_edges.edges_of(self.triangles, len(self.points))
        border = ends.ends[ends.is_border]
        lengths = np.linalg.norm(self.points[border[:, 0]] - self.points[border[:, 1]], axis=1)
        lengths /= self._relative_at_middles(self.points, border)
        total = np.bincount(self.part[border[:, 0]], lengths, minlength=len(PARTS))
        return total.astype(np.float64)

    def local_spacing_m(self) -> F64:
        """Target spacing (V,) at each vertex."""
        return self.spacing_m[self.part] * self.gradient.relative(self.points, self.part)

    def _relative_at_middles(self, points: F64, ends: I64) -> F64:
        """Relative spacing (E,) of the gradient at the middles of edges, in the part of the first
        end.
        """
        start, end = ends.T
        return self.gradient.relative(0.5 * (points[start] + points[end]), self.part[start])

    def expected(self) -> tuple[I64, I64]:
        """Expected numbers of vertices off and on the midline, by part."""
        # A cell's area goes with the square of the relative spacing.
        scaled = self.samples.areas_m2 / self.sample_relative**2
        area = np.bincount(self.samples.part, scaled, minlength=len(PARTS))
        on_midline = np.rint(self.midline_m / self.spacing_m).astype(np.int64)
        cells = area / (HEXAGON * self.spacing_m**2)
        off_midline = np.maximum(np.rint(cells - 0.5 * on_midline), 1).astype(np.int64)
        return np.where(area > 0.0, off_midline, 0), on_midline

    def refine(self) -> None:
        """Split edges within parts, in place, until none is longer than 0.6 of the spacing."""
        while True:
            edges = mesh_edges.edges_of(self.triangles, len(self.points))
            start, end = edges.ends.T
            lengths = np.linalg.norm(self.points[start] - self.points[end], axis=1)
            local_m = self.spacing_m[self.part[start]]
            local_m *= self._relative_at_middles(self.points, edges.ends)
            relative = lengths / local_m
            relative[self.part[start] != self.part[end]] = 0.0
            order = np.argsort(-relative, kind="stable")
            chosen = order[relative[order] > _COARSEST]
            if not len(chosen):
                break
            self.triangles, done = mesh_edit.split(self.triangles, edges, chosen)
            start, end = edges.ends[done].T
            self.points = np.concatenate(
                (self.points, 0.5 * (self.points[start] + self.points[end]))
            )
            normal = self.normals[start] + self.normals[end]
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            self.normals = np.concatenate((self.normals, normal))
            self.part = np.concatenate((self.part, self.part[start]))
            self.is_midline = np.concatenate((self.is_midline, edges.is_border[done]))
            self._find_owners(2)

    def thin(self, off_midline: I64, on_midline: I64) -> None:
        """Merge vertices along short edges, in place, down to the given numbers by part.

        ``off_midline`` and ``on_midline`` are numbers of vertices, (parts,). Fewer vertices are
        merged if no further collapse is safe.
        """
        seed = 0
        reach = 0.35
        while True:
            kinds = self.part.astype(np.int64) + len(PARTS) * self.is_midline
            excess = self._counts(kinds) - np.concatenate((off_midline, on_midline))
            if (excess <= 0).all() or reach > 8.0:
                return
            # A limb thinner than its cells needs collapses with turned triangles.
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
        start, end = edges.ends.T
        lengths = np.linalg.norm(self.points[start] - self.points[end], axis=1)
        short = (kinds[start] == kinds[end]) & (excess[kinds[start]] > 0)
        local_m = self.spacing_m[self.part[start]]
        local_m *= self._relative_at_middles(self.points, edges.ends)
        short &= lengths < reach * local_m
        short &= ~self.is_midline[start] | edges.is_border
        index = np.flatnonzero(short)
        rank = mesh_edit.scatter_ranks(len(index), seed)
        swap = (rank & 1).astype(bool)
        gone = np.where(swap, start[index], end[index])
        target_ids = np.where(swap, end[index], start[index])
        good = mesh_edit.collapsible(
            self.points, self.normals, self.triangles, edges, gone, target_ids, fold
        )
        gone, target_ids, rank = gone[good], target_ids[good], rank[good]
        chosen = mesh_edit.independent(edges, gone, target_ids, rank)
        gone, target_ids, rank = gone[chosen], target_ids[chosen], rank[chosen]
        order = np.argsort(rank, kind="stable")
        gone, target_ids = gone[order], target_ids[order]
        taken = _first_of_each(kinds[gone], excess)
        gone, target_ids = gone[taken], target_ids[taken]
        self.triangles = mesh_edit.collapse(self.triangles, gone, target_ids, len(self.points))
        target = np.arange(len(self.points))
        target[gone] = target_ids
        self.owner = target[self.owner]
        return len(gone)

    def compact(self) -> None:
        """Drop unused vertices and renumber, in place."""
        alive = np.unique(self.triangles)
        renumber = np.full(len(self.points), -1, np.int64)
        renumber[alive] = np.arange(len(alive))
        self.points, self.normals = self.points[alive], self.normals[alive]
        self.part, self.is_midline = self.part[alive], self.is_midline[alive]
        self.triangles, self.owner = renumber[self.triangles], renumber[self.owner]

    def relax(self, steps: int, push: float = 1.0) -> None:
        """Move every vertex to the centre of its cell, in place; ``push`` above 1 overshoots."""
        for _ in range(steps):
            self.triangles = mesh_edit.flip_to_delaunay(
                self.points, self.triangles, self.is_midline, rounds=4
            )
            self._find_owners(1)
            self._centre(push)
        self.triangles = mesh_edit.flip_to_delaunay(self.points, self.triangles, self.is_midline)
        self._find_owners(3)

    def _find_owners(self, rounds: int) -> None:
        """Give each sample to the nearest neighbour of its owner in the part, ``rounds`` times."""
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
        # Row of neighbours of each vertex, padded with the vertex itself.
        table = np.repeat(np.arange(len(self.points))[:, None], degree.max(), axis=1)
        table[row, column] = around
        # A sample within half the distance from its owner to the next vertex has no nearer vertex.
        safe = np.full(len(self.points), np.inf)
        np.minimum.at(safe, row, 0.25 * _squared(self.points[row] - self.points[around]))
        for _ in range(rounds):
            best = _squared(self.samples.points - self.points[self.owner])
            open_ = np.flatnonzero(best > safe[self.owner])
            where, best, owner = self.samples.points[open_], best[open_], self.owner[open_]
            new_owner = owner.copy()
            for candidates in table.T:
                active = np.flatnonzero(candidates[owner] != owner)
                candidate = candidates[owner[active]]
                distance = _squared(where[active] - self.points[candidate])
                nearer = distance < best[active]
                best[active[nearer]] = distance[nearer]
                new_owner[active[nearer]] = candidate[nearer]
            self.owner[open_] = new_owner

    def _centre(self, push: float) -> None:
        """Move each vertex to the centre of its cell, then back onto the skin, in place."""
        count = len(self.points)
        weight = self.sample_weight
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
        # Reversed, so that among equally near samples the first one wins the assignment below.
        hits = np.flatnonzero(distance == least[self.owner])[::-1]
        nearest_of = np.zeros(count, np.int64)
        nearest_of[self.owner[hits]] = hits
        owner, first = np.flatnonzero(has), nearest_of[has]
        nearest, normal = self.samples.points[first], self.samples.normals[first]
        # Onto the skin: into the tangent plane of the nearest sample, or, if far, to the sample.
        height = np.einsum("ij,ij->i", centre[owner] - nearest, normal)
        flat = centre[owner] - height[:, None] * normal
        is_near = _squared(flat - nearest) < self.samples.areas_m2[first]
        moved = np.where(is_near[:, None], flat, nearest)
        moved[self.is_midline[owner], 0] = 0.0
        self.points[owner], self.normals[owner] = moved, normal

    def result(self) -> Half:
        """Current mesh; the arrays are shared, not copied."""
        return Half(self.points, self.triangles, self.part, self.is_midline)

    def areas_m2(self) -> F64:
        """Area of skin in the cell of each vertex, (V,), on the left half."""
        areas = np.bincount(self.owner, self.samples.areas_m2, minlength=len(self.points))
        return areas.astype(np.float64)

    def largest_gaps_m(self) -> F64:
        """Largest distance, by part, from a skin sample to the nearest vertex of both halves.

        Each distance is divided by the relative spacing at the sample.
        """
        mirrored = self.points * (-1.0, 1.0, 1.0)
        both = np.concatenate((self.points, mirrored))
        return measure.gaps_m(self.samples, both, self.gradient)

    def errors_m(self) -> F64:
        """Mean distance of the skin from the mesh, by part."""
        return measure.errors_m(self.samples, self.points, self.triangles, _ERROR_STRIDE)

    def mean_spacing(self, points: F64) -> F64:
        """Mean distance between neighbours within each part, metres; 0 for a part without edges.

        Each distance is divided by the relative spacing at the middle of its edge.

        ``points`` (V, 3) float64: positions of the vertices.
        """
        edges = mesh_edges.edges_of(self.triangles, len(points))
        start, end = edges.ends.T
        lengths = np.linalg.norm(points[start] - points[end], axis=1)
        lengths /= self._relative_at_middles(points, edges.ends)
        # An edge off the midline counts twice (mirrored), an edge on the midline once.
        copies = np.where(edges.is_border, 1.0, 2.0)
        same = self.part[start] == self.part[end]
        labels = self.part[start][same]
        total = np.bincount(labels, (copies * lengths)[same], minlength=len(PARTS))
        number = np.bincount(labels, copies[same], minlength=len(PARTS))
        return total / np.maximum(number, 1.0)


def _squared(offsets: F64) -> F64:
    return np.einsum("ij,ij->i", offsets, offsets)


def _first_of_each(kinds: I64, limit: I64) -> I64:
    """Positions of the first ``limit[k]`` entries of each kind ``k``."""
    order = np.argsort(kinds, kind="stable")
    sorted_kinds = kinds[order]
    start = np.searchsorted(sorted_kinds, sorted_kinds)
    return np.sort(order[np.arange(len(order)) - start < limit[sorted_kinds]])
