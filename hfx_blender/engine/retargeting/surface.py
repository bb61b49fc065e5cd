# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest places on a target's skin in the same body region; smooth pull of a body to the skin."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I64
from ..native.library import library, loaded
from ..volume.mesh_distance import TriangleTree, barycentric
from .turns import unit

_LONGEST_EDGE_M: Final = 0.02  # longest edge of cut triangles; the search compares triangle centres
_CANDIDATES: Final = 8
_ROUNDING_M: Final = 1e-9  # added to radii, so that rounding leaves no triangle out
_NEARER: Final = 1.0 - 1e-9  # a place nearer than this share of the distance is another
_SHARE: Final = 0.1  # smallest skin weight of a vertex or triangle in a region
_FACING: Final = 0.3  # smallest cosine between the normals of matched places


@dataclass(frozen=True, eq=False)
class NearestSkin:
    """Nearest places on a target's surface, one row per query point."""

    found: npt.NDArray[np.bool_]  # (P,) False without a place; other fields then are 0
    triangle: I64  # (P,) triangle of the target
    weights: F64  # (P, 3) barycentric, 0..1, sum 1
    points: F64  # (P, 3)
    normals: F64  # (P, 3) smooth, unit length


class TargetSurface:
    """Target's skin in normalised space, with search trees for each region. ``points`` are (A, 3),
    ``triangles`` (F, 3), ``shares`` (A, R) skin weights by region."""

    def __init__(self, points: F64, triangles: I64, shares: F64) -> None:
        from trimesh.triangles import cross

        self.points, self.triangles = points, triangles
        self.normals = vertex_normals(points, triangles)
        self.flat_normals = unit(cross(points[triangles]))  # (F, 3), 0 without area
        whole = sum(shares[corner] for corner in triangles.T) / 3
        self.region: I64 = np.where(whole.max(axis=1) > 0.0, whole.argmax(axis=1), -1)
        self._pieces, self.parent, self._corners = cut_triangles(points[triangles])
        # (N, 3, 3) at the corners of the cut triangles, interpolated, so not of unit length
        self._piece_normals: F64 = self._corners @ self.normals[triangles[self.parent]]
        self.centres: F64 = self._pieces.mean(axis=1)  # (N, 3) of the cut triangles
        ways = self._pieces - self.centres[:, None]
        self._radii: F64 = np.linalg.norm(ways, axis=2).max(axis=1) + _ROUNDING_M  # (N,)
        is_of = np.ascontiguousarray((whole >= _SHARE).T)
        self._members = [np.flatnonzero(row[self.parent]) for row in is_of]  # (n,) by region
        self._triangle_trees: dict[int, TriangleTree] = {}  # by region
        self._centre_trees: dict[int, Any] = {}

    def leave_out(self, pieces: npt.NDArray[np.bool_]) -> None:
        """Exclude cut triangles (mask (N,)) from all later searches."""
        if pieces.any():
            self._members = [members[~pieces[members]] for members in self._members]
            self._triangle_trees, self._centre_trees = {}, {}

    def nearest(
        self, points: F64, normals: F64, shares: F64, reach_m: float, facing: float = _FACING
    ) -> NearestSkin:
        """Nearest place for each point (P, 3) in a common region, with a similar normal.

        ``normals`` (P, 3) and ``shares`` (P, R), skin weights by region, are of the points;
        ``facing`` is the smallest cosine between the normals of point and place, ``reach_m`` the
        largest distance.
        """
        from scipy.spatial import cKDTree

        best = np.full(len(points), -1)
        smallest = np.full(len(points), np.nextafter(reach_m, np.inf))
        is_of = np.ascontiguousarray((shares >= _SHARE).T)
        for region, members in enumerate(self._members):
            queries = np.flatnonzero(is_of[region])
            if not len(queries) or not len(members):
                continue
            if library() is not None:
                if region not in self._triangle_trees:
                    pieces = np.ascontiguousarray(self._pieces[members])
                    self._triangle_trees[region] = TriangleTree(pieces)
                tree = self._triangle_trees[region]
                # A triangle of two regions is searched, and found, in the first alone.
                reach = smallest[queries] * _NEARER
                near, _ = tree.nearest(np.ascontiguousarray(points[queries].T), reach)
                queries, near = queries[near >= 0], near[near >= 0]
                pairs = queries, members[near]
                # Where the nearest triangle faces away, on thin parts, the next ones are searched.
                queries = queries[~self._improve(best, smallest, *pairs, points, normals, facing)]
                if not len(queries):
                    continue
            if region not in self._centre_trees:
                self._centre_trees[region] = cKDTree(self.centres[members])
            # Nearest centres are candidates; exact distances choose among them. A triangle is no
            # nearer than its centre less its radius, so that farther centres are left out unseen.
            tries = min(_CANDIDATES, len(members))
            farthest = smallest[queries].max() + self._radii[members].max()
            off, near = self._centre_trees[region].query(
                points[queries], k=[*range(1, tries + 1)], distance_upper_bound=farthest
            )
            # The nearest centre first: its distance spares most of the others.
            for columns in (slice(0, 1), slice(1, tries)):
                row, column = np.nonzero(near[:, columns] < len(members))
                piece = members[near[row, column + columns.start]]
                least = off[row, column + columns.start] - self._radii[piece]
                is_open = least < smallest[queries[row]]
                pairs = queries[row[is_open]], piece[is_open]
                self._improve(best, smallest, *pairs, points, normals, facing)
        found, triangle = best >= 0, np.zeros(len(best), np.int64)
        piece, values = best[found], np.zeros((3, len(best), 3))
        bary, triangle[found] = barycentric(points[found], self._pieces[piece]), self.parent[piece]
        parts = self._corners[piece], self._pieces[piece], self._piece_normals[piece]
        values[:, found] = [np.einsum("nc,nci->ni", bary, part) for part in parts]
        return NearestSkin(found, triangle, values[0], values[1], unit(values[2]))

    def _improve(
        self,
        best: I64,
        smallest: F64,
        point: I64,
        piece: I64,
        points: F64,
        normals: F64,
        facing: float,
    ) -> npt.NDArray[np.bool_]:
        """Enter the nearest of the cut triangles ``piece`` (n,) for points ``point`` (n,) that face
        the point and are nearer than ``smallest`` (P,) into ``best`` (P,) and ``smallest``. Returns
        the mask (n,) of triangles that face the point and are nearer than the distances before."""
        is_better = np.zeros(len(point), np.bool_)
        if library() is not None:
            own = self._pieces, self._piece_normals, len(point), point, piece
            loaded().hfx_mesh_nearest_facing(
                *own, points, normals, facing, smallest, best, is_better
            )
            return is_better
        bary = barycentric(points[point], self._pieces[piece])
        at = np.einsum("nc,nci->ni", bary, self._pieces[piece])
        distance = np.linalg.norm(at - points[point], axis=1)
        is_better = distance < smallest[point]
        # Candidates that are no nearer need no normals.
        near = np.flatnonzero(is_better)
        normal = np.einsum("nc,nci->ni", bary[near], self._piece_normals[piece[near]])
        # Excludes the far side of thin parts.
        is_better[near] = np.einsum("ni,ni->n", normal, normals[point[near]]) >= facing
        entered = np.flatnonzero(is_better)
        order = np.lexsort((distance[entered], point[entered]))
        first = entered[order[np.flatnonzero(np.diff(point[entered[order]], prepend=-1))]]
        smallest[point[first]], best[point[first]] = distance[first], piece[first]
        return is_better

    def around(
        self, point: F64, axis: F64, half_m: float, radius_m: float, regions: Sequence[int]
    ) -> F64:
        """Centres (N, 3) of cut triangles of ``regions`` within ``half_m`` along ``axis``, a unit
        vector, and ``radius_m`` across of a point."""
        is_member = np.zeros(len(self.centres), np.bool_)
        for region in regions:
            is_member[self._members[region]] = True
        centres = self.centres[is_member]
        offset = centres - point
        along = np.einsum("ni,i->n", offset, axis)
        off = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        return np.asarray(centres[(np.abs(along) < half_m) & (off < radius_m)])


