# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin around vertices, and the sample points.

The *cell* of a vertex of a perceptual model is the skin nearer to the vertex than to the
neighbours, with each distance divided by the neighbour's own spacing. In HFX Studio (Danieau et
al., VRST 2018), the origin of perceptual models, a contact is a vertex inside a volume. Here a
contact has a weight, the inside fraction of the cell, so that contacts between two vertices are
felt.

In a triangle with corners 0, 1, 2 the part of corner 0 is the *quad* from the corner over a point
on the edge to 1 and a point in the middle to a point on the edge to 2. Each quad has ``n`` by ``n``
samples, each in the middle of the part of the quad.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from ..body.levels_and_cells import cell_of_skin
from ..body.model import PerceptualModel

_SPACING: Final = np.sqrt(2.0 / np.sqrt(3.0))
"""Vertex spacing of an even triangle pattern with hexagonal cells of area 1."""

_MOST: Final = 256  # samples along a quad's side at most
_AT_ONCE: Final = 1 << 16  # samples per block: 100 MB of paths with 64 steps
_VERTEX_SHARE: Final = 0.01  # largest fraction of a cell that its vertex represents
_CREASE: Final = 0.25  # fraction of a triangle's size: a higher bulge is a crease
_FLAT: Final = 0.1  # fraction of the sample distance: a lower bulge is flat


@dataclass(frozen=True)
class Fineness:
    """Largest distance of skin from the sample: a fraction of the vertex spacing, within limits."""

    share: float = 1.0 / 8.0
    least_m: float = 0.00025
    most_m: float = 0.001


EXACT: Final = Fineness()
"""Fineness of the engine at the tolerance ``exact``."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Perceptual model, and the model with the triangles that its cells are sampled on."""

    model: PerceptualModel
    surface: PerceptualModel
    owner: I32  # (V of the surface,) model vertex whose cell holds each surface vertex

    @classmethod
    def of(cls, model: PerceptualModel, finer: PerceptualModel | None = None) -> "Skin":
        """Skin of a model, sampled on its own triangles or on those of a finer model (not None). On
        limbs, temperature vertices are 150 mm apart, too far to approximate the skin."""
        if finer is None:
            return cls(model, model, np.arange(len(model), dtype=np.int32))
        return cls(model, finer, cell_of_skin(model)[1])


@dataclass(frozen=True, eq=False)
class Samples:
    """Sample points of skin with the fractions of cell areas."""

    cells: I64  # (N,) model vertices
    corners: I64  # (3, N) surface vertices
    shares: F64  # (3, N) barycentric coordinates
    heights: F64  # (N,) above the flat triangle, in units of sqrt(2 * area)
    areas: F64  # (N,) fractions of the cell's area; sum 1 in each cell

    def posed(self, points: F64, handedness: float) -> F64:
        """Positions (3, N) on a surface with vertices ``points`` (3, V).

        ``handedness`` is -1 for mirrored bodies, with inward normals.
        """
        zero, one, two = (points[:, corner] for corner in self.corners)
        cross = np.cross(one - zero, two - zero, axis=0)  # length: twice the area
        doubled = np.sqrt(np.einsum("in,in->n", cross, cross))
        size = np.sqrt(np.where(doubled > 0.0, doubled, 1.0))
        flat = zero * self.shares[0] + one * self.shares[1] + two * self.shares[2]
        bulged: F64 = flat + handedness * cross * (self.heights / size)
        return bulged


def vertex_samples(model: PerceptualModel) -> Samples:
    """One sample per vertex of a model, for its whole cell: the test of HFX Studio (Danieau et al.,
    2018)."""
    indices, count = np.arange(len(model)), len(model)
    shares = np.stack([np.ones(count), np.zeros(count), np.zeros(count)])
    return Samples(indices, np.stack([indices] * 3), shares, np.zeros(count), np.ones(count))


