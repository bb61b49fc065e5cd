# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin, and the places at which they are sampled.

A vertex of a perceptual model stands for its *cell*: the skin nearer to it than to its
neighbours, each distance counted in the neighbour's own spacing. In HFX Studio (Danieau et al.,
VRST 2018), where perceptual models are from, a contact is a vertex inside a volume. Here a contact
has a weight, the share of the cell that is inside, so that nothing between two vertices is lost.

In a triangle with corners 0, 1, 2 the part of corner 0 is the *quad* from the corner over a place
on the edge to 1 and a place in the middle to a place on the edge to 2. Each quad is sampled at
``n`` by ``n`` places, each in the middle of its part of the quad.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from ..body.model import PerceptualModel
from ..body.temperature_cells import cell_of_skin

_SPACING: Final = np.sqrt(2.0 / np.sqrt(3.0))
"""Spacing of the vertices of an even pattern of triangles whose cells, hexagons, have area 1."""

_MOST: Final = 256  # samples along a quad, however large
_AT_ONCE: Final = 1 << 16  # samples: 100 MB where their paths have 64 steps
_VERTEX_SHARE: Final = 0.01  # of a cell that its vertex itself stands for at most
_CREASE: Final = 0.25  # of a triangle's size: a higher bulge is a crease
_FLAT: Final = 0.1  # of the distance of samples: a lower bulge is none


@dataclass(frozen=True)
class Fineness:
    """Distance of skin from the sample that stands for it: a share of the spacing of vertices,
    within limits."""

    share: float = 1.0 / 8.0
    least_m: float = 0.00025
    most_m: float = 0.001


EXACT: Final = Fineness()
"""Fineness of the engine at the tolerance ``exact``."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Model whose vertices feel, and the model whose triangles its cells are sampled on."""

    model: PerceptualModel
    surface: PerceptualModel
    owner: I32  # (vertices of the surface,) the vertex of the model whose cell they are in

    @classmethod
    def of(cls, model: PerceptualModel, finer: PerceptualModel | None = None) -> Skin:
        """Skin of a model, sampled on its own triangles or on those of a finer model.

        On limbs vertices of the temperature model are 150 mm apart: too far to follow the skin.
        """
        if finer is None:
            return cls(model, model, np.arange(len(model), dtype=np.int32))
        return cls(model, finer, cell_of_skin(model)[1])


@dataclass(frozen=True, eq=False)
class Samples:
    """Places of skin, each of which stands for a share of a cell's area."""

    cells: I64  # (N,) vertices of the model
    corners: I64  # (3, N) vertices of the surface
    shares: F64  # (3, N) of the corners: barycentric coordinates
    heights: F64  # (N,) above the flat triangle, in units of the square root of twice its area
    areas: F64  # (N,) of the cell's area; they sum to 1 for each cell

    def posed(self, points: F64, handedness: float) -> F64:
        """Positions (3, N) on a surface whose vertices are at ``points`` (3, V).

        ``handedness`` is -1 where the body is mirrored: normals then point inwards.
        """
        zero, one, two = (points[:, corner] for corner in self.corners)
        cross = np.cross(one - zero, two - zero, axis=0)  # as long as twice the area
        doubled = np.sqrt(np.einsum("in,in->n", cross, cross))
        size = np.sqrt(
            np.where(doubled > 0.0, doubled, 1.0)
        )  # unit normal times size: cross / size
        flat = zero * self.shares[0] + one * self.shares[1] + two * self.shares[2]
        bulged: F64 = flat + handedness * cross * (self.heights / size)
        return bulged


def vertex_samples(model: PerceptualModel) -> Samples:
    """The test of HFX Studio (Danieau et al., 2018): a vertex alone stands for its cell."""
    every, count = np.arange(len(model)), len(model)
    shares = np.stack([np.ones(count), np.zeros(count), np.zeros(count)])
    return Samples(every, np.stack([every] * 3), shares, np.zeros(count), np.ones(count))