def cut_triangles(corners: F64) -> tuple[F64, I64, F64]:
    """Halve triangles (F, 3, 3), metres, at the longest edge until no edge exceeds 20 mm.

    Each round halves all triangles with a longer edge; above 300,000 triangles no round begins, and
    longer edges remain. Short triangles are returned uncut; the order is not that of the input.

    Returns the corners (N, 3, 3) of the pieces, the original triangle (N,) of each, and the
    barycentric weights (N, 3, 3) of the corners in the original triangle.
    """
    parent = np.arange(len(corners))
    places = np.broadcast_to(np.eye(3), (len(corners), 3, 3)).copy()
    while True:
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        long = edges.max(axis=1) > _LONGEST_EDGE_M
        if not long.any() or len(corners) > 300_000:
            return corners, parent, places
        order, halves = (edges[long].argmax(axis=1)[:, None] + np.arange(3)) % 3, []
        for values in (corners, places):
            rows = values[long]
            a, b, c = (rows[np.arange(len(rows)), order[:, k]] for k in range(3))
            middle = (a + b) / 2
            first, second = np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)
            halves.append(np.concatenate((values[~long], first, second)))
        corners, places = halves
        parent = np.concatenate((parent[~long], parent[long], parent[long]))


def vertex_normals(points: F64, triangles: I64) -> F64:
    """Area-weighted unit normals (V, 3) of vertices ``points`` (V, 3)."""
    from trimesh.triangles import cross

    across, corners = np.repeat(cross(points[triangles]), 3, axis=0), triangles.ravel()
    sums = [np.bincount(corners, column, minlength=len(points)) for column in across.T]
    return unit(np.column_stack(sums))