class Cells:
    """Quads of a skin at rest; :meth:`samples` yields their samples."""

    def __init__(self, skin: Skin, fineness: Fineness) -> None:
        surface, self._skin = skin.surface, skin
        spacing = _SPACING * np.sqrt(skin.model.areas_m2.astype(np.float64))[skin.owner]
        distance = np.clip(fineness.share * spacing, fineness.least_m, fineness.most_m)
        turned = [np.roll(surface.triangles, -k, axis=1) for k in range(3)]
        self._corners = np.concatenate(turned).T.astype(np.int64)  # (3, Q), the own one first
        points = [surface.vertices[corner].astype(np.float64).T for corner in self._corners]
        normals = [surface.normals[corner].astype(np.float64).T for corner in self._corners]
        unit = self._corners[0]

        # A point of a triangle belongs to the corner with the smallest barycentric-weighted
        # distance: the edge is divided in proportion of the corners' spacings.
        near = 1.0 / np.sqrt(np.maximum(surface.areas_m2, 1e-12)).astype(np.float64)
        zero, one, two = (near[corner] for corner in self._corners)
        whole = zero + one + two
        self._edge, self._other = one / (zero + one), two / (zero + two)
        self._inner, self._inner_2 = one / whole, two / whole

        along, across = points[1] - points[0], points[2] - points[0]
        cross = np.cross(along, across, axis=0)
        self._doubled = np.sqrt(_dot(cross, cross))
        squares = _dot(along, along), _dot(along, across), _dot(across, across)
        self._steps = self._steps_within(squares, distance[unit])
        self._bulges = _bulges(points, normals, cross, self._doubled)
        sizes = np.sqrt(self._doubled)
        is_flat = np.abs(self._bulges).max(axis=0) / 3.0 * sizes <= _FLAT * distance[unit]
        self._bulges[:, is_flat] = 0.0

    def _steps_within(self, squares: tuple[F64, F64, F64], distance: F64) -> I64:
        """Samples along each side (Q,) of Q quads, 1 to 256, so that skin is no farther than
        ``distance`` (Q,) metres from its sample. ``squares`` as in :meth:`_reach`."""
        # An upper bound from the corners of the quad, refined at a quarter step of this result.
        most = np.ceil(self._reach(squares, np.inf) / distance - 1e-9)
        steps = np.ceil(self._reach(squares, most) / distance - 1e-9)
        return np.clip(steps, 1, _MOST).astype(np.int64)

    def _reach(self, squares: tuple[F64, F64, F64], steps: F64 | float) -> F64:
        """Largest distance (Q,) from a sample to a corner of its part of the quad, times ``steps``,
        metres. The position is bilinear in (s, t): the distance is half a step in s and in t times
        the derivatives there, largest towards a corner of the quad, a quarter step from it.
        ``squares`` are the dot products (Q,) of the edges from the quad's corner: first with
        itself, with the second, second with itself."""
        longest = np.zeros(len(self._doubled))
        low, high = 0.25 / np.maximum(steps, 1.0), 1.0 - 0.25 / np.maximum(steps, 1.0)
        for s in (low, high):
            for t in (low, high):
                by_s = self._edge * (1.0 - t) + self._inner * t, (self._inner_2 - self._other) * t
                by_t = (self._inner - self._edge) * s, self._other * (1.0 - s) + self._inner_2 * s
                for sign in (1.0, -1.0):
                    x, y = by_s[0] + sign * by_t[0], by_s[1] + sign * by_t[1]
                    squared = x * x * squares[0] + 2.0 * x * y * squares[1] + y * y * squares[2]
                    longest = np.maximum(longest, squared)
        reach: F64 = 0.5 * np.sqrt(longest)
        return reach

    def samples(self, cells: I64 | None = None) -> Iterator[Samples]:
        """Yield all samples (``cells`` None), or those of the given cells, in blocks of bounded
        size with whole cells."""
        owner, count = self._skin.owner.astype(np.int64), len(self._skin.model)
        sizes = np.bincount(owner[self._corners[0]], self._steps**2, count)
        is_selected = np.full(count, cells is None)
        is_selected[cells] = True
        # Blocks end at whole cells, so that a cell is summed within one block.
        total = np.cumsum(np.where(is_selected, sizes, 0.0))
        block = np.where(is_selected, total // _AT_ONCE, -1).astype(np.int64)
        quad_block, unit_block = block[owner[self._corners[0]]], block[owner]
        for number in range(int(block.max(initial=-1)) + 1):
            quads = np.flatnonzero(quad_block == number)
            yield self._samples_of(quads, np.flatnonzero(unit_block == number))

    def _samples_of(self, quads: I64, units: I64) -> Samples:
        """Samples of the quads ``quads``, and one of each surface vertex in ``units``, the corners
        of these quads: first the vertices, then the quads' samples."""
        owner, total = self._skin.owner.astype(np.int64), len(self._skin.surface)
        counts = self._steps[quads] ** 2
        quad = np.repeat(quads, counts)
        step = np.arange(len(quad)) - np.repeat(np.cumsum(counts) - counts, counts)
        # Midpoint rule on the unit square of each quad.
        n = self._steps[quad]
        s, t = (step // n + 0.5) / n, (step % n + 0.5) / n
        edge, far_edge, inner, inner_2 = (
            values[quad] for values in (self._edge, self._other, self._inner, self._inner_2)
        )
        one = s * (1.0 - t) * edge + s * t * inner
        two = (1.0 - s) * t * far_edge + s * t * inner_2
        # The Jacobian of (one, two) by (s, t) times twice the triangle's area is the area element.
        jacobian = edge * far_edge + s * edge * (inner_2 - far_edge) + t * far_edge * (inner - edge)
        areas = jacobian * self._doubled[quad] / n**2
        by_one, by_two, between = self._bulges[:, quad]
        heights = (1.0 - one - two) * (one * by_one + two * by_two) + one * two * between

        # The vertex is a sample too: with an equal fraction, at most a hundredth of the cell; of
        # triangles without area with all of it, as their samples have no share.
        unit = self._corners[0, quad]
        of_units = np.bincount(unit, areas, total)
        has_area = of_units > 0.0
        of_units[units] = np.where(of_units[units] > 0.0, of_units[units], 1.0)
        of_cells = np.bincount(owner, of_units, len(self._skin.model))
        unit_shares = of_units / np.where(of_cells > 0.0, of_cells, 1.0)[owner]
        numbers = np.bincount(unit, minlength=total)
        own = np.where(has_area, np.minimum(1.0 / (numbers + 1.0), _VERTEX_SHARE), 1.0)
        areas = areas / of_units[unit] * (unit_shares * (1.0 - own))[unit]
        zeros = np.zeros(len(units))
        return Samples(
            np.concatenate([owner[units], owner[unit]]),
            np.concatenate([np.stack([units] * 3), self._corners[:, quad]], axis=1),
            np.concatenate(
                [np.stack([zeros + 1.0, zeros, zeros]), np.stack([1.0 - one - two, one, two])],
                axis=1,
            ),
            np.concatenate([zeros, heights]),
            np.concatenate([(unit_shares * own)[units], areas]),
        )


@lru_cache(maxsize=4)
def cells_of(skin: Skin, fineness: Fineness) -> Cells:
    """Cells of a skin at a fineness; the last four are cached, because every time needs them."""
    return Cells(skin, fineness)


def _bulges(points: list[F64], normals: list[F64], cross: F64, doubled: F64) -> F64:
    """Bulge coefficients of skin above the triangles, (3, Q): edges 01, 02 and 12, in units of
    sqrt(2 * area). Phong tessellation (Boubekeur and Alexa, 2008) moves a point with barycentric
    coordinates l to the mean, weighted by l, of the projections onto the planes at the corners. Its
    height above the triangle is the sum over edges ij of ``l_i l_j (p_j - p_i) . (m_j - m_i)``,
    with ``m_i`` the corner's normal times its cosine to the triangle's normal. Half of it equals
    the sagitta of a circle and of a sphere, to second order. Clipped at creases; 0 for NaN."""
    with np.errstate(divide="ignore", invalid="ignore"):
        upright = [normal * (_dot(normal, cross) / doubled) for normal in normals]
        bulges = np.stack(
            [
                0.5 * _dot(points[j] - points[i], upright[j] - upright[i]) / np.sqrt(doubled)
                for i, j in ((0, 1), (0, 2), (1, 2))
            ]
        )
    bulges[~np.isfinite(bulges)] = 0.0
    return np.clip(bulges, -_CREASE, _CREASE)


def _dot(first: F64, second: F64) -> F64:
    product: F64 = np.einsum("in,in->n", first, second)
    return product