class Cells:
    """All quads of a skin at rest; :meth:`samples` gives their samples, some cells at a time."""

    def __init__(self, skin: Skin, fineness: Fineness) -> None:
        surface, self._skin = skin.surface, skin
        spacing = _SPACING * np.sqrt(skin.model.areas_m2.astype(np.float64))[skin.owner]
        distance = np.clip(fineness.share * spacing, fineness.least_m, fineness.most_m)
        turned = [np.roll(surface.triangles, -k, axis=1) for k in range(3)]
        self._corners = np.concatenate(turned).T.astype(np.int64)  # (3, Q), each quad's own first
        points = [surface.vertices[corner].astype(np.float64).T for corner in self._corners]
        normals = [surface.normals[corner].astype(np.float64).T for corner in self._corners]
        unit = self._corners[0]

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
        """Samples along each side of the quads, so that no skin of a part is farther than
        ``distance`` from its sample: that is, the corners of the part."""
        most = np.ceil(self._reach(squares, np.inf) / distance - 1e-9)
        steps = np.ceil(self._reach(squares, most) / distance - 1e-9)
        return np.clip(steps, 1, _MOST).astype(np.int64)

    def _reach(self, squares: tuple[F64, F64, F64], steps: F64 | float) -> F64:
        """Longest way from a sample to a corner of its part, times ``steps``, (Q,) metres.

        The place of (s, t) is bilinear: the way is half a step in s and in t, times the derivatives
        halfway there, and longest towards a corner of the quad, a quarter of a step from it.
        """
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
        """All samples, or those of some cells, those of a cell together, in blocks that stay
        small."""
        owner, count = self._skin.owner.astype(np.int64), len(self._skin.model)
        sizes = np.bincount(owner[self._corners[0]], self._steps**2, count)
        is_asked = np.full(count, cells is None)
        is_asked[cells] = True
        total = np.cumsum(np.where(is_asked, sizes, 0.0))
        block = np.where(is_asked, total // _AT_ONCE, -1).astype(np.int64)  # of each cell
        quad_block, unit_block = block[owner[self._corners[0]]], block[owner]
        for number in range(int(block.max(initial=-1)) + 1):
            quads = np.flatnonzero(quad_block == number)
            yield self._samples_of(quads, np.flatnonzero(unit_block == number))

    def _samples_of(self, quads: I64, units: I64) -> Samples:
        """Samples of some quads, and of the vertices of the surface that they are around."""
        owner, total = self._skin.owner.astype(np.int64), len(self._skin.surface)
        counts = self._steps[quads] ** 2
        quad = np.repeat(quads, counts)
        step = np.arange(len(quad)) - np.repeat(np.cumsum(counts) - counts, counts)
        n = self._steps[quad]
        s, t = (step // n + 0.5) / n, (step % n + 0.5) / n
        edge, other, inner, inner_2 = (
            each[quad] for each in (self._edge, self._other, self._inner, self._inner_2)
        )
        one = s * (1.0 - t) * edge + s * t * inner
        two = (1.0 - s) * t * other + s * t * inner_2
        # The Jacobian of (one, two) by (s, t), times twice the triangle's area, is the area there.
        jacobian = edge * other + s * edge * (inner_2 - other) + t * other * (inner - edge)
        areas = jacobian * self._doubled[quad] / n**2
        by_one, by_two, between = self._bulges[:, quad]
        heights = (1.0 - one - two) * (one * by_one + two * by_two) + one * two * between

        # The vertex is a sample, too, of as much as the others, but at most a hundredth.
        unit = self._corners[0, quad]
        of_units = np.bincount(unit, areas, total)
        of_units[units] = np.where(of_units[units] > 0.0, of_units[units], 1.0)
        of_cells = np.bincount(owner, of_units, len(self._skin.model))
        unit_shares = of_units / np.where(of_cells > 0.0, of_cells, 1.0)[owner]
        numbers = np.bincount(unit, minlength=total)
        own = np.where(numbers > 0, np.minimum(1.0 / (numbers + 1.0), _VERTEX_SHARE), 1.0)
        areas = areas / of_units[unit] * (unit_shares * (1.0 - own))[unit]
        nothing = np.zeros(len(units))
        return Samples(
            np.concatenate([owner[units], owner[unit]]),
            np.concatenate([np.stack([units] * 3), self._corners[:, quad]], axis=1),
            np.concatenate(
                [
                    np.stack([nothing + 1.0, nothing, nothing]),
                    np.stack([1.0 - one - two, one, two]),
                ],
                axis=1,
            ),
            np.concatenate([nothing, heights]),
            np.concatenate([(unit_shares * own)[units], areas]),
        )


@lru_cache(maxsize=4)
def cells_of(skin: Skin, fineness: Fineness) -> Cells:
    """Cells of a skin; kept, as every sample in time needs them."""
    return Cells(skin, fineness)


def _bulges(points: list[F64], normals: list[F64], cross: F64, doubled: F64) -> F64:
    """Coefficients of the bulge of skin over its triangles, (3, Q): of edges 01, 02 and 12.

    Phong tessellation (Boubekeur and Alexa, 2008) moves a place with barycentric coordinates l to
    the mean, weighted by them, of its projections onto the planes at the corners. Its height above
    the triangle is the sum over edges ij of ``l_i l_j (p_j - p_i) . (m_j - m_i)``, where ``m_i`` is
    the corner's normal times its cosine to the triangle's. Half of it has the true sagitta of a
    circle and of a sphere, to second order.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        upright = [each * (_dot(each, cross) / doubled) for each in normals]
        bulges = np.stack(
            [
                0.5 * _dot(points[j] - points[i], upright[j] - upright[i]) / np.sqrt(doubled)
                for i, j in ((0, 1), (0, 2), (1, 2))
            ]
        )
    bulges[~np.isfinite(bulges)] = 0.0
    return np.clip(bulges, -_CREASE, _CREASE)


def _dot(one: F64, other: F64) -> F64:
    product: F64 = np.einsum("in,in->n", one, other)
    return product