STIFFNESS: Final = (300.0, 30.0, 10.0, 5.0, 2.0)
"""Weight of the smoothness term relative to the surface, by round."""

_REACH_M: Final = 0.12  # largest distance to the surface in the first round; half in the last
# Smallest squared cosine between surface normal and the direction across a limb
_STEEPEST: Final = 0.5


def pull(
    points: F64, triangles: I64, shares: F64, axes: F64, surface: TargetSurface
) -> Generator[float, None, F64]:
    """Generator: pull a posed body (V, 3) smoothly onto a surface; yields progress, returns (V, 3).

    Each round moves vertices towards the tangent planes of the nearest places, so the skin can
    slide. Displacements differ little between neighbours (membrane), with decreasing stiffness.
    ``shares`` (V, R) are skin weights by region; ``axes`` (V, 3) are directions without
    displacement (along limbs), 0 outside of limbs.
    """
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import splu

    # Graph Laplacian with unit weights: the membrane term pulls each vertex to its neighbours.
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    links = np.ones(len(starts)), (starts, ends)
    graph = coo_array(links, shape=(len(points), len(points))).tocsr()
    graph = ((graph + graph.T) > 0).astype(np.float64)
    laplacian = diags_array(graph.sum(axis=1)) - graph
    moved = points
    for number, stiffness in enumerate(STIFFNESS):
        reach = _REACH_M * (1.0 - 0.5 * number / (len(STIFFNESS) - 1))
        normals = vertex_normals(moved, triangles)
        places = surface.nearest(moved, normals, shares, reach)
        gap = np.einsum("vi,vi->v", places.points - moved, places.normals)
        # A plane slanted to the limb is reached across the limb, by at most 1 / _STEEPEST.
        across = places.normals - np.einsum("vi,vi->v", places.normals, axes)[:, None] * axes
        steep = np.maximum(np.einsum("vi,vi->v", across, places.normals), _STEEPEST)
        slid = np.einsum("vi,vi->v", moved - points, axes)
        goal = moved + (gap / steep)[:, None] * across - slid[:, None] * axes
        # Vertices without a place follow their neighbours: only the membrane term acts on them.
        hold = places.found.astype(np.float64)
        system = (stiffness * laplacian + diags_array(hold + 1e-6)).tocsc()
        # Symmetric and diagonally dominant: no pivots, and a sparser factorisation.
        factors = splu(
            system, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        shift = factors.solve((hold + 1e-6)[:, None] * (goal - points))
        moved = points + shift
        yield (number + 1) / len(STIFFNESS)
    return moved
